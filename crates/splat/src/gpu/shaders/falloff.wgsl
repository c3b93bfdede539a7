// What compositing and its derivative share. A thread has a block of pixels 4 wide and ROWS high, which is 1 or 4
// (`kernels.rs` puts the constant in front), and a workgroup a tile.
const THREADS: u32 = 64u / ROWS;

// Whether a Gaussian's box within the tile leaves out the thread's pixels: most Gaussians of a tile are smaller.
fn misses(box: u32, corner: vec2<u32>) -> bool {
    return (box & 15u) > corner.x + 3u || ((box >> 4u) & 15u) < corner.x
        || ((box >> 8u) & 15u) > corner.y + (ROWS - 1u) || ((box >> 12u) & 15u) < corner.y;
}

// `2^(−x)` for x ≥ 0, to 2 units in the last place down to 2^−20, below which no opacity is ever drawn.
fn power_below(x: vec4<f32>) -> vec4<f32> {
    let n = round(-x);
    let f = -x - n;
    var value = vec4(1.5353366e-4) * f + 1.3398875e-3;
    value = value * f + 9.618437e-3;
    value = value * f + 5.5503325e-2;
    value = value * f + 2.4022648e-1;
    value = value * f + 6.931472e-1;
    value = value * f + 1.0;
    return bitcast<vec4<f32>>(bitcast<vec4<u32>>(value) + (bitcast<vec4<u32>>(vec4<i32>(n)) << vec4(23u)));
}

struct Falloff {
    // The whitened distance from the centre: x of each pixel, and y of all.
    along: vec4<f32>,
    across: f32,
    value: vec4<f32>,
}

fn falloff_at(shape: vec4<f32>, place: vec4<u32>, column: u32, row: u32) -> Falloff {
    let offset = vec2(bitcast<f32>(place.x), bitcast<f32>(place.y));
    let dx = vec4(f32(i32(column) - i32(place.z & 0xffffu))) + vec4(0.0, 1.0, 2.0, 3.0) + offset.x;
    let dy = f32(i32(row) - i32(place.z >> 16u)) + offset.y;
    var f: Falloff;
    // Beyond 64 standard deviations all is one, and nothing overflows.
    f.along = clamp(shape.x * dx + shape.y * dy, vec4(-64.0), vec4(64.0));
    f.across = clamp(shape.z * dy, -64.0, 64.0);
    f.value = power_below(min(f.along * f.along + f.across * f.across, vec4(20.0)));
    return f;
}
