'use strict';
// Draws the Gaussians of crates/eval/src/live with WebGL2 as crates/splat does: EWA projection with its blur and clamps, sorted by
// depth, composited front to back with premultiplied alpha in half floats. Shared by every live view of a page.
window.splatter = (() => {
  const WIDTH = 1024;
  const HEAD = `#version 300 es
    precision highp float; precision highp int; precision highp usampler2D;
    uniform mat3 rotation; uniform vec3 translation; uniform vec2 focal, principal, size;`;
  const PROJECT = `${HEAD}
    uniform usampler2D packed, labels;
    uniform vec3 low, high; uniform vec2 logScales; uniform float brightest, near, blur, minAlpha, margin;
    uniform int tint; uniform int blocks;
    in uint which;
    out vec2 offset; flat out vec3 conic; flat out vec4 colour;
    const vec3 BLOCKS[8] = vec3[8](vec3(.45,.48,.52), vec3(0.,.45,.70), vec3(.90,.62,0.), vec3(0.,.62,.45), vec3(.80,.40,.0),
      vec3(.80,.47,.65), vec3(.34,.71,.91), vec3(.94,.89,.26));
    const vec3 VIRIDIS[5] = vec3[5](vec3(.267,.005,.329), vec3(.229,.322,.545), vec3(.128,.567,.551), vec3(.369,.789,.383), vec3(.993,.906,.144));
    vec3 viridis(float share) {
      float at = clamp(share, 0., 1.) * 4.; int low = min(int(at), 3);
      return mix(VIRIDIS[low], VIRIDIS[low + 1], at - float(low));
    }
    float byte(uint word, int at) { return float(word >> uint(8 * at) & 255u); }
    void main() {
      ivec2 at = ivec2(int(which) % ${WIDTH}, int(which) / ${WIDTH});
      uvec4 word = texelFetch(packed, at, 0);
      uvec2 label = texelFetch(labels, at, 0).xy;
      vec3 mean = mix(low, high, vec3(word.x & 65535u, word.x >> 16u, word.y & 65535u) / 65535.);
      vec3 scale = exp(mix(logScales.xxx, logScales.yyy, vec3(byte(word.y, 2), byte(word.y, 3), byte(word.z, 0)) / 255.));
      vec3 q = (vec3(byte(word.z, 1), byte(word.z, 2), byte(word.z, 3)) / 127. - 1.) * .70710678;
      float w = sqrt(max(0., 1. - dot(q, q)));
      vec3 stored = vec3(byte(word.w, 0), byte(word.w, 1), byte(word.w, 2)) / 255. * brightest;
      float opacity = byte(word.w, 3) / 255.;
      colour = vec4(tint == 0 ? stored : tint == 1 ? BLOCKS[int(label.x) % 8] : viridis(float(label.y) / 255.), opacity);
      gl_Position = vec4(2., 2., 2., 1.); offset = vec2(0.); conic = vec3(0.);
      vec3 seen = rotation * mean + translation;
      if (!(seen.z > near) || !(opacity >= minAlpha)) return;
      vec2 slope = seen.xy / seen.z;
      vec2 least = -principal / focal, most = (size - principal) / focal, beyond = margin * .5 * (most - least);
      vec2 clamped = clamp(slope, least - beyond, most + beyond);
      mat3 axes = mat3(1. - 2. * (q.y * q.y + q.z * q.z), 2. * (q.x * q.y + w * q.z), 2. * (q.x * q.z - w * q.y),
        2. * (q.x * q.y - w * q.z), 1. - 2. * (q.x * q.x + q.z * q.z), 2. * (q.y * q.z + w * q.x),
        2. * (q.x * q.z + w * q.y), 2. * (q.y * q.z - w * q.x), 1. - 2. * (q.x * q.x + q.y * q.y));
      mat3 turned = rotation * axes;
      vec3 u = scale * (vec3(focal.x, 0., -focal.x * clamped.x) * turned) / seen.z;
      vec3 v = scale * (vec3(0., focal.y, -focal.y * clamped.y) * turned) / seen.z;
      float a = dot(u, u) + blur, b = dot(u, v), c = dot(v, v) + blur;
      vec3 normal = cross(u, v);
      float determinant = dot(normal, normal) + blur * (dot(u, u) + dot(v, v)) + blur * blur;
      if (!(determinant > 0.)) return;
      conic = vec3(c, -b, a) / determinant;
      // Where alpha falls to minAlpha.
      float reach = 2. * log(opacity / minAlpha);
      vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2. - 1.;
      offset = corner * (sqrt(reach * vec2(a, c)) + 1.);
      vec2 pixel = (focal * slope + principal + offset) / size * 2. - 1.;
      gl_Position = vec4(pixel.x, -pixel.y, 0., 1.);
    }`;
  const FALL_OFF = `#version 300 es
    precision highp float;
    uniform float minAlpha, maxAlpha;
    in vec2 offset; flat in vec3 conic; flat in vec4 colour; out vec4 shown;
    void main() {
      float exponent = .5 * (conic.x * offset.x * offset.x + conic.z * offset.y * offset.y) + conic.y * offset.x * offset.y;
      float alpha = min(maxAlpha, colour.a * exp(-max(0., exponent)));
      if (!(alpha >= minAlpha)) discard;
      shown = vec4(colour.rgb * alpha, alpha);
    }`;
  const COVER = `#version 300 es
    void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4. - 1., 0., 1.); }`;
  const BEHIND = `#version 300 es
    precision highp float; uniform highp sampler2D image; uniform vec3 background; out vec4 shown;
    void main() { vec4 blended = texelFetch(image, ivec2(gl_FragCoord.xy), 0); shown = vec4(blended.rgb + (1. - blended.a) * background, 1.); }`;
  const LINE = `${HEAD}
    in vec3 place; in vec3 tone; out vec3 drawn;
    void main() {
      vec3 seen = rotation * place + translation;
      vec2 pixel = (focal * seen.xy + principal * seen.z) / size * 2. - seen.z;
      gl_Position = vec4(pixel.x, -pixel.y, seen.z - .002, seen.z);
      drawn = tone;
    }`;
  const PLAIN = `#version 300 es
    precision highp float; in vec3 drawn; out vec4 shown; void main() { shown = vec4(drawn, 1.); }`;

  const program = (gl, ...sources) => {
    const linked = gl.createProgram();
    sources.forEach((source, at) => {
      const shader = gl.createShader(at ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(linked, shader);
    });
    gl.linkProgram(linked);
    if (!gl.getProgramParameter(linked, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(linked));
    const uniforms = {};
    for (let at = gl.getProgramParameter(linked, gl.ACTIVE_UNIFORMS) - 1; at >= 0; at -= 1) {
      const { name } = gl.getActiveUniform(linked, at);
      uniforms[name] = gl.getUniformLocation(linked, name);
    }
    return { linked, uniforms, attribute: name => gl.getAttribLocation(linked, name) };
  };
  const bytesOf = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));

  // A stage's Gaussians as textures, and their means for sorting.
  const upload = (gl, stage) => {
    const bytes = bytesOf(stage.gaussians);
    const tokens = new DataView(bytesOf(stage.tokens).buffer);
    const count = bytes.length / 16;
    const rows = Math.max(1, Math.ceil(count / WIDTH));
    const words = new Uint8Array(rows * WIDTH * 16);
    words.set(bytes);
    const labels = new Uint8Array(rows * WIDTH * 2);
    let at = 0;
    for (let token = 0; token < tokens.byteLength; token += 4) {
      for (let last = at + tokens.getUint16(token + 2, true); at < last; at += 1) {
        labels[2 * at] = tokens.getUint8(token);
        labels[2 * at + 1] = tokens.getUint8(token + 1);
      }
    }
    const means = new Float32Array(3 * count);
    const view = new DataView(bytes.buffer);
    for (let i = 0; i < count; i += 1) {
      for (let axis = 0; axis < 3; axis += 1) {
        means[3 * i + axis] = stage.low[axis] + view.getUint16(16 * i + 2 * axis, true) / 65535 * (stage.high[axis] - stage.low[axis]);
      }
    }
    const texture = (format, layout, type, data) => {
      const made = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, made);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
      gl.texImage2D(gl.TEXTURE_2D, 0, format, WIDTH, rows, 0, layout, type, data);
      return made;
    };
    return {
      count, means, order: new Uint32Array(count), depths: new Float32Array(count),
      packed: texture(gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT, new Uint32Array(words.buffer)),
      labels: texture(gl.RG8UI, gl.RG_INTEGER, gl.UNSIGNED_BYTE, labels),
    };
  };

  // Nearest first, ties by position: a radix sort of the depths' bits, which order positive floats.
  const sort = (stage, [, , , , , , x, y, z], shift) => {
    const { means, depths, count } = stage;
    for (let i = 0; i < count; i += 1) depths[i] = Math.max(0, x * means[3 * i] + y * means[3 * i + 1] + z * means[3 * i + 2] + shift);
    const keys = new Uint32Array(depths.buffer);
    let [from, to] = [Uint32Array.from({ length: count }, (_, i) => i), stage.order];
    for (const bits of [0, 16]) {
      const starts = new Uint32Array(65537);
      for (let i = 0; i < count; i += 1) starts[(keys[i] >>> bits & 65535) + 1] += 1;
      for (let i = 0; i < 65536; i += 1) starts[i + 1] += starts[i];
      for (let i = 0; i < count; i += 1) to[starts[keys[from[i]] >>> bits & 65535]++] = from[i];
      [from, to] = [to, from];
    }
    return from;
  };

  // Segments: x, y, z, r, g, b of both ends.
  const stroke = (gl, lines, edges, segments) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, edges);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(segments), gl.DYNAMIC_DRAW);
    ['place', 'tone'].forEach((name, part) => {
      const attribute = lines.attribute(name);
      gl.enableVertexAttribArray(attribute);
      gl.vertexAttribPointer(attribute, 3, gl.FLOAT, false, 24, 12 * part);
    });
    gl.drawArrays(gl.LINES, 0, segments.length / 6);
    ['place', 'tone'].forEach(name => gl.disableVertexAttribArray(lines.attribute(name)));
  };

  // Red, green, blue and opacity of every pixel, the top row first.
  const pixels = gl => {
    const [width, height] = [gl.canvas.width, gl.canvas.height];
    const raw = new Uint8Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, raw);
    const turned = new Uint8Array(raw.length);
    for (let row = 0; row < height; row += 1) turned.set(raw.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
    return turned;
  };

  // Draws into a canvas; throws if the browser has no WebGL2 with floating-point images.
  const create = canvas => {
    const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl || !gl.getExtension('EXT_color_buffer_float')) throw new Error('no WebGL2 with floating-point images');
    const [splats, cover, lines] = [program(gl, PROJECT, FALL_OFF), program(gl, COVER, BEHIND), program(gl, LINE, PLAIN)];
    const [which, edges] = [gl.createBuffer(), gl.createBuffer()];
    const [image, frame] = [gl.createTexture(), gl.createFramebuffer()];
    const camera = (drawn, view) => {
      const at = drawn.uniforms;
      gl.useProgram(drawn.linked);
      gl.uniformMatrix3fv(at.rotation, true, view.rotation);
      gl.uniform3fv(at.translation, view.translation);
      gl.uniform2fv(at.focal, view.focal);
      gl.uniform2fv(at.principal, view.principal);
      gl.uniform2fv(at.size, [canvas.width, canvas.height]);
      return at;
    };
    let allocated = '';
    const target = () => {
      gl.bindTexture(gl.TEXTURE_2D, image);
      const size = canvas.width + 'x' + canvas.height;
      if (size !== allocated) {
        allocated = size;
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, canvas.width, canvas.height, 0, gl.RGBA, gl.HALF_FLOAT, null);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
        gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
        gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, image, 0);
      }
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    };
    const draw = (stage, convention, view, tint, segments) => {
      gl.viewport(0, 0, canvas.width, canvas.height);
      target();
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
      const at = camera(splats, view);
      gl.uniform3fv(at.low, stage.low);
      gl.uniform3fv(at.high, stage.high);
      gl.uniform2fv(at.logScales, stage.logScales);
      for (const name of ['near', 'minAlpha', 'maxAlpha', 'margin']) gl.uniform1f(at[name], convention[name]);
      gl.uniform1f(at.brightest, stage.brightest);
      // In pixels of the camera's image.
      gl.uniform1f(at.blur, convention.blur * view.zoom * view.zoom);
      gl.uniform1i(at.tint, tint);
      [stage.gpu.packed, stage.gpu.labels].forEach((texture, unit) => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, texture);
      });
      gl.uniform1i(at.packed, 0);
      gl.uniform1i(at.labels, 1);
      gl.bindBuffer(gl.ARRAY_BUFFER, which);
      gl.bufferData(gl.ARRAY_BUFFER, sort(stage.gpu, view.rotation, view.translation[2]), gl.DYNAMIC_DRAW);
      const place = splats.attribute('which');
      gl.enableVertexAttribArray(place);
      gl.vertexAttribIPointer(place, 1, gl.UNSIGNED_INT, 0, 0);
      gl.vertexAttribDivisor(place, 1);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE_MINUS_DST_ALPHA, gl.ONE);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, stage.gpu.count);
      gl.disable(gl.BLEND);
      gl.vertexAttribDivisor(place, 0);
      gl.disableVertexAttribArray(place);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.useProgram(cover.linked);
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, image);
      gl.uniform1i(cover.uniforms.image, 0);
      gl.uniform3fv(cover.uniforms.background, convention.background);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      if (!segments.length) return;
      camera(lines, view);
      stroke(gl, lines, edges, segments);
    };
    return { draw, pixels: () => pixels(gl), upload: stage => { stage.gpu = stage.gpu || upload(gl, stage); } };
  };
  return { create };
})();
