// How many turns of a loop the driver allows. Each turn depends on the one before.
struct Probe {
    wanted: u32,
    spare_a: u32,
    spare_b: u32,
    spare_c: u32,
}

@group(0) @binding(0) var<uniform> probe: Probe;
// Turns made, and what they led to.
@group(0) @binding(1) var<storage, read_write> result: array<u32>;

@compute @workgroup_size(1)
fn main() {
    var made = 0u;
    var state = 1u;
    while made < probe.wanted {
        state = state * 1664525u + 1013904223u;
        made += 1u;
    }
    result[0] = made;
    result[1] = state;
}
