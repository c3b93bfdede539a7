// Shared by both kernels of a radix-sort pass.
struct Pass {
    count: u32,
    runs: u32,
    shift: u32,
}

@group(0) @binding(0) var<uniform> pass_: Pass;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
