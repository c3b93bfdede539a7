// Shared by compositing and its backward pass: the Gaussian falloff, and tile lists, nearest Gaussian first.
//
// A thread composites a block of pixels 4 wide and ROWS high (1 or 4; defined by `kernels.rs`), and a workgroup a tile.
const THREADS: u32 = 64u / ROWS;

// A thread's pixels: first column and row within the tile, and within the image; the image's first pixel.
struct Block {
    corner: vec2<u32>,
    pixel: vec2<u32>,
    first: u32,
}

fn block_of(tile: u32, local: vec3<u32>) -> Block {
    let corner = vec2(local.x * 4u, local.y * ROWS);
    return Block(corner, corner_of(tile) + corner, tile / view.batch.y * (view.image.x * view.image.y));
}

// Whether the image has the pixel in row r and column n of a block.
fn is_inside(block: Block, r: u32, n: u32) -> bool {
    return block.pixel.y + r < view.image.y && block.pixel.x + n < view.image.x;
}

// Its index in the strip's buffers.
fn pixel_of(block: Block, r: u32, n: u32) -> u32 {
    return block.first + (block.pixel.y + r - view.window.z) * view.image.x + block.pixel.x + n;
}

// Whether a Gaussian's box within the tile misses the thread's pixels; most Gaussians cover only part of a tile.
fn misses(box: u32, block: Block) -> bool {
    let corner = block.corner;
    return (box & 15u) > corner.x + 3u || ((box >> 4u) & 15u) < corner.x
        || ((box >> 8u) & 15u) > corner.y + (ROWS - 1u) || ((box >> 12u) & 15u) < corner.y;
}

// `2^(−x)` for x ≥ 0, to 2 units in the last place down to 2^−20, below every alpha that is drawn.
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
    // Whitened distance from the centre: x per pixel, and y shared by the row.
    along: vec4<f32>,
    across: f32,
    value: vec4<f32>,
}

fn falloff_at(shape: vec4<f32>, position: vec4<u32>, block: Block, r: u32) -> Falloff {
    let offset = vec2(bitcast<f32>(position.x), bitcast<f32>(position.y));
    let dx = vec4(f32(i32(block.pixel.x) - i32(position.z & 0xffffu))) + vec4(0.0, 1.0, 2.0, 3.0) + offset.x;
    let dy = f32(i32(block.pixel.y + r) - i32(position.z >> 16u)) + offset.y;
    var f: Falloff;
    // Beyond 64 standard deviations the value no longer matters; clamping prevents overflow.
    f.along = clamp(shape.x * dx + shape.y * dy, vec4(-64.0), vec4(64.0));
    f.across = clamp(shape.z * dy, -64.0, 64.0);
    f.value = power_below(min(f.along * f.along + f.across * f.across, vec4(20.0)));
    return f;
}

// One Gaussian over a row of pixels: which take its colour, with what weight, and what light
// remains: `after` as computed, `transmittance` as it is kept, negated for finished pixels.
struct Layer {
    hit: vec4<bool>,
    weight: vec4<f32>,
    after: vec4<f32>,
    transmittance: vec4<f32>,
}

fn layer_of(alpha: vec4<f32>, before: vec4<f32>) -> Layer {
    let visible = alpha >= vec4(view.alphas.y);
    let product = alpha * before;
    let after = before - product;
    let open = after > vec4(view.alphas.z);
    let hit = visible & open;
    let weight = select(vec4(0.0), product, hit);
    return Layer(hit, weight, after, select(before, select(-abs(before), after, open), visible));
}

@group(0) @binding(1) var<storage, read> shapes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> positions: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> splat_colours: array<vec4<f32>>;
// Index of the pair, Gaussian.
@group(0) @binding(4) var<storage, read> pairs: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> boxes: array<u32>;
@group(0) @binding(6) var<storage, read> ranges: array<vec2<u32>>;

// The part of a tile's list for this dispatch. Software drivers abort loops after a limited number of iterations.
fn current_entries(list: vec2<u32>) -> vec2<u32> {
    let first = list.x + min(view.part.x, list.y - list.x);
    return vec2(first, first + min(view.part.y, list.y - first));
}

// Whether earlier dispatches finished the tile.
fn is_done(list: vec2<u32>) -> bool {
    return has(RESUMES) && list.y - list.x <= view.part.x;
}

// Whether the tile needs further dispatches.
fn continues(list: vec2<u32>) -> bool {
    return list.y - list.x > view.part.x && list.y - list.x - view.part.x > view.part.y;
}
