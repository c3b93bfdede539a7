// Each tile's Gaussians over each other, nearest first.
@group(0) @binding(1) var<storage, read> shapes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> paints: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> pairs: array<u32>;
@group(0) @binding(5) var<storage, read> ranges: array<vec2<u32>>;
// RGB over the background, alpha.
@group(0) @binding(6) var<storage, read_write> colours: array<vec4<f32>>;
// Depth, scalar, median depth, transmittance.
@group(0) @binding(7) var<storage, read_write> extras: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> owners: array<u32>;

@compute @workgroup_size(4, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    let tile = group.y * groups.x + group.x;
    if tile >= view.tiles.z * view.tiles.w {
        return;
    }
    let column = (view.tiles.x + tile % view.tiles.z) * 16u + local.x * 4u;
    let row = (view.tiles.y + tile / view.tiles.z) * 16u + local.y;
    let range = ranges[tile];
    // That of a finished pixel is kept with its sign turned.
    var transmittance = vec4(1.0);
    var red = vec4(0.0);
    var green = vec4(0.0);
    var blue = vec4(0.0);
    var depth = vec4(0.0);
    var scalar = vec4(0.0);
    var median = vec4(0.0);
    for (var at = range.x; at < range.y; at++) {
        var gaussian = pairs[at];
        if has(SLOTS) {
            gaussian = owners[gaussian];
        }
        let shape = shapes[gaussian];
        let place = places[gaussian];
        let falloff = falloff_at(shape, place, column, row);
        let alpha = min(vec4(view.alphas.x), shape.w * falloff.value);
        let seen = alpha >= vec4(view.alphas.y);
        if !any(seen) {
            continue;
        }
        let paint = paints[gaussian];
        let product = alpha * transmittance;
        let after = transmittance - product;
        let open = after > vec4(view.alphas.z);
        let hit = seen & open;
        let weight = select(vec4(0.0), product, hit);
        red += weight * paint.x;
        green += weight * paint.y;
        blue += weight * paint.z;
        if has(EXTRAS) {
            let z = bitcast<f32>(place.w);
            depth += weight * z;
            scalar += weight * paint.w;
            let crosses = hit & (transmittance > vec4(0.5)) & (after <= vec4(0.5));
            median = select(median, vec4(z), crosses);
        }
        transmittance = select(transmittance, select(-abs(transmittance), after, open), seen);
        if all(transmittance <= vec4(0.0)) {
            break;
        }
    }
    transmittance = abs(transmittance);
    if row >= view.picture.y {
        return;
    }
    for (var n = 0u; n < 4u; n++) {
        if column + n < view.picture.x {
            let pixel = (row - view.window.z) * view.picture.x + column + n;
            let left = transmittance[n];
            let rgb = view.background.xyz * left + vec3(red[n], green[n], blue[n]);
            colours[pixel] = vec4(rgb, 1.0 - left);
            if has(EXTRAS) {
                extras[pixel] = vec4(depth[n], scalar[n], median[n], left);
            }
        }
    }
}
