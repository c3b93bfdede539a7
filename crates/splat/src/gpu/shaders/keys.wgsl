// A sort key for each Gaussian that orders like the depth, with culled Gaussians last; and the counts of Gaussians.
@group(0) @binding(1) var<storage, read> reaches: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> positions: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> values: array<u32>;
@group(0) @binding(5) var<storage, read_write> counts: array<atomic<u32>, 8>;

var<workgroup> group_counts: array<atomic<u32>, 8>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    if local < 8u {
        atomicStore(&group_counts[local], 0u);
    }
    workgroupBarrier();
    let at = linear_index(group, groups, 64u, local);
    if at < view.window.w {
        let reach = reaches[at];
        let drawn = reach.y != 0u;
        // Integer sums do not depend on the order.
        atomicAdd(&group_counts[select(reach.x, 0u, drawn)], 1u);
        let bits = positions[at].w;
        let key = select(bits | 0x80000000u, ~bits, (bits >> 31u) != 0u);
        keys[at] = select(0xffffffffu, key, drawn);
        values[at] = at;
    }
    workgroupBarrier();
    if local < 8u {
        let count = atomicLoad(&group_counts[local]);
        if count > 0u {
            atomicAdd(&counts[local], count);
        }
    }
}
