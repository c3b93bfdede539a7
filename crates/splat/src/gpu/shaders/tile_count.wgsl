// The tiles that each Gaussian reaches, nearest Gaussian first: their number, and the mask by which `emit` finds them.
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> reaches: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> shapes: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> positions: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> masks: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, 64u, local);
    if at > view.window.w {
        return;
    }
    if at == view.window.w {
        counts[at] = 0u;
        return;
    }
    let gaussian = order[at];
    let tiles = tiles_of(reaches[gaussian]);
    if tiles.z <= tiles.x || tiles.w <= tiles.y {
        counts[at] = 0u;
        return;
    }
    let shift = shift_of(tiles);
    let mask = mask_of(tiles, shift, shapes[gaussian], positions[gaussian]);
    let squares = squares_of(tiles, shift);
    let side = 1u << shift;
    var count = 0u;
    for (var row = 0u; row < squares.y; row++) {
        let height = min(side, tiles.w - tiles.y - row * side);
        for (var column = 0u; column < squares.x; column++) {
            if ((mask >> (row * squares.x + column)) & 1u) != 0u {
                count += height * min(side, tiles.z - tiles.x - column * side);
            }
        }
    }
    counts[at] = count;
    masks[at] = mask;
}
