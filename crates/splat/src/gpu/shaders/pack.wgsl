// Packs a strip's colours in the format that the host asked for; one word per thread.
struct Pack {
    pixels: u32,
    // 3, or 4 with alpha.
    channels: u32,
    // Bytes of a number: 1 for levels, 2 for f16, 4 for f32.
    bytes: u32,
    spare: u32,
}

@group(0) @binding(0) var<uniform> pack: Pack;
@group(0) @binding(1) var<storage, read> colours: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> packed: array<u32>;

// A number of the image, row by row; 0 behind its end.
fn number(at: u32) -> f32 {
    let pixel = at / pack.channels;
    if pixel >= pack.pixels {
        return 0.0;
    }
    let colour = colours[pixel];
    return colour[at % pack.channels];
}

// The nearest of 256 levels.
fn level(value: f32) -> u32 {
    return u32(floor(clamp(value, 0.0, 1.0) * 255.0 + 0.5));
}

fn half_range(value: f32) -> f32 {
    return clamp(value, -65504.0, 65504.0);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = (group.y * groups.x + group.x) * 64u + local;
    let each = 4u / pack.bytes;
    let first = word * each;
    if first >= pack.pixels * pack.channels {
        return;
    }
    if pack.bytes == 4u {
        packed[word] = bitcast<u32>(number(first));
    } else if pack.bytes == 2u {
        packed[word] = pack2x16float(vec2(half_range(number(first)), half_range(number(first + 1u))));
    } else {
        packed[word] = level(number(first)) | (level(number(first + 1u)) << 8u) | (level(number(first + 2u)) << 16u)
            | (level(number(first + 3u)) << 24u);
    }
}
