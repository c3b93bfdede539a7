// Emits a (tile, Gaussian) pair for each tile that a Gaussian reaches, nearest Gaussian first.
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> reaches: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
// The Gaussian, or the pair's index if `owners` holds the Gaussian.
@group(0) @binding(5) var<storage, read_write> values: array<u32>;
@group(0) @binding(6) var<storage, read_write> owners: array<u32>;
// Cleared before: the end of each tile's list, if there are more pairs than the lists hold.
@group(0) @binding(7) var<storage, read_write> ranges: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read> masks: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, 64u, local);
    if at >= view.window.w {
        return;
    }
    let gaussian = order[at];
    let tiles = tiles_of(reaches[gaussian]);
    var slot = offsets[at];
    let total = offsets[view.window.w];
    let fits = total <= view.window.y;
    // More than any lists could hold are not worth counting: the window will be split.
    if !fits && total > view.part.x {
        return;
    }
    if tiles.z <= tiles.x || tiles.w <= tiles.y {
        return;
    }
    let mask = masks[at];
    let shift = shift_of(tiles);
    let across = squares_of(tiles, shift).x;
    let first = gaussian / view.batch.x * view.batch.y;
    for (var row = tiles.y; row < tiles.w; row++) {
        for (var column = tiles.x; column < tiles.z; column++) {
            let bit = ((row - tiles.y) >> shift) * across + ((column - tiles.x) >> shift);
            if ((mask >> bit) & 1u) == 0u {
                continue;
            }
            let tile = first + (row - view.tiles.y) * view.tiles.z + (column - view.tiles.x);
            if !fits {
                // Only the lengths of the lists, for the host. Integer sums do not depend on the order.
                atomicAdd(&ranges[2u * tile + 1u], 1u);
                continue;
            }
            keys[slot] = tile;
            values[slot] = select(gaussian, slot, has(HAS_OWNERS));
            if has(HAS_OWNERS) {
                owners[slot] = gaussian;
            }
            slot += 1u;
        }
    }
}
