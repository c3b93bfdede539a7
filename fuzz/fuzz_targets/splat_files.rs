//! Any bytes as a file of Gaussians: Gaussians whose every value can be read, or a typed error. What has no known
//! first bytes is taken for a `.splat`.
#![no_main]

use std::hint::black_box;
use std::path::Path;

use atsplat_splat::Cleaning;
use atsplat_splat::files::parse;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok((gaussians, import)) = parse(bytes, Path::new("fuzz.splat")) else { return };
    assert_eq!(gaussians.len() + import.validation.rejected, import.validation.total);
    let (clean, _) = gaussians.cleaned(Cleaning::Repair);
    assert!(clean.validate().is_clean());
    black_box(clean.bounds_of_means());
});
