// One sum for each row of pixels of a strip, so that sums do not depend on how a picture is cut into strips.
@group(0) @binding(1) var<storage, read> by_background: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> rows: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let row = linear(group, groups, 64u, local);
    if row * view.picture.x >= view.window.x {
        return;
    }
    // Columns that are passed over now, as entries of tile lists are.
    let first = view.part.x;
    let past = first + min(view.part.y, view.picture.x - first);
    var sum = vec4(0.0);
    if first > 0u {
        sum = rows[view.window.z + row];
    }
    for (var column = first; column < past; column++) {
        sum += by_background[row * view.picture.x + column];
    }
    rows[view.window.z + row] = sum;
}
