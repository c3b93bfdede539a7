// Tile lists from the sorted pairs: the range of each tile's pairs ((0, 0) for empty tiles), their Gaussians, and which
// of the tile's pixels each may reach.
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> reaches: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> ranges: array<u32>;
// The pair's index if `owners` holds the Gaussian, then the Gaussian.
@group(0) @binding(6) var<storage, read_write> pairs: array<vec2<u32>>;
// First and last column, then row, within the tile; 4 bits each.
@group(0) @binding(7) var<storage, read_write> boxes: array<u32>;
@group(0) @binding(8) var<storage, read> offsets: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, 64u, local);
    let count = offsets[view.window.w];
    if count > view.window.y || at >= count {
        return;
    }
    let tile = keys[at];
    if at == 0u || keys[at - 1u] != tile {
        ranges[2u * tile] = at;
    }
    if at + 1u == count || keys[at + 1u] != tile {
        ranges[2u * tile + 1u] = at + 1u;
    }
    let value = values[at];
    var gaussian = value;
    if has(HAS_OWNERS) {
        gaussian = owners[value];
    }
    pairs[at] = vec2(value, gaussian);
    let corner = corner_of(tile);
    let reach = reaches[gaussian];
    let first = max(vec2(reach.x & 0xffffu, reach.y & 0xffffu), corner) - corner;
    let last = min(vec2(reach.x >> 16u, reach.y >> 16u) - corner, vec2(16u)) - 1u;
    boxes[at] = first.x | (last.x << 4u) | (first.y << 8u) | (last.y << 12u);
}
