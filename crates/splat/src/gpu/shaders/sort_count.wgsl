// Radix sort, least significant digit first, 4 bits per pass, 32 keys per thread: counts each digit in each run of 32
// keys. The table is ordered by digit, then by run.
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> table: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let run = (group.y * groups.x + group.x) * 64u + local;
    let runs = runs();
    if run >= runs {
        return;
    }
    // Sixteen counts of 8 bits.
    var counts = vec4(0u);
    let end = min(run * 32u + 32u, items());
    for (var at = run * 32u; at < end; at++) {
        let digit = (keys[at] >> work.shift) & 15u;
        counts += select(vec4(0u), vec4(1u << (8u * (digit & 3u))), vec4(digit >> 2u) == vec4(0u, 1u, 2u, 3u));
    }
    for (var part = 0u; part < 4u; part++) {
        for (var byte = 0u; byte < 4u; byte++) {
            table[(4u * part + byte) * runs + run] = (counts[part] >> (8u * byte)) & 255u;
        }
    }
}
