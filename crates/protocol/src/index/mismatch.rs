use std::collections::BTreeSet;

use atsplat_files::Sha256Digest;
use serde::Serialize;

use super::read::value_of_word;
use crate::{EvaluationIndex, IndexEntry, IndexNotices, KnownIndex, Preset};

/// A way in which an index does not fit the preset that it is run under. Its trials still run, but their numbers belong
/// to a different protocol than the preset's name suggests.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct IndexMismatch {
    /// What is wrong, without details.
    pub kind: String,
    /// Number of affected entries.
    pub count: u64,
    /// The first of them: scene, entry, field, expected and found.
    pub example: String,
}

/// A kind of mismatch, and a check that describes what is wrong with an entry.
type Rule<'a> = (&'a str, &'a dyn Fn(&IndexEntry) -> Option<String>);

impl Preset {
    /// How `index` does not fit this preset: [`Self::foreign_index`] and [`Self::unfit_entries`]. `sha256` is the file's.
    pub fn mismatches(&self, index: &EvaluationIndex, sha256: &Sha256Digest) -> Vec<IndexMismatch> {
        self.foreign_index(index, sha256).into_iter().chain(self.unfit_entries(index)).collect()
    }

    /// Entries of `index` with a wrong number of context views, without targets, with repeated frames, or without an overlap where
    /// the preset bins by it.
    pub fn unfit_entries(&self, index: &EvaluationIndex) -> Vec<IndexMismatch> {
        let views = self.index.context_views;
        let has_bins = self.overlap_bins.is_some();
        let context_kind = format!("entries without the preset's {views} context views");
        let rules: [Rule<'_>; 5] = [
            (&context_kind, &|entry| {
                let found = entry.context.len();
                (found != views).then(|| format!("field context: expected {views} frames, found {found}"))
            }),
            ("entries without targets", &|entry| {
                entry.target.is_empty().then(|| "field target: expected at least one frame, found none".to_owned())
            }),
            ("entries without an overlap, which are in no bin of the preset", &|entry| {
                let missing = has_bins && entry.overlap.is_none();
                missing.then(|| "field overlap: expected a number, found none".to_owned())
            }),
            ("entries with a context frame twice", &|entry| twice("context", &entry.context)),
            ("entries with a target twice", &|entry| twice("target", &entry.target)),
        ];
        let of_rule = |(kind, wrong): &Rule<'_>| {
            let mut found = index.entries().filter_map(|(scene, at, entry)| Some((scene, at, wrong(entry)?)));
            let (scene, at, what) = found.next()?;
            let example = format!("scene {scene}, entry {at}, {what}");
            Some(IndexMismatch { kind: (*kind).to_owned(), count: 1 + found.count() as u64, example })
        };
        rules.iter().filter_map(of_rule).collect()
    }

    /// A published file that belongs to another dataset or protocol, with the number of its entries. It is recognised by hash,
    /// whatever its path: `index` is all of it, whichever scenes the data have, and `sha256` is the file's.
    pub fn foreign_index(&self, index: &EvaluationIndex, sha256: &Sha256Digest) -> Option<IndexMismatch> {
        let known = KnownIndex::by_sha256(sha256).or_else(|| KnownIndex::by_content(&index.content_hash()))?;
        if self.index.accepted.iter().any(|accepted| accepted.sha256 == known.sha256) {
            return None;
        }
        let count = index.entries().count() as u64;
        let example = format!("{} of {} ({})", known.name, known.dataset, known.repository);
        let kind = if known.dataset == self.dataset {
            "entries of an index that belongs to another protocol".to_owned()
        } else {
            format!("entries of another dataset's index: expected one of {}", self.dataset)
        };
        Some(IndexMismatch { kind, count, example })
    }
}

impl IndexNotices {
    /// Fields that the format does not define.
    pub fn unknown_fields_mismatch(&self) -> Option<IndexMismatch> {
        let (name, count) = self.unknown_fields.first_key_value()?;
        Some(IndexMismatch {
            kind: "fields that the index format does not define".to_owned(),
            count: self.unknown_fields.values().sum(),
            example: format!("{name}, {count} times"),
        })
    }

    /// Overlaps given as words; the numbers substituted for them are not measurements.
    pub fn overlap_words_mismatch(&self) -> Option<IndexMismatch> {
        let word = self.first_overlap_word.as_deref()?;
        Some(IndexMismatch {
            kind: "overlaps given as words, replaced by the numbers that NoPoSplat uses for them".to_owned(),
            count: self.overlap_words,
            example: format!("the first is {word:?}, read as {}", value_of_word(word)),
        })
    }
}

fn twice(field: &str, frames: &[usize]) -> Option<String> {
    let mut seen = BTreeSet::new();
    let repeated = frames.iter().find(|frame| !seen.insert(**frame))?;
    Some(format!("field {field}: expected every frame once, found frame {repeated} again"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::IndexFile;

    fn mismatches(preset: &str, json: &str) -> Vec<(u64, String)> {
        let index = EvaluationIndex::from_json(json.as_bytes()).unwrap();
        let sha256 = Sha256Digest::of(json.as_bytes());
        let unknown = IndexFile::parse(json.as_bytes()).unwrap().notices.unknown_fields_mismatch();
        let found = Preset::named(preset).unwrap().mismatches(&index, &sha256);
        found
            .into_iter()
            .chain(unknown)
            .map(|mismatch| (mismatch.count, format!("{}: {}", mismatch.kind, mismatch.example)))
            .collect()
    }

    #[test]
    fn counts_entries_that_do_not_fit_with_scene_and_field() {
        let json = r#"{"ok": {"context": [0, 9], "target": [3, 3]},
                       "three": {"context": [0, 5, 9], "target": [3]},
                       "none": {"context": [0, 9], "target": []},
                       "one": [{"context": [4, 4], "target": [3]}, {"context": [4], "target": [3, 7, 3]}],
                       "null": null}"#;
        let expected = [
            (
                2,
                "entries without the preset's 2 context views: scene three, entry 0, field context: expected 2 frames, found 3",
            ),
            (1, "entries without targets: scene none, entry 0, field target: expected at least one frame, found none"),
            (
                1,
                "entries with a context frame twice: scene one, entry 0, field context: expected every frame once, found frame 4 again",
            ),
            (
                2,
                "entries with a target twice: scene ok, entry 0, field target: expected every frame once, found frame 3 again",
            ),
        ];
        assert_eq!(mismatches("re10k-2v-256", json), expected.map(|(count, text)| (count, text.to_owned())));
        assert_eq!(mismatches("re10k-2v-256", r#"{"ok": {"context": [0, 9], "target": [3]}}"#), []);
    }

    #[test]
    fn entries_without_their_overlap_and_misspelt_fields_are_counted() {
        let json = r#"{"a": {"context": [0, 9], "target": [3, 4, 5], "overlapp": 0.4},
                       "b": {"context": [0, 9], "target": [3, 4, 5], "overlap": 0.4},
                       "c": {"context": [0, 9], "target": [3, 4, 5], "overlapp": 0.2, "zoom": 1}}"#;
        let found = mismatches("re10k-overlap", json);
        let expected = [
            (
                2,
                "entries without an overlap, which are in no bin of the preset: scene a, entry 0, field overlap: expected a number, found none",
            ),
            (3, "fields that the index format does not define: overlapp, 2 times"),
        ];
        assert_eq!(found, expected.map(|(count, text)| (count, text.to_owned())));
    }

    /// Published files are recognised by their hash alone.
    #[test]
    fn recognises_published_files_of_other_protocols() {
        let index = EvaluationIndex::from_json(br#"{"ok": {"context": [0, 9], "target": [3]}}"#).unwrap();
        let preset = Preset::named("re10k-2v-256").unwrap();
        let of = |name: &str| preset.mismatches(&index, &KnownIndex::by_name(name).unwrap().sha256);
        assert_eq!(of("pixelsplat-re10k"), []);
        let acid = of("pixelsplat-acid");
        assert!(acid[0].kind.contains("another dataset's index") && acid[0].example.contains("acid"), "{acid:?}");
        let other = of("noposplat-re10k");
        assert!(other[0].kind.contains("another protocol") && other[0].count == 1, "{other:?}");
    }
}
