// One sum per pixel row of a strip, so that the result does not depend on how the image is split into strips.
@group(0) @binding(1) var<storage, read> d_background: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> rows: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let row = linear_index(group, groups, 64u, local);
    if row * view.image.x >= view.window.x {
        return;
    }
    // Columns of this dispatch, limited like the entries of tile lists.
    let first = view.part.x;
    let end = first + min(view.part.y, view.image.x - first);
    var sum = vec4(0.0);
    if first > 0u {
        sum = rows[view.window.z + row];
    }
    for (var column = first; column < end; column++) {
        sum += d_background[row * view.image.x + column];
    }
    rows[view.window.z + row] = sum;
}
