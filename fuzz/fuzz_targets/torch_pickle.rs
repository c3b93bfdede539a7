//! Any bytes as a pickle: a value or an error.
#![no_main]

use atsplat_scene::torch::{Value, parse_pickle};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(value) = parse_pickle(bytes) {
        let mut steps = 10_000;
        walk(&value, &mut steps);
    }
});

/// Visits objects along every path, a bounded number of them: a hostile pickle shares parts.
fn walk(value: &Value, steps: &mut usize) {
    if *steps == 0 {
        return;
    }
    *steps -= 1;
    for part in value.as_sequence().unwrap_or_default() {
        walk(part, steps);
    }
    for (_, part) in value.as_dict().into_iter().flat_map(|dict| dict.iter()) {
        walk(part, steps);
    }
    if let Some(tensor) = value.as_tensor() {
        tensor.to_bytes().ok();
    }
}
