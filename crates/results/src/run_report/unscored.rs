//! What has no score, grouped by reason.

use std::collections::BTreeMap;

use atsplat_numeric::{counted, noun};
use serde::Serialize;

use super::metric_name;
use crate::rows::ADDED_LATER;
use crate::{IDENTICAL, Results, SkippedEntry, TargetRow, TargetStatus, TrialRow, WEIGHTS_ABSENT};

/// Entries, trials or targets without a score, or without one of them, for one reason.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Unscored {
    pub(super) preset: String,
    pub(super) what: String,
    pub(super) count: usize,
    /// The count and what is counted.
    #[serde(skip)]
    pub(super) text: String,
    /// The first of them.
    pub(super) example: String,
}

/// One entry, trial or target.
struct Case<'a> {
    preset: &'a str,
    /// `entry`, `trial` or `target`.
    noun: &'static str,
    /// What happened to it, after the noun.
    what: String,
    /// The kind of reason, by which cases are grouped ([`kind_of`]).
    kind: String,
    example: String,
}

/// Entries and targets without scores, and compared targets that lack a metric, with the first of each kind. Metrics without
/// weights are not among them.
pub(super) fn unscored(results: &Results) -> Vec<Unscored> {
    let skipped = results.provenance.skipped.iter().map(Case::skipped);
    let not_applicable = results.unsupported_trials().map(Case::not_applicable);
    let unsupported = results.unsupported_keys();
    let failed = results.targets.iter().filter(|row| row.status == TargetStatus::Failed);
    let failed = failed.filter(|row| !unsupported.contains(&row.key)).map(Case::failed);
    let metrics = &results.provenance.metrics;
    let has_weights = |id: &str| metrics.iter().all(|metric| metric.id != id || metric.absent.is_none());
    let compared = results.targets.iter().filter(|row| row.status == TargetStatus::Scored);
    let added_later = compared.clone().flat_map(|row| {
        let lacking = metrics.iter().filter(move |metric| row.lacks(metric));
        lacking.map(move |metric| Case::lacking(row, &metric.id, ADDED_LATER))
    });
    let lacking = compared.flat_map(|row| row.not_computed.iter().map(move |(id, why)| (row, id, why)));
    let lacking = lacking.filter(|(_, id, why)| has_weights(id) && *why != WEIGHTS_ABSENT);
    let lacking = lacking.map(|(row, id, why)| Case::lacking(row, id, why)).chain(added_later);
    let mut kinds: BTreeMap<(&str, &str, String, String), (usize, String)> = BTreeMap::new();
    for Case { preset, noun, what, kind, example } in skipped.chain(not_applicable).chain(failed).chain(lacking) {
        kinds.entry((preset, noun, what, kind)).or_insert((0, example)).0 += 1;
    }
    let mut unscored = Vec::new();
    for ((preset, of, rest, _), (count, example)) in kinds {
        let text = format!("{}{rest}", counted(count as u64, of));
        let what = format!("{}{rest}", noun(2, of));
        unscored.push(Unscored { preset: preset.to_owned(), what, count, text, example });
    }
    unscored
}

impl<'a> Case<'a> {
    fn skipped(entry: &'a SkippedEntry) -> Self {
        let methods: Vec<&str> = entry.methods.iter().map(String::as_str).collect();
        let of_methods = if methods.is_empty() { String::new() } else { format!(" for {}", methods.join(", ")) };
        let what = format!(" skipped{of_methods}, {}", entry.reason);
        let example = format!("scene {}: {}", entry.scene, entry.detail);
        Self { preset: &entry.preset, noun: "entry", what, kind: String::new(), example }
    }

    fn not_applicable(trial: &'a TrialRow) -> Self {
        let (key, why) = (&trial.key, trial.detail.as_deref().unwrap_or("unknown reason"));
        let what = format!(" of {} not applicable", key.method);
        let example = format!("scene {}: {why}", key.scene);
        Self { preset: &key.preset, noun: "trial", what, kind: kind_of(why, &key.scene), example }
    }

    fn failed(row: &'a TargetRow) -> Self {
        let why = row.detail.as_deref().unwrap_or("unknown reason");
        Self::of_target(row, format!(" of {} failed", row.key.method), why)
    }

    /// A compared target without the metric `id`.
    fn lacking(row: &'a TargetRow, id: &str, why: &str) -> Self {
        let is_infinite = why == IDENTICAL;
        let why = if is_infinite { "infinite: no sample differs after clipping or rounding" } else { why };
        Self::of_target(row, format!(" of {} not in the mean of {}", row.key.method, metric_name(id)), why)
    }

    fn of_target(row: &'a TargetRow, what: String, why: &str) -> Self {
        let key = &row.key;
        let example = format!("scene {}, frame {}: {why}", key.scene, row.frame);
        Self { preset: &key.preset, noun: "target", what, kind: kind_of(why, &key.scene), example }
    }
}

/// The kind of a failure, by which failures are grouped; not shown. It is the text without paths, numbers and the
/// scene's name.
fn kind_of(detail: &str, scene: &str) -> String {
    const LONGEST: usize = 60;
    let words = detail.split_whitespace().take_while(|word| !word.starts_with('('));
    let words = words.map(|word| {
        let bare = word.trim_end_matches([':', ',', ';']);
        if bare == scene {
            return format!("SCENE{}", word.get(bare.len()..).unwrap_or_default());
        }
        let word = if word.contains('/') { "PATH" } else { word };
        let mut kind = String::new();
        for c in word.chars() {
            if !c.is_ascii_digit() {
                kind.push(c);
            } else if !kind.ends_with('N') {
                kind.push('N');
            }
        }
        kind
    });
    let text = words.collect::<Vec<_>>().join(" ");
    let short = text.split_once(": ").map_or(text.as_str(), |(short, _)| short);
    short.chars().take(LONGEST).collect::<String>().trim_end_matches([':', ',', ';']).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MetricRecord;

    /// Two of three targets are too small for one metric, and one of them is infinite in another.
    #[test]
    fn metrics_that_some_targets_lack_are_listed() {
        let mut results = crate::sample_rows::results("m", "psnr", &[("a", 0, vec![20.0, 30.0]), ("b", 0, vec![40.0])]);
        let absent = Some("no file".to_owned());
        results.provenance.metrics.push(MetricRecord { id: "lpips".to_owned(), absent, ..MetricRecord::default() });
        let small = "not computed: LPIPS (Alex): expected at least 31 pixels a side, found 8×8";
        for row in &mut results.targets[1..] {
            let reasons = [("lpips-alex", small), ("lpips", "weights absent")];
            row.not_computed = reasons.map(|(id, why)| (id.to_owned(), why.to_owned())).into();
        }
        results.targets[2].not_computed.insert("psnr-8bit-rounded".to_owned(), IDENTICAL.to_owned());
        let rows = unscored(&results);
        let found = rows.iter().map(|row| (row.count, format!("{}: {}", row.what, row.example)));
        let infinite = "infinite: no sample differs after clipping or rounding";
        let expected = [
            (2, format!("targets of m not in the mean of LPIPS (Alex): scene a, frame 1: {small}")),
            (1, format!("targets of m not in the mean of PSNR (8 bit, rounded): scene b, frame 0: {infinite}")),
        ];
        assert_eq!(found.collect::<Vec<_>>(), expected);
        assert_eq!(rows[1].text, "1 target of m not in the mean of PSNR (8 bit, rounded)");
        // Weights that are there now, for the results of other methods, and a metric that a later run requested.
        results.targets.truncate(2);
        results.targets[1].not_computed = [("lpips".to_owned(), WEIGHTS_ABSENT.to_owned())].into();
        results.targets[0].scores.insert("lpips".to_owned(), 0.1);
        results.provenance.metrics =
            ["psnr", "lpips", "l1"].map(|id| MetricRecord { id: id.to_owned(), ..MetricRecord::default() }).to_vec();
        let found: Vec<_> = unscored(&results).into_iter().map(|row| (row.text, row.example)).collect();
        let of = |count: &str, metric: &str, frame: u32| {
            let text = format!("{count} of m not in the mean of {metric}");
            (text, format!("scene a, frame {frame}: {ADDED_LATER}"))
        };
        assert_eq!(found, [of("2 targets", "L1", 0), of("1 target", "LPIPS", 1)]);
    }

    #[test]
    fn failures_of_one_kind_have_the_same_text() {
        let of = |detail: &str| kind_of(detail, "aa11");
        assert_eq!(kind_of("no palace of scene a: gone", "a"), "no palace of scene SCENE");
        let missing = "no file for frame N of scene SCENE";
        assert_eq!(of("no file for frame 12 of scene aa11: expected aa11/000012.png, .exr or .npy below out"), missing);
        assert_eq!(of("no file for frame 7 of scene aa11: expected aa11/000007.png, .exr or .npy below out"), missing);
        assert_eq!(of("expected an image of 40×40, found 20×20"), "expected an image of N×N, found N×N");
        assert_eq!(of("unexpected end of file (out/aa11/000002.png)"), "unexpected end of file");
    }
}
