//! Replays the inputs of the fuzz target `splat_files` without a fuzzer: each gives Gaussians or a typed error, and
//! never a panic.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use atsplat_splat::Cleaning;
use atsplat_splat::files::parse;

fn inputs(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz").join(folder).join("splat_files");
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut inputs: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    inputs.sort();
    inputs
}

fn accepts(path: &Path) -> bool {
    let bytes = std::fs::read(path).unwrap();
    let Ok((gaussians, import)) = parse(&bytes, Path::new("fuzz.splat")) else { return false };
    assert_eq!(gaussians.len() + import.validation.rejected, import.validation.total, "{}", path.display());
    assert!(gaussians.cleaned(Cleaning::Repair).0.validate().is_clean(), "{}", path.display());
    true
}

#[test]
fn splat_files() {
    let seeds = inputs("corpus");
    let accepted = seeds.iter().filter(|path| accepts(path)).count();
    let refused = seeds.len() - accepted;
    assert!(accepted >= 15 && refused >= 8, "{accepted} accepted, {refused} refused");
    for path in inputs("regressions") {
        accepts(&path);
    }
}
