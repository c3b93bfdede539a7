// First column and row of a tile within its image, by its index in the window.
fn corner_of(tile: u32) -> vec2<u32> {
    let own = tile % view.batch.y;
    return 16u * (view.tiles.xy + vec2(own % view.tiles.z, own / view.tiles.z));
}

// The window's tiles, of all images.
fn all_tiles() -> u32 {
    return view.tiles.z * view.tiles.w * view.batch.z;
}

// The window's tiles of 16×16 pixels that a Gaussian may reach: first column and row, and the end of both.
fn tiles_of(reach: vec2<u32>) -> vec4<u32> {
    if reach.y == 0u {
        return vec4(0u);
    }
    let low = view.tiles.xy;
    let high = view.tiles.xy + view.tiles.zw;
    let first = clamp(vec2(reach.x & 0xffffu, reach.y & 0xffffu) / 16u, low, high);
    let end = clamp((vec2(reach.x >> 16u, reach.y >> 16u) + 15u) / 16u, low, high);
    return vec4(first, end);
}
