// Number of loop iterations that the driver allows. Each iteration depends on the one before.
struct Probe {
    max_iterations: u32,
    spare_a: u32,
    spare_b: u32,
    spare_c: u32,
}

@group(0) @binding(0) var<uniform> probe: Probe;
// Iterations iterations, and the resulting state.
@group(0) @binding(1) var<storage, read_write> result: array<u32>;

@compute @workgroup_size(1)
fn main() {
    var iterations = 0u;
    var state = 1u;
    while iterations < probe.max_iterations {
        state = state * 1664525u + 1013904223u;
        iterations += 1u;
    }
    result[0] = iterations;
    result[1] = state;
}
