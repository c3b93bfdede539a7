// Sums over tiles: a Gaussian's pairs lie together, and are added one after the other, to what earlier windows gave.
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> offsets: array<u32>;
@group(0) @binding(3) var<storage, read> sums: array<f32>;
// By Gaussian: Σe, Σea, Σeb, by depth.
@group(0) @binding(4) var<storage, read_write> firsts: array<vec4<f32>>;
// Σeaa, Σeab, Σebb, by scalar.
@group(0) @binding(5) var<storage, read_write> seconds: array<vec4<f32>>;
// By red, green, blue.
@group(0) @binding(6) var<storage, read_write> colours: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear(group, groups, 64u, local);
    if at >= view.window.w || offsets[at] == offsets[at + 1u] {
        return;
    }
    let gaussian = order[at];
    var first = firsts[gaussian];
    var second = seconds[gaussian];
    var colour = colours[gaussian];
    for (var slot = offsets[at]; slot < offsets[at + 1u]; slot++) {
        let from_here = 12u * slot;
        first += vec4(sums[from_here], sums[from_here + 1u], sums[from_here + 2u], sums[from_here + 9u]);
        second += vec4(sums[from_here + 3u], sums[from_here + 4u], sums[from_here + 5u], sums[from_here + 10u]);
        colour += vec4(sums[from_here + 6u], sums[from_here + 7u], sums[from_here + 8u], 0.0);
    }
    firsts[gaussian] = first;
    seconds[gaussian] = second;
    colours[gaussian] = colour;
}
