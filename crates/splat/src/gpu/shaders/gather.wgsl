// Sums over tiles: a Gaussian's pairs are contiguous, and are added in order to the sums of earlier windows.
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> offsets: array<u32>;
@group(0) @binding(3) var<storage, read> sums: array<f32>;
// Per Gaussian: Σe, Σea, Σeb, gradient of depth, which is 0 with ABSOLUTE.
@group(0) @binding(4) var<storage, read_write> firsts: array<vec4<f32>>;
// Σeaa, Σeab, Σebb, gradient of the scalar or, with ABSOLUTE, absolute sum along rows.
@group(0) @binding(5) var<storage, read_write> seconds: array<vec4<f32>>;
// Gradients of red, green, blue; with ABSOLUTE, absolute sum along columns.
@group(0) @binding(6) var<storage, read_write> colours: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, 64u, local);
    let were_listed = offsets[view.window.w] <= view.window.y;
    if at >= view.window.w || !were_listed || offsets[at] == offsets[at + 1u] {
        return;
    }
    let gaussian = order[at];
    var first = firsts[gaussian];
    var second = seconds[gaussian];
    var colour = colours[gaussian];
    for (var slot = offsets[at]; slot < offsets[at + 1u]; slot++) {
        let base = PAIR_SUMS * slot;
        let ninth = sums[base + 9u];
        first += vec4(sums[base], sums[base + 1u], sums[base + 2u], select(ninth, 0.0, has(ABSOLUTE)));
        second += vec4(sums[base + 3u], sums[base + 4u], sums[base + 5u], sums[base + 10u]);
        colour += vec4(sums[base + 6u], sums[base + 7u], sums[base + 8u], select(0.0, ninth, has(ABSOLUTE)));
    }
    firsts[gaussian] = first;
    seconds[gaussian] = second;
    colours[gaussian] = colour;
}
