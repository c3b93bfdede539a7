use std::collections::BTreeSet;

use atsplat_files::{Sha256Digest, is_toml_path};
use serde::Serialize;

use super::foreign_entries::ForeignEntries;
use super::read::value_of_word;
use crate::samplers::{PairTargets, Sampler};
use crate::{EvaluationIndex, IndexEntry, IndexNotices, KnownIndex, Preset, SamplingRule};

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
pub(super) type Rule<'a> = (&'a str, &'a dyn Fn(&IndexEntry) -> Option<String>);

/// On which side of the window the targets of a protocol lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TargetSide {
    Inside,
    Outside,
}

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
        rules.iter().filter_map(|rule| of_rule(index, rule)).collect()
    }

    /// Entries of `index`, which is none of the preset's own, whose targets are all context frames, or on the other side of the
    /// window than those of the preset: any of them inside under a protocol of targets outside, all of them outside under one of
    /// targets inside. A preset states a side by its derivation, by a built-in sampling rule or by the preset that it stands for.
    pub fn misplaced_targets(&self, index: &EvaluationIndex) -> Vec<IndexMismatch> {
        let side = self.target_side();
        let kinds = [ForeignEntries::TargetsInside, ForeignEntries::TargetsOutside, ForeignEntries::TargetsAreInputs];
        let [inside, outside, inputs] = kinds.map(|kind| kind.to_string());
        let rules: [Rule<'_>; 3] = [
            (&inside, &|entry| {
                let is_inside = |frame: &&usize| entry.frames_outside_window(**frame) == Some(0);
                let found = entry.target.iter().find(is_inside).filter(|_| side == Some(TargetSide::Outside))?;
                let (first, last) = entry.window()?;
                Some(format!("field target: expected frames before {first} and after {last}, found {found}"))
            }),
            (&outside, &|entry| {
                let is_outside =
                    |frame: &usize| entry.frames_outside_window(*frame).is_some_and(|distance| distance != 0);
                let found = entry.target.first().filter(|_| side == Some(TargetSide::Inside))?;
                // No frame is inside the window of a single view.
                let (first, last) = entry.window().filter(|(first, last)| first < last)?;
                let wrong = entry.target.iter().all(is_outside);
                wrong.then(|| format!("field target: expected frames from {first} to {last}, found {found}"))
            }),
            (&inputs, &|entry| {
                let found = entry.target.first()?;
                let wrong = entry.target.iter().all(|frame| entry.is_context(*frame));
                wrong.then(|| format!("field target: expected a frame that is no context frame, found {found}"))
            }),
        ];
        rules.iter().filter_map(|rule| of_rule(index, rule)).collect()
    }

    /// Entries of `index`, which is none of the preset's own, with fewer or more targets than those of each file that the preset
    /// accepts. Those without a target are among [`Self::unfit_entries`].
    pub fn unusual_target_counts(&self, index: &EvaluationIndex) -> Option<IndexMismatch> {
        let usual = self.index.target_counts();
        let range = |(fewest, most): &(usize, usize)| {
            if fewest == most { fewest.to_string() } else { format!("{fewest} to {most}") }
        };
        let expected = usual.iter().map(range).collect::<Vec<_>>().join(" or ");
        let kind = format!("entries without the preset's {expected} targets");
        let wrong = |entry: &IndexEntry| {
            let found = entry.target.len();
            let is_usual = found == 0 || usual.iter().any(|(fewest, most)| (*fewest..=*most).contains(&found));
            (!is_usual).then(|| format!("field target: expected {expected} frames, found {found}"))
        };
        let rule: Rule<'_> = (&kind, &wrong);
        of_rule(index, &rule)
    }

    /// The side on which all targets lie, if the preset states one.
    fn target_side(&self) -> Option<TargetSide> {
        if self.index.derivation.is_some() {
            return Some(TargetSide::Outside);
        }
        if let Some(published) = self.stands_for.as_deref().and_then(|name| Self::named(name).ok()) {
            return published.target_side();
        }
        let built_in = self.index.sampler.as_deref().filter(|sampler| !is_toml_path(sampler))?;
        match SamplingRule::resolve(built_in).ok()?.sampler {
            Sampler::OverlapPairs(pairs) => Some(match pairs.targets {
                PairTargets::Inside { .. } => TargetSide::Inside,
                PairTargets::Outside { .. } => TargetSide::Outside,
            }),
            _ => None,
        }
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

/// The entries that a rule is about, with the first as the example; `None` if there is none.
pub(super) fn of_rule(index: &EvaluationIndex, (kind, wrong): &Rule<'_>) -> Option<IndexMismatch> {
    let mut found = index.entries().filter_map(|(scene, at, entry)| Some((scene, at, wrong(entry)?)));
    let (scene, at, what) = found.next()?;
    let example = format!("scene {scene}, entry {at}, {what}");
    Some(IndexMismatch { kind: (*kind).to_owned(), count: 1 + found.count() as u64, example })
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

    /// Frames that `MVSplat360` renders, but does not score.
    pub fn unscored_targets_mismatch(&self) -> Option<IndexMismatch> {
        (self.unscored_targets > 0).then(|| IndexMismatch {
            kind: "frames of the field target that are no targets".to_owned(),
            count: self.unscored_targets,
            example: "the field target_quantify lists those to score".to_owned(),
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

    fn texts(found: impl IntoIterator<Item = IndexMismatch>) -> Vec<(u64, String)> {
        found.into_iter().map(|found| (found.count, format!("{}: {}", found.kind, found.example))).collect()
    }

    /// The first entry has a target on either side of its window, the second all before it, the third all inside.
    #[test]
    fn targets_on_the_wrong_side_of_the_window_are_counted() {
        let json = br#"{"mixed": {"context": [4, 9], "target": [3, 6, 12]},
                        "before": {"context": [9, 5], "target": [1, 4, 2]},
                        "within": [{"context": [4, 9], "target": [5, 6, 7]}, {"context": [9], "target": [2]}]}"#;
        let index = EvaluationIndex::from_json(json).unwrap();
        let of = |preset: &str| texts(Preset::named(preset).unwrap().misplaced_targets(&index));
        let extrapolated = (
            2,
            format!(
                "{}: scene mixed, entry 0, field target: expected frames before 4 and after 9, found 6",
                ForeignEntries::TargetsInside
            ),
        );
        for preset in
            ["re10k-extrapolation", "dl3dv-6v-extrapolation", "rooms-extrapolation-128", "yards-6v-extrapolation"]
        {
            assert_eq!(of(preset), std::slice::from_ref(&extrapolated), "{preset}");
        }
        let interpolated = (
            1,
            format!(
                "{}: scene before, entry 0, field target: expected frames from 5 to 9, found 1",
                ForeignEntries::TargetsOutside
            ),
        );
        for preset in ["re10k-2v-256", "acid-2v-256", "rooms-2v-64"] {
            assert_eq!(of(preset), std::slice::from_ref(&interpolated), "{preset}");
        }
        for preset in ["dl3dv-2v-256x448", "re10k-overlap", "photos-3v-256"] {
            assert_eq!(of(preset), [], "{preset}: published targets are on both sides, or no side is stated");
        }
        let mut own = Preset::named("re10k-extrapolation").unwrap();
        own.index.sampler = Some("mine.toml".to_owned());
        assert_eq!(own.misplaced_targets(&index), [], "a file is not read");
    }

    /// Published indices have some targets that are context frames.
    #[test]
    fn entries_whose_targets_are_all_context_frames_are_counted() {
        let json = br#"{"some": {"context": [5, 70], "target": [5, 6, 70]}, "none": {"context": [5, 70], "target": []},
                        "all": {"context": [5, 70], "target": [70, 5]}}"#;
        let index = EvaluationIndex::from_json(json).unwrap();
        let preset = Preset::named("dl3dv-2v-256x448").unwrap();
        let what = "expected a frame that is no context frame, found 70";
        let expected = (1, format!("{}: scene all, entry 0, field target: {what}", ForeignEntries::TargetsAreInputs));
        assert_eq!(texts(preset.misplaced_targets(&index)), [expected]);
    }

    #[test]
    fn entries_with_another_number_of_targets_are_counted() {
        let entry = |targets: usize| {
            let target: Vec<usize> = (1..=targets).collect();
            format!(r#"{{"context": [0, 200], "target": {target:?}}}"#)
        };
        let json = format!(
            r#"{{"a": {}, "b": [{}, {}], "c": {}, "d": {}}}"#,
            entry(3),
            entry(2),
            entry(0),
            entry(4),
            entry(90)
        );
        let index = EvaluationIndex::from_json(json.as_bytes()).unwrap();
        let of = |preset: &str| texts(Preset::named(preset).unwrap().unusual_target_counts(&index));
        let three =
            "entries without the preset's 3 targets: scene b, entry 0, field target: expected 3 frames, found 2";
        assert_eq!(of("rooms-2v-128"), [(3, three.to_owned())]);
        for (preset, expected) in [("dl3dv-12v-512x960", "87 to 100 or 8"), ("re10k-to-dl3dv-256", "50 or 4")] {
            let kind = format!("entries without the preset's {expected} targets");
            let text = format!("{kind}: scene a, entry 0, field target: expected {expected} frames, found 3");
            assert_eq!(of(preset), [(3, text)], "a part of the second accepted file has the targets of that file");
        }
        let derived =
            "entries without the preset's 20 targets: scene a, entry 0, field target: expected 20 frames, found 3";
        assert_eq!(of("dl3dv-6v-extrapolation"), [(4, derived.to_owned())]);
    }

    /// Embedded indices are those of their presets, and stay so under other hashes.
    #[test]
    fn embedded_indices_have_the_targets_of_their_presets() {
        for preset in Preset::names().map(|name| Preset::named(name).unwrap()) {
            for accepted in &preset.index.accepted {
                let Some(file) = IndexFile::embedded(&accepted.name) else { continue };
                let index = file.unwrap().index;
                assert_eq!(preset.misplaced_targets(&index), [], "{}", preset.name);
                assert_eq!(preset.unusual_target_counts(&index), None, "{}", preset.name);
            }
        }
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
