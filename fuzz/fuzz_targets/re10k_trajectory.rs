#![no_main]

use std::path::Path;

use atsplat_scene::re10k::{parse_trajectory, write_trajectory};
use libfuzzer_sys::fuzz_target;

// Whatever parses is written and read back to the same rows.
fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("fuzz.txt");
    let Ok(mut trajectory) = parse_trajectory(bytes, path) else { return };
    trajectory.header = None;
    let mut text = Vec::new();
    write_trajectory(&trajectory, &mut text).expect("a trajectory without header can be written");
    assert_eq!(parse_trajectory(&text, path).expect("what was written can be read"), trajectory);
});
