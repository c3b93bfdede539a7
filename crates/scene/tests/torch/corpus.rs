//! Every input that the fuzz targets `torch_pickle` and `torch_chunk` keep, replayed.

use std::path::PathBuf;

use atsplat_scene::torch;

use crate::hostile::read_all;
use crate::support::shared;

fn inputs(target: &str) -> Vec<Vec<u8>> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let listed = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{error} ({})", folder.display()));
    let mut paths: Vec<PathBuf> = listed.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(!paths.is_empty(), "{target} has seeds");
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

#[test]
fn pickles_that_fuzzing_kept() {
    for bytes in inputs("torch_pickle") {
        torch::parse_pickle(&bytes).ok();
    }
}

#[test]
fn chunks_that_fuzzing_kept() {
    for bytes in inputs("torch_chunk") {
        read_all(shared(bytes)).ok();
    }
}
