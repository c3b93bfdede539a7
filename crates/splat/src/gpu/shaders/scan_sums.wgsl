// Saturating sums of blocks of 2048 numbers.
@group(0) @binding(2) var<storage, read> numbers: array<u32>;
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;

var<workgroup> shared_sums: array<u32, 64>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    let count = length();
    let blocks = blocks_of(count);
    var sum = 0u;
    // Neighbouring threads read neighbouring numbers; the order does not affect the sum.
    for (var n = 0u; n < 32u; n++) {
        let at = block * 2048u + n * 64u + local;
        if block < blocks && at < count {
            sum = saturating(sum, numbers[at]);
        }
    }
    shared_sums[local] = sum;
    workgroupBarrier();
    if local == 0u && block < blocks {
        var total = 0u;
        for (var n = 0u; n < 64u; n++) {
            total = saturating(total, shared_sums[n]);
        }
        sums[block] = total;
    }
}
