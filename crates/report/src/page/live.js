'use strict';
// The live view: one canvas, turned with mouse, touch and keys.
(() => {
  const at = id => document.getElementById(id);
  const root = at('live-view');
  if (!root) return;
  const { live: scenes } = JSON.parse(at('data').textContent);
  const canvas = root.querySelector('canvas');
  const [sceneSelect, cameraSelect, tint, block, frusta] = ['scene', 'camera', 'tint', 'block', 'frusta'].map(name => at('live-' + name));
  const note = at('live-note');
  let splatter;
  try {
    splatter = window.splatter.create(canvas);
  } catch (error) {
    root.classList.add('unavailable');
    note.textContent = 'The live view needs WebGL2: ' + error.message + '.';
    return;
  }

  // Rows of 3×3 matrices.
  const times = (a, b) => a.map((_, at) => [0, 1, 2].reduce((sum, i) => sum + a[at - at % 3 + i] * b[3 * i + at % 3], 0));
  const apply = (m, v) => [0, 3, 6].map(row => m[row] * v[0] + m[row + 1] * v[1] + m[row + 2] * v[2]);
  const transposed = m => m.map((_, at) => m[at % 3 * 3 + Math.floor(at / 3)]);
  const plus = (a, b) => a.map((value, at) => value + b[at]);
  const about = ([x, y, z], angle) => {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    const d = 1 - c;
    return [x * x * d + c, x * y * d - z * s, x * z * d + y * s, x * y * d + z * s, y * y * d + c, y * z * d - x * s, x * z * d - y * s, y * z * d + x * s, z * z * d + c];
  };
  const rotationOf = camera => [0, 1, 2, 4, 5, 6, 8, 9, 10].map(place => camera.camera_from_world[place]);
  const translationOf = camera => [3, 7, 11].map(place => camera.camera_from_world[place]);

  let scene, camera, rotation, translation, zoom = 1, waiting = false;
  const stage = () => scene.stages[block.value];

  // Half a turn for the canvas's width: the scene follows the pointer.
  const turn = (right, down) => {
    const step = Math.PI / canvas.clientWidth;
    const upright = rotationOf(scene.cameras[0]).slice(3, 6);
    const turned = times(about(rotation.slice(0, 3), down * step), about(upright, -right * step));
    const centre = apply(rotation, plus(scene.focus, apply(turned, scene.focus).map(value => -value)));
    translation = plus(centre, translation);
    rotation = times(rotation, turned);
    ask();
  };
  const focusSeen = () => plus(apply(rotation, scene.focus), translation);
  const approach = factor => {
    translation = plus(translation, focusSeen().map(value => (factor - 1) * value));
    ask();
  };
  const shift = (right, down) => {
    const step = focusSeen()[2] / (camera.focal[0] * canvas.clientWidth / camera.size[0]);
    translation = plus(translation, [right * step, down * step, 0]);
    ask();
  };
  const jump = () => {
    camera = scene.cameras[cameraSelect.value];
    [rotation, translation] = [rotationOf(camera), translationOf(camera)];
    resize();
  };
  const resize = exactly => {
    zoom = exactly || Math.max(1, Math.min(4, canvas.clientWidth * devicePixelRatio / camera.size[0]));
    [canvas.width, canvas.height] = camera.size.map(side => Math.round(side * zoom));
    canvas.style.aspectRatio = camera.size.join(' / ');
    ask();
  };

  const frustum = framed => {
    const [back, shift] = [transposed(rotationOf(framed)), translationOf(framed).map(value => -value)];
    const seen = plus(apply(rotationOf(framed), scene.focus), translationOf(framed));
    const depth = .12 * Math.hypot(...seen);
    const world = point => apply(back, plus(point, shift));
    const corner = (x, y) => world([(x - framed.principal[0]) / framed.focal[0] * depth, (y - framed.principal[1]) / framed.focal[1] * depth, depth]);
    const [w, h] = framed.size;
    const corners = [corner(0, 0), corner(w, 0), corner(w, h), corner(0, h)];
    const centre = world([0, 0, 0]);
    const top = corner(w / 2, -h / 4);
    const ends = corners.flatMap((one, i) => [centre, one, one, corners[(i + 1) % 4]]).concat([corners[0], top, top, corners[1]]);
    const tone = framed.context ? [.95, .45, 0] : [.25, .65, 1];
    return ends.flatMap(end => [...end, ...tone]);
  };
  const view = () => ({ rotation, translation, focal: camera.focal.map(one => one * zoom), principal: camera.principal.map(one => one * zoom), zoom });
  const draw = () => {
    waiting = false;
    splatter.upload(stage());
    const segments = frusta.checked ? scene.cameras.filter(other => other !== camera || moved()).flatMap(frustum) : [];
    splatter.draw(stage(), scene.convention, view(), Number(tint.value), segments);
  };
  const moved = () => rotation.some((value, place) => value !== rotationOf(camera)[place]) || translation.some((value, place) => value !== translationOf(camera)[place]);
  const ask = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(draw);
  };

  const choose = () => {
    scene = scenes[sceneSelect.value];
    block.max = scene.stages.length - 1;
    block.value = block.max;
    const options = scene.cameras.map((each, value) => Object.assign(document.createElement('option'), { value, textContent: (each.context ? 'context' : 'target') + ', frame ' + each.frame }));
    cameraSelect.replaceChildren(...options);
    tint.options[2].disabled = !scene.uncertainty;
    if (tint.options[2].disabled && tint.value === '2') tint.value = '0';
    describe();
    jump();
  };
  const describe = () => {
    const { label, shown, all } = stage();
    note.textContent = label + ': ' + shown + ' Gaussians' + (shown < all ? ' (' + (all - shown) + ' too faint for any pixel are left out)' : '');
    root.dataset.tint = tint.value;
    if (scene.uncertainty) at('live-range').textContent = scene.uncertainty.map(value => value.toFixed(2)).join(' to ');
    ask();
  };

  const pointers = new Map();
  canvas.addEventListener('pointerdown', event => {
    if (event.isTrusted) canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener('pointermove', event => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [right, down] = [now[0] - before[0], now[1] - before[1]];
    const other = [...pointers].find(([id]) => id !== event.pointerId);
    pointers.set(event.pointerId, now);
    if (other) {
      const apart = from => Math.hypot(from[0] - other[1][0], from[1] - other[1][1]);
      approach(Math.max(1, apart(before)) / Math.max(1, apart(now)));
      shift(right / 2, down / 2);
    } else if (event.shiftKey || event.buttons === 2) shift(right, down);
    else turn(right, down);
  });
  for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, event => pointers.delete(event.pointerId));
  canvas.addEventListener('contextmenu', event => event.preventDefault());
  canvas.addEventListener('wheel', event => { event.preventDefault(); approach(Math.exp(event.deltaY * .001)); }, { passive: false });
  canvas.addEventListener('keydown', event => {
    const quarter = canvas.clientWidth / 36;
    const keys = {
      ArrowLeft: () => turn(-quarter, 0), ArrowRight: () => turn(quarter, 0), ArrowUp: () => turn(0, -quarter), ArrowDown: () => turn(0, quarter),
      '+': () => approach(.9), '-': () => approach(1 / .9), Home: jump,
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  sceneSelect.addEventListener('change', choose);
  cameraSelect.addEventListener('change', jump);
  at('live-reset').addEventListener('click', jump);
  for (const input of [tint, block]) input.addEventListener('input', describe);
  frusta.addEventListener('change', ask);
  addEventListener('resize', () => resize());
  // For tests: what is drawn, and from where.
  root.live = { resize, draw, pixels: splatter.pixels, camera_from_world: () => [0, 1, 2].flatMap(row => [...rotation.slice(3 * row, 3 * row + 3), translation[row]]) };
  choose();
})();
