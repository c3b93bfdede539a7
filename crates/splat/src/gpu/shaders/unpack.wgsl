// Copies some values of each record to an output buffer, summed over the views of its scene in their order.
struct Unpack {
    count: u32,
    // Offset in a record, and number of values.
    from_: u32,
    width: u32,
    // Values per Gaussian in the result; excess ones are 0.
    stride: u32,
    // Index of the first Gaussian in the result.
    first: u32,
    // Values per record.
    record: u32,
    // Gaussians of a scene, and its views.
    each: u32,
    views: u32,
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
    let splat = at / unpack.each * unpack.views * unpack.each + at % unpack.each;
    for (var k = 0u; k < unpack.stride; k++) {
        var value = 0.0;
        if k < unpack.width {
            value = records[unpack.record * splat + unpack.from_ + k];
            for (var n = 1u; n < unpack.views; n++) {
                value += records[unpack.record * (splat + n * unpack.each) + unpack.from_ + k];
            }
        }
        result[(unpack.first + at) * unpack.stride + k] = value;
    }
}
