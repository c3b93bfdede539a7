//! `.torch` files written by PyTorch, by this toolkit, and malformed ones.

#![expect(clippy::unwrap_used, clippy::panic, reason = "test helpers fail by panicking")]

mod chunks;
mod fixtures;
mod hostile;
mod long_keys;
mod support;

use std::path::Path;

/// Replays the corpus of a fuzz target.
fn replay(target: &str, parse: impl Fn(Vec<u8>)) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let listed = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{error} ({})", folder.display()));
    let inputs: Vec<_> = listed.map(|entry| std::fs::read(entry.unwrap().path()).unwrap()).collect();
    assert!(!inputs.is_empty(), "{target} has seeds");
    inputs.into_iter().for_each(parse);
}

#[test]
fn corpus_of_torch_pickle() {
    replay("torch_pickle", |bytes| drop(atsplat_scene::torch::parse_pickle(&bytes)));
}

#[test]
fn corpus_of_torch_chunk() {
    replay("torch_chunk", |bytes| drop(hostile::read_all(support::shared(bytes))));
}
