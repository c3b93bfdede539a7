// Shared by both kernels of the exclusive prefix sum: blocks of 2048 numbers, saturating at the largest u32.
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
