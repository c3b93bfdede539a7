// Front-to-back compositing of each tile. RGB over the background, alpha.
@group(0) @binding(7) var<storage, read_write> colours: array<vec4<f32>>;
// Depth, scalar, median depth, transmittance.
@group(0) @binding(8) var<storage, read_write> extras: array<vec4<f32>>;

@compute @workgroup_size(4, THREADS / 4u)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    let tile = group.y * groups.x + group.x;
    if tile >= all_tiles() {
        return;
    }
    let block = block_of(tile, local);
    let list = ranges[tile];
    if is_done(list) {
        return;
    }
    let range = current_entries(list);
    let pauses = continues(list);
    // Negated for finished pixels.
    var transmittance: array<vec4<f32>, ROWS>;
    var red: array<vec4<f32>, ROWS>;
    var green: array<vec4<f32>, ROWS>;
    var blue: array<vec4<f32>, ROWS>;
    var depth: array<vec4<f32>, ROWS>;
    var scalar: array<vec4<f32>, ROWS>;
    var median: array<vec4<f32>, ROWS>;
    for (var r = 0u; r < ROWS; r++) {
        transmittance[r] = vec4(1.0);
        if has(RESUMES) {
            for (var n = 0u; n < 4u; n++) {
                if is_inside(block, r, n) {
                    let pixel = pixel_of(block, r, n);
                    let before = colours[pixel];
                    red[r][n] = before.x;
                    green[r][n] = before.y;
                    blue[r][n] = before.z;
                    transmittance[r][n] = before.w;
                    if has(EXTRAS) {
                        let more = extras[pixel];
                        depth[r][n] = more.x;
                        scalar[r][n] = more.y;
                        median[r][n] = more.z;
                    }
                }
            }
        }
    }
    var at = range.x;
    loop {
        // Threads advance independently: a Gaussian that misses a thread's pixels costs it one word.
        while at < range.y && misses(boxes[at], block) {
            at += 1u;
        }
        if at >= range.y {
            break;
        }
        let gaussian = pairs[at].y;
        at += 1u;
        let shape = shapes[gaussian];
        let position = positions[gaussian];
        let splat_colour = splat_colours[gaussian];
        let z = bitcast<f32>(position.w);
        var max_transmittance = vec4(-1.0);
        for (var r = 0u; r < ROWS; r++) {
            let falloff = falloff_at(shape, position, block, r);
            let alpha = min(vec4(view.alphas.x), shape.w * falloff.value);
            let before = transmittance[r];
            let layer = layer_of(alpha, before);
            let weight = layer.weight;
            red[r] += weight * splat_colour.x;
            green[r] += weight * splat_colour.y;
            blue[r] += weight * splat_colour.z;
            if has(EXTRAS) {
                depth[r] += weight * z;
                scalar[r] += weight * splat_colour.w;
                median[r] = select(median[r], vec4(z), layer.hit & (before > vec4(0.5)) & (layer.after <= vec4(0.5)));
            }
            transmittance[r] = layer.transmittance;
            max_transmittance = max(max_transmittance, transmittance[r]);
        }
        if all(max_transmittance <= vec4(0.0)) {
            break;
        }
    }
    for (var r = 0u; r < ROWS; r++) {
        for (var n = 0u; n < 4u; n++) {
            if is_inside(block, r, n) {
                let pixel = pixel_of(block, r, n);
                if pauses {
                    colours[pixel] = vec4(red[r][n], green[r][n], blue[r][n], transmittance[r][n]);
                    if has(EXTRAS) {
                        extras[pixel] = vec4(depth[r][n], scalar[r][n], median[r][n], 0.0);
                    }
                    continue;
                }
                let remaining = abs(transmittance[r][n]);
                var rgb = view.background.xyz * remaining + vec3(red[r][n], green[r][n], blue[r][n]);
                if has(APPLY_EXPOSURE) {
                    let visible = vec4(rgb, 1.0);
                    let rows = view.exposure;
                    rgb = saturated3(vec3(dot(rows[0], visible), dot(rows[1], visible), dot(rows[2], visible)));
                }
                colours[pixel] = vec4(rgb, 1.0 - remaining);
                if has(EXTRAS) {
                    extras[pixel] = vec4(depth[r][n], scalar[r][n], median[r][n], remaining);
                }
            }
        }
    }
}
