// Tiles with their Gaussians, nearest first.
@group(0) @binding(1) var<storage, read> shapes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> paints: array<vec4<f32>>;
// Number of the pair, Gaussian.
@group(0) @binding(4) var<storage, read> pairs: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> boxes: array<u32>;
@group(0) @binding(6) var<storage, read> ranges: array<vec2<u32>>;

// The part of a tile's list that is passed over now. Drivers on processors end a kernel's loops after so many turns.
fn entries_now(list: vec2<u32>) -> vec2<u32> {
    let first = list.x + min(view.part.x, list.y - list.x);
    return vec2(first, first + min(view.part.y, list.y - first));
}
