// Tiles of 16×16 pixels of the window that a Gaussian may reach: first column and row, past them.
fn tiles_of(reach: vec2<u32>) -> vec4<u32> {
    if reach.y == 0u {
        return vec4(0u);
    }
    let low = view.tiles.xy;
    let high = view.tiles.xy + view.tiles.zw;
    let first = clamp(vec2(reach.x & 0xffffu, reach.y & 0xffffu) / 16u, low, high);
    let past = clamp((vec2(reach.x >> 16u, reach.y >> 16u) + 15u) / 16u, low, high);
    return vec4(first, past);
}
