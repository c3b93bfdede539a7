// View-dependent colour of each drawn Gaussian.
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> scalars: array<f32>;
@group(0) @binding(4) var<storage, read_write> reaches: array<vec2<u32>>;
// RGB and the scalar.
@group(0) @binding(5) var<storage, read_write> splat_colours: array<vec4<f32>>;

const LARGEST_CHANNEL: f32 = 1e12;
const INVALID: u32 = 1u;

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
    if reaches[index].y == 0u {
        return;
    }
    var rgb = vec3(0.5);
    let first = 3u * view.part.z * gaussian;
    if view.part.w == 0u {
        rgb += 0.28209479177387814 * vec3(sh[first], sh[first + 1u], sh[first + 2u]);
    } else {
        let direction = direction_to(vec3(means[3u * gaussian], means[3u * gaussian + 1u], means[3u * gaussian + 2u]));
        var basis = sh_basis(view.part.w, direction.xyz);
        let coefficients = (view.part.w + 1u) * (view.part.w + 1u);
        for (var k = 0u; k < coefficients; k++) {
            let base = first + 3u * k;
            rgb += basis[k] * vec3(sh[base], sh[base + 1u], sh[base + 2u]);
        }
    }
    var scalar = 0.0;
    if has(HAS_SCALAR) {
        scalar = scalars[gaussian];
    }
    let largest = max(max(max(abs(rgb.x), abs(rgb.y)), abs(rgb.z)), abs(scalar));
    let is_valid = are_finite(rgb) && is_finite(scalar) && largest <= LARGEST_CHANNEL;
    if !is_valid {
        reaches[index] = vec2(INVALID, 0u);
        return;
    }
    splat_colours[index] = vec4(max(rgb, vec3(0.0)), scalar);
}
