// Colours' derivatives to the harmonics, the scalars, and through the direction to the means.
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> seconds: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> colours: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> reaches: array<vec2<u32>>;
// Of this part, 24 numbers a Gaussian; here the first three.
@group(0) @binding(6) var<storage, read_write> records: array<f32>;
@group(0) @binding(7) var<storage, read_write> by_sh: array<f32>;
@group(0) @binding(8) var<storage, read_write> by_scalars: array<f32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear(group, groups, 64u, local);
    if at >= view.part.x {
        return;
    }
    let place = view.part.y + at;
    let is_drawn = reaches[place].y != 0u;
    let first = 3u * view.part.z * at;
    if has(HAS_SCALAR) {
        by_scalars[at] = select(0.0, saturated(seconds[place].w), is_drawn);
    }
    var by_mean = vec3(0.0);
    if is_drawn {
        let coefficients = (view.part.w + 1u) * (view.part.w + 1u);
        let direction = direction_to(vec3(means[3u * at], means[3u * at + 1u], means[3u * at + 2u]));
        var basis = sh_basis(view.part.w, direction.xyz);
        // What was cut at 0 has no derivative.
        var raw = vec3(0.5);
        for (var k = 0u; k < coefficients; k++) {
            let n = first + 3u * k;
            raw += basis[k] * vec3(sh[n], sh[n + 1u], sh[n + 2u]);
        }
        let by_rgb = select(colours[place].xyz, vec3(0.0), raw < vec3(0.0));
        for (var k = 0u; k < coefficients; k++) {
            let n = first + 3u * k;
            let value = saturated3(basis[k] * by_rgb);
            by_sh[n] = value.x;
            by_sh[n + 1u] = value.y;
            by_sh[n + 2u] = value.z;
        }
        for (var k = coefficients; k < view.part.z; k++) {
            let n = first + 3u * k;
            by_sh[n] = 0.0;
            by_sh[n + 1u] = 0.0;
            by_sh[n + 2u] = 0.0;
        }
        if !has(DIRECTIONS_STOP) && view.part.w > 0u && direction.w > 0.0 {
            var slopes = sh_gradient(view.part.w, direction.xyz);
            var by_direction = vec3(0.0);
            for (var k = 1u; k < coefficients; k++) {
                let n = first + 3u * k;
                by_direction += slopes[k] * dot(vec3(sh[n], sh[n + 1u], sh[n + 2u]), by_rgb);
            }
            let tangential = (by_direction - direction.xyz * dot(direction.xyz, by_direction)) / direction.w;
            by_mean = select(tangential, tangential.yzx, has(E3NN));
        }
    } else {
        for (var k = 0u; k < 3u * view.part.z; k++) {
            by_sh[first + k] = 0.0;
        }
    }
    records[24u * at] = by_mean.x;
    records[24u * at + 1u] = by_mean.y;
    records[24u * at + 2u] = by_mean.z;
}
