// Number of tiles that each Gaussian reaches, nearest Gaussian first.
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> reaches: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, 64u, local);
    if at < view.window.w {
        let tiles = tiles_of(reaches[order[at]]);
        counts[at] = (tiles.z - tiles.x) * (tiles.w - tiles.y);
    } else if at == view.window.w {
        counts[at] = 0u;
    }
}
