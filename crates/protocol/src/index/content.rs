//! The bytes that [`EvaluationIndex::content_hash`] hashes, all integers as 64-bit little-endian:
//!
//! `"atsplat evaluation index 1\n"`, then for every scene that has entries, sorted by the key's bytes: key
//! length, key, number of entries, and for each entry in order: number of context frames, those frames in
//! order (the first is the reference of relative poses), number of targets, those frames sorted (a repeated
//! target weighs twice and stays), and a byte 0, or a byte 1 and the overlap's IEEE 754 bits.

use sha2::{Digest, Sha256};

use super::{EvaluationIndex, Sha256Digest};

const MAGIC: &[u8] = b"atsplat evaluation index 1\n";

pub(super) fn hash(index: &EvaluationIndex) -> Sha256Digest {
    let mut scenes: Vec<_> = index.scenes.iter().filter(|(_, entries)| !entries.is_empty()).collect();
    scenes.sort_unstable_by_key(|(key, _)| *key);
    let mut hasher = Sha256::new_with_prefix(MAGIC);
    for (key, entries) in scenes {
        length(&mut hasher, key.len());
        hasher.update(key);
        length(&mut hasher, entries.len());
        for entry in entries {
            frames(&mut hasher, &entry.context);
            let mut target = entry.target.clone();
            target.sort_unstable();
            frames(&mut hasher, &target);
            match entry.overlap {
                None => hasher.update([0]),
                Some(overlap) => {
                    hasher.update([1]);
                    // `+ 0.0` turns the negative zero into the positive one.
                    hasher.update((overlap + 0.0).to_le_bytes());
                }
            }
        }
    }
    Sha256Digest::finish(hasher)
}

fn frames(hasher: &mut Sha256, frames: &[usize]) {
    length(hasher, frames.len());
    for frame in frames {
        length(hasher, *frame);
    }
}

fn length(hasher: &mut Sha256, value: usize) {
    hasher.update((value as u64).to_le_bytes());
}

#[cfg(test)]
mod tests {
    use crate::EvaluationIndex;

    fn hash(json: &str) -> String {
        EvaluationIndex::from_json(json.as_bytes()).unwrap().content_hash().to_string()
    }

    const BASE: &str = r#"{"b": {"context": [1, 9], "target": [3, 2], "overlap": 0.25}, "a": null, "c": {"context": [0], "target": []}}"#;

    /// Computed by `tests/fixtures/content_hash.py`, which builds the same bytes with `struct.pack`.
    #[test]
    fn equals_the_independent_computation() {
        let expected = include_str!("../../tests/fixtures/content_hash.txt");
        let (_, expected) = expected.trim_end().rsplit_once(' ').unwrap();
        assert_eq!(hash(BASE), expected);
    }

    #[test]
    fn what_the_file_looks_like_does_not_matter() {
        for same in [
            r#"{"c":[{"target":[],"context":[0]}],"b":{"overlap":2.5e-1,"target":[2,3],"context":[1,9]}}"#,
            r#"{"b": [{"context": [1, 9], "target": [2, 3], "overlap": 0.25}], "c": {"context": [0], "target": []}, "z": []}"#,
        ] {
            assert_eq!(hash(same), hash(BASE), "{same}");
        }
    }

    #[test]
    fn what_is_asked_does_matter() {
        let changes = [
            ("[1, 9]", "[9, 1]"),
            ("[1, 9]", "[1, 10]"),
            ("[3, 2]", "[3, 2, 2]"),
            ("[3, 2]", "[3]"),
            ("0.25", "0.26"),
            (", \"overlap\": 0.25", ""),
            ("\"b\"", "\"bb\""),
            ("null", r#"{"context": [0], "target": []}"#),
        ];
        for (from, to) in changes {
            let changed = BASE.replace(from, to);
            assert_ne!(changed, BASE, "the change {from} to {to} applies");
            assert_ne!(hash(&changed), hash(BASE), "{changed}");
        }
    }
}
