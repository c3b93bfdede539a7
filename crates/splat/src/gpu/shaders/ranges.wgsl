// Where each tile's pairs begin and end among the sorted ones; tiles without any keep (0, 0).
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> ranges: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear(group, groups, 64u, local);
    if at >= view.window.x {
        return;
    }
    let tile = keys[at];
    if at == 0u || keys[at - 1u] != tile {
        ranges[2u * tile] = at;
    }
    if at + 1u == view.window.x || keys[at + 1u] != tile {
        ranges[2u * tile + 1u] = at + 1u;
    }
}
