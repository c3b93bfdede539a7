// Sums of blocks of 1024 vectors, as a tree of fixed shape.
struct Reduce {
    count: u32,
    blocks: u32,
    spare_a: u32,
    spare_b: u32,
}

@group(0) @binding(0) var<uniform> reduce: Reduce;
@group(0) @binding(1) var<storage, read> vectors: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4<f32>>;

var<workgroup> partial: array<vec4<f32>, 64>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    var sum = vec4(0.0);
    for (var n = 0u; n < 16u; n++) {
        let at = block * 1024u + n * 64u + local;
        if block < reduce.blocks && at < reduce.count {
            sum += vectors[at];
        }
    }
    partial[local] = sum;
    for (var width = 32u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if local < width {
            partial[local] += partial[local + width];
        }
    }
    if local == 0u && block < reduce.blocks {
        sums[block] = partial[0];
    }
}
