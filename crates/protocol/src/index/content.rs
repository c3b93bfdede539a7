//! The bytes that [`EvaluationIndex::content_hash`] hashes, with all integers as 64-bit little-endian:
//!
//! `"atsplat evaluation index 1\n"`, then for every scene that has entries, sorted by the key's bytes: key
//! length, key, number of entries, and for each entry in order: number of context frames, those frames in
//! order (the first is the reference of relative poses), number of targets, those frames sorted (repeated
//! targets are kept, because they weigh twice), and a byte 0 without an overlap, or a byte 1 and the overlap's
//! IEEE 754 bits; if the index records its estimator, a byte 2, those bits, the length of the estimator's name and the
//! name.

use atsplat_files::Sha256Digest;
use sha2::{Digest, Sha256};

use super::{EvaluationIndex, IndexEntry, Overlap};

pub(super) fn hash(index: &EvaluationIndex) -> Sha256Digest {
    let mut scenes: Vec<_> = index.scenes.iter().filter(|(_, entries)| !entries.is_empty()).collect();
    scenes.sort_unstable_by_key(|(key, _)| *key);
    let mut hasher = Sha256::new_with_prefix(b"atsplat evaluation index 1\n");
    for (key, entries) in scenes {
        length(&mut hasher, key.len());
        hasher.update(key);
        length(&mut hasher, entries.len());
        for each in entries {
            entry(&mut hasher, each);
        }
    }
    Sha256Digest::finish(hasher)
}

fn entry(hasher: &mut Sha256, entry: &IndexEntry) {
    frames(hasher, &entry.context);
    let mut target = entry.target.clone();
    target.sort_unstable();
    frames(hasher, &target);
    match &entry.overlap {
        None => hasher.update([0]),
        Some(Overlap { value, estimator }) => {
            hasher.update([if estimator.is_some() { 2 } else { 1 }]);
            // `+ 0.0` turns negative zero into positive zero.
            hasher.update((value + 0.0).to_le_bytes());
            if let Some(name) = estimator {
                length(hasher, name.len());
                hasher.update(name);
            }
        }
    }
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
    fn agrees_with_the_independent_python_computation() {
        let expected = include_str!("../../tests/fixtures/content_hash.txt");
        let expected = expected.lines().next().and_then(|line| line.split(' ').next_back()).unwrap();
        assert_eq!(hash(BASE), expected);
    }

    #[test]
    fn ignores_the_layout_of_the_file() {
        for same in [
            r#"{"c":[{"target":[],"context":[0]}],"b":{"overlap":2.5e-1,"target":[2,3],"context":[1,9]}}"#,
            r#"{"b": [{"context": [1, 9], "target": [2, 3], "overlap": 0.25}], "c": {"context": [0], "target": []}, "z": []}"#,
        ] {
            assert_eq!(hash(same), hash(BASE), "{same}");
        }
    }

    #[test]
    fn zero_has_no_sign() {
        let [zero, negative] = ["0.0", "-0.0"].map(|zero| BASE.replace("0.25", zero));
        assert_eq!(hash(&negative), hash(&zero));
    }

    #[test]
    fn depends_on_every_part_of_the_content() {
        let changes = [
            ("[1, 9]", "[9, 1]"),
            ("[1, 9]", "[1, 10]"),
            ("[3, 2]", "[3, 2, 2]"),
            ("[3, 2]", "[3]"),
            ("0.25", "0.26"),
            (", \"overlap\": 0.25", ""),
            ("0.25", "0.25, \"overlap_estimator\": \"epipolar-ray\""),
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
