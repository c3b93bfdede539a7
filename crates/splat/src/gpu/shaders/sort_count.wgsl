// Radix sort, least significant digit first, up to 8 bits per pass: counts each digit in each block of 2048 keys. The table is
// ordered by digit, then by block.
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> table: array<u32>;

var<workgroup> counts: array<atomic<u32>, 256>;

@compute @workgroup_size(128)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    let blocks = sort_blocks();
    let count = select(0u, items(), block < blocks);
    atomicStore(&counts[local], 0u);
    atomicStore(&counts[local + 128u], 0u);
    workgroupBarrier();
    for (var n = 0u; n < 16u; n++) {
        let at = block * 2048u + n * 128u + local;
        if at < count {
            // Integer sums do not depend on the order.
            atomicAdd(&counts[(keys[at] >> work.shift) & work.mask], 1u);
        }
    }
    workgroupBarrier();
    if block < blocks {
        table[local * blocks + block] = atomicLoad(&counts[local]);
        table[(local + 128u) * blocks + block] = atomicLoad(&counts[local + 128u]);
    }
}
