// Shared by both kernels of the exclusive prefix sum: blocks of 2048 numbers, saturating at the largest u32.

// How many numbers this level has.
fn length() -> u32 {
    var length = items();
    if work.is_table != 0u {
        length = 256u * sort_blocks();
    }
    for (var level = 0u; level < work.level; level++) {
        length = blocks_of(length);
    }
    return length;
}

fn blocks_of(length: u32) -> u32 {
    return length / 2048u + select(0u, 1u, (length & 2047u) != 0u);
}

fn saturating(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}
