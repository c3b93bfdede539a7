// What each pixel brings to the derivative: its gradients, all that lies behind the first Gaussian weighted by them,
// and its share of the background's.
// By red, green, blue, alpha.
@group(0) @binding(1) var<storage, read> by_colours: array<vec4<f32>>;
// By depth and scalar.
@group(0) @binding(2) var<storage, read> by_extras: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> colours: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> extras: array<vec4<f32>>;
// Two of each pixel: by red, green, blue, depth; by scalar, what lies behind, transmittance.
@group(0) @binding(5) var<storage, read_write> pixels: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> by_background: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear(group, groups, 64u, local);
    // Pixels of the strip stand where pairs do elsewhere.
    if at >= view.window.x {
        return;
    }
    var by_colour = by_colours[at];
    if has(WAS_EXPOSED) {
        let rows = view.exposure;
        let by_seen = by_colour.x * rows[0].xyz + by_colour.y * rows[1].xyz + by_colour.z * rows[2].xyz;
        by_colour = vec4(saturated3(by_seen), by_colour.w);
    }
    var by_extra = vec4(0.0);
    if has(EXTRA_GRADIENTS) {
        by_extra = by_extras[at];
    }
    let extra = extras[at];
    // The background is part of the colour already.
    var behind = dot(by_colour.xyz, colours[at].xyz) - extra.w * by_colour.w + extra.x * by_extra.x;
    if !has(SCALAR_STOPS) {
        behind += extra.y * by_extra.y;
    }
    pixels[2u * at] = vec4(by_colour.xyz, by_extra.x);
    pixels[2u * at + 1u] = vec4(by_extra.y, behind, 1.0, 0.0);
    by_background[at] = vec4(by_colour.xyz * extra.w, 0.0);
}
