// Initial state of the backward pass for each pixel: its gradients, the value of everything behind the first Gaussian
// weighted by them, and its contribution to the background's gradient. Gradients of red, green, blue, alpha.
@group(0) @binding(1) var<storage, read> d_colours: array<vec4<f32>>;
// Gradients of depth and scalar.
@group(0) @binding(2) var<storage, read> d_extras: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> colours: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> extras: array<vec4<f32>>;
// Two per pixel: gradients of red, green, blue, depth; gradient of the scalar, weighted value behind, transmittance.
@group(0) @binding(5) var<storage, read_write> pixels: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> d_background: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, 64u, local);
    // Here `window.x` holds the number of pixels of the strip.
    if at >= view.window.x {
        return;
    }
    var d_colour = d_colours[at];
    if has(EXPOSED_LOSS) {
        let rows = view.exposure;
        let d_seen = d_colour.x * rows[0].xyz + d_colour.y * rows[1].xyz + d_colour.z * rows[2].xyz;
        d_colour = vec4(saturated3(d_seen), d_colour.w);
    }
    var d_extra = vec4(0.0);
    if has(EXTRA_GRADIENTS) {
        d_extra = d_extras[at];
    }
    let extra = extras[at];
    // The colour already includes the background.
    var behind = dot(d_colour.xyz, colours[at].xyz) - extra.w * d_colour.w + extra.x * d_extra.x;
    if !has(SCALAR_STOPS) {
        behind += extra.y * d_extra.y;
    }
    pixels[2u * at] = vec4(d_colour.xyz, d_extra.x);
    pixels[2u * at + 1u] = vec4(d_extra.y, behind, 1.0, 0.0);
    d_background[at] = vec4(d_colour.xyz * extra.w, 0.0);
}
