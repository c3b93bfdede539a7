// Replaces each number by the sum of all before it, given the sums of all preceding blocks.
@group(0) @binding(2) var<storage, read> sums: array<u32>;
@group(0) @binding(3) var<storage, read_write> numbers: array<u32>;

var<workgroup> prefixes: array<u32, 64>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    let count = length();
    let blocks = blocks_of(count);
    let first = block * 2048u + local * 32u;
    let end = select(first, min(first + 32u, count), block < blocks && first < count);
    var sum = 0u;
    for (var at = first; at < end; at++) {
        sum = saturating(sum, numbers[at]);
    }
    prefixes[local] = sum;
    workgroupBarrier();
    if local == 0u && block < blocks {
        var total = 0u;
        // A single block has no preceding blocks.
        if work.is_last == 0u {
            total = sums[block];
        }
        for (var n = 0u; n < 64u; n++) {
            let own = prefixes[n];
            prefixes[n] = total;
            total = saturating(total, own);
        }
    }
    workgroupBarrier();
    var total = prefixes[local];
    for (var at = first; at < end; at++) {
        let own = numbers[at];
        numbers[at] = total;
        total = saturating(total, own);
    }
}
