//! Long keys that a file refers to again and again: reading them takes time in proportion to the file.

use crate::hostile::malformed;
use crate::support::{pickle, saved, text};
use atsplat_scene::torch::{self, Chunk};
use atsplat_scene::{WarningKind, Warnings};

/// Each reference of two bytes would have the key hashed again, in one dict or in many.
#[test]
fn a_long_key_of_many_entries_is_an_error() {
    let key = text(&"k".repeat(100_000));
    let entries = |count: usize| [&b"]"[..], &key, b"q\x000", &b"}h\x00Nsa".repeat(count)].concat();
    let one_dict = |count: usize| [&b"}"[..], &key, b"q\x000(", &b"h\x00N".repeat(count), b"u"].concat();
    let parsed = |body: Vec<u8>| torch::parse_pickle(&pickle(&body));
    assert_eq!(parsed(entries(40)).unwrap().as_sequence().unwrap().len(), 40);
    assert_eq!(parsed(one_dict(40)).unwrap().as_dict().unwrap().len(), 1);
    for body in [entries(20_000), one_dict(20_000)] {
        let message = malformed(parsed(body));
        assert!(message.starts_with("dict keys: ") && message.contains("used repeatedly"), "{message}");
        assert!(message.len() < 300, "{message}");
    }
    // An optimiser's state: many dicts with a few short keys.
    let state = [&b"]"[..], &text("exp_avg_sq"), b"q\x000", &b"}h\x00Nsa".repeat(20_000)].concat();
    assert_eq!(parsed(state).unwrap().as_sequence().unwrap().len(), 20_000);
}

/// One scene, whose key is long, a hundred thousand times.
#[test]
fn a_chunk_of_references_to_one_scene_holds_it_once() {
    let scene = [b"}", &text("key")[..], &text(&"k".repeat(100_000)), b"s"].concat();
    let body = [b"](", &scene[..], b"q\x00", &b"h\x00".repeat(100_000), b"e"].concat();
    let mut warnings = Warnings::new();
    let chunk = Chunk::from_bytes(saved(&pickle(&body), b""), "x.torch".as_ref(), &mut warnings).unwrap();
    assert_eq!((chunk.keys().len(), warnings.count(WarningKind::DuplicateScene)), (1, 100_000));
}
