// Copies some of the 24 values of each record to an output buffer.
struct Unpack {
    count: u32,
    // Offset in a record, and number of values.
    from_: u32,
    width: u32,
    // Values per Gaussian in the result; excess ones are 0.
    stride: u32,
    // Index of the first Gaussian in the result.
    first: u32,
    spare_a: u32,
    spare_b: u32,
    spare_c: u32,
}

@group(0) @binding(0) var<uniform> unpack: Unpack;
@group(0) @binding(1) var<storage, read> records: array<f32>;
@group(0) @binding(2) var<storage, read_write> result: array<f32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = (group.y * groups.x + group.x) * 64u + local;
    if at >= unpack.count {
        return;
    }
    for (var k = 0u; k < unpack.stride; k++) {
        var value = 0.0;
        if k < unpack.width {
            value = records[24u * at + unpack.from_ + k];
        }
        result[(unpack.first + at) * unpack.stride + k] = value;
    }
}
