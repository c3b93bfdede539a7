// Backward pass of colour: to the SH coefficients, the scalars, and through the view direction to the means.
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> seconds: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> colours: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> reaches: array<vec2<u32>>;
// Records of this part, 24 values per splat; this kernel writes the first three and the last two.
@group(0) @binding(6) var<storage, read_write> records: array<f32>;
@group(0) @binding(7) var<storage, read_write> d_sh: array<f32>;
@group(0) @binding(8) var<storage, read_write> d_scalars: array<f32>;

// Far beyond any real gradient. What may overflow f32 is cut off there, so that nothing computed from it overflows: the difference of
// two infinities would be NaN.
const LARGEST: f32 = 1e34;

fn bounded(value: vec3<f32>) -> vec3<f32> {
    return clamp(value, vec3(-LARGEST), vec3(LARGEST));
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, 64u, local);
    if at >= splats() {
        return;
    }
    let gaussian = enter(at);
    let index = view.part.y + at;
    let is_drawn = reaches[index].y != 0u;
    let first = 3u * view.part.z * gaussian;
    let result = 3u * view.part.z * at;
    if has(HAS_SCALAR) {
        d_scalars[at] = select(0.0, saturated(seconds[index].w), is_drawn && !has(ABSOLUTE));
    }
    var d_mean = vec3(0.0);
    if is_drawn {
        let coefficients = (view.part.w + 1u) * (view.part.w + 1u);
        let direction = direction_to(vec3(means[3u * gaussian], means[3u * gaussian + 1u], means[3u * gaussian + 2u]));
        var basis = sh_basis(view.part.w, direction.xyz);
        // A channel clamped at 0 has no gradient.
        var raw = vec3(0.5);
        for (var k = 0u; k < coefficients; k++) {
            let n = first + 3u * k;
            raw += basis[k] * vec3(sh[n], sh[n + 1u], sh[n + 2u]);
        }
        let d_rgb = select(colours[index].xyz, vec3(0.0), raw < vec3(0.0));
        for (var k = 0u; k < coefficients; k++) {
            let n = result + 3u * k;
            let value = saturated3(basis[k] * d_rgb);
            d_sh[n] = value.x;
            d_sh[n + 1u] = value.y;
            d_sh[n + 2u] = value.z;
        }
        for (var k = coefficients; k < view.part.z; k++) {
            let n = result + 3u * k;
            d_sh[n] = 0.0;
            d_sh[n + 1u] = 0.0;
            d_sh[n + 2u] = 0.0;
        }
        if !has(DIRECTIONS_STOP) && view.part.w > 0u && direction.w > 0.0 {
            var gradients = sh_gradient(view.part.w, direction.xyz);
            var d_direction = vec3(0.0);
            for (var k = 1u; k < coefficients; k++) {
                let n = first + 3u * k;
                d_direction += gradients[k] * dot(bounded(vec3(sh[n], sh[n + 1u], sh[n + 2u]) * d_rgb), vec3(1.0));
            }
            let tangential = (d_direction - direction.xyz * dot(direction.xyz, d_direction)) / direction.w;
            d_mean = bounded(select(tangential, tangential.yzx, has(E3NN)));
        }
    } else {
        for (var k = 0u; k < 3u * view.part.z; k++) {
            d_sh[result + k] = 0.0;
        }
    }
    let record = RECORD * at;
    records[record + OF_MEAN] = d_mean.x;
    records[record + OF_MEAN + 1u] = d_mean.y;
    records[record + OF_MEAN + 2u] = d_mean.z;
    // The exponent is ln 2 times a sum of two squares.
    let absolute = select(vec2(0.0), 1.3862944 * vec2(colours[index].w, seconds[index].w), has(ABSOLUTE));
    records[record + OF_SCREEN] = select(-1.0, saturated(absolute.x), is_drawn);
    records[record + OF_SCREEN + 1u] = select(-1.0, saturated(absolute.y), is_drawn);
}
