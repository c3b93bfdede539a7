// Second kernel of a pass: the prefix sums of the table give every key's destination, stable for equal digits.
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> table: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> values_out: array<u32>;

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
    var counts = vec4(0u);
    let end = min(run * 32u + 32u, items());
    for (var at = run * 32u; at < end; at++) {
        let key = keys[at];
        let digit = (key >> work.shift) & 15u;
        let which = vec4(digit >> 2u) == vec4(0u, 1u, 2u, 3u);
        let shift = 8u * (digit & 3u);
        let chosen = select(vec4(0u), counts, which);
        let before = ((chosen.x | chosen.y | chosen.z | chosen.w) >> shift) & 255u;
        counts += select(vec4(0u), vec4(1u << shift), which);
        let destination = table[digit * runs + run] + before;
        keys_out[destination] = key;
        values_out[destination] = values[at];
    }
}
