// Both halves of a prefix sum: blocks of 2048 numbers, sums that do not fit u32 at their largest.
struct Scan {
    count: u32,
    blocks: u32,
    is_last: u32,
}

@group(0) @binding(0) var<uniform> scan: Scan;

fn saturating(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}
