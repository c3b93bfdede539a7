//! `.torch` files written by PyTorch, by this toolkit, and malformed ones.

#![expect(clippy::unwrap_used, clippy::panic, reason = "test helpers fail by panicking")]

mod chunks;
mod fixtures;
mod frame_numbers;
mod hostile;
mod long_keys;
mod partial_index;
mod support;

use std::path::Path;

use atsplat_scene::torch::{Dict, Value, parse_pickle};

/// Replays the corpus of a fuzz target, which contains valid and invalid inputs.
fn replay(target: &str, accepts: impl Fn(Vec<u8>) -> bool) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let listed = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{error} ({})", folder.display()));
    let inputs: Vec<_> = listed.map(|entry| std::fs::read(entry.unwrap().path()).unwrap()).collect();
    let count = inputs.len();
    let accepted = inputs.into_iter().map(accepts).filter(|accepted| *accepted).count();
    assert!(accepted >= 2 && accepted < count, "{target}: {accepted} of {count} accepted");
}

/// Reads the tensors along every path, a bounded number of them: a hostile pickle shares parts.
fn read_tensors(value: &Value, steps: &mut usize) {
    if *steps == 0 {
        return;
    }
    *steps -= 1;
    for part in value.as_sequence().unwrap_or_default() {
        read_tensors(part, steps);
    }
    for (_, part) in value.as_dict().into_iter().flat_map(Dict::iter) {
        read_tensors(part, steps);
    }
    if let Some(tensor) = value.as_tensor() {
        tensor.to_bytes().ok();
    }
}

#[test]
fn corpus_of_torch_pickle() {
    replay("torch_pickle", |bytes| {
        let value = parse_pickle(&bytes);
        value.is_ok_and(|value| {
            read_tensors(&value, &mut 10_000);
            true
        })
    });
}

#[test]
fn corpus_of_torch_chunk() {
    replay("torch_chunk", |bytes| hostile::read_all(support::shared(bytes)).is_ok());
}
