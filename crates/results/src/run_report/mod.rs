//! The summary of a run: means over scenes. `atsplat report` makes tables, intervals and plots.

mod counts;
mod display;
mod unscored;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use atsplat_metrics::definition;
use atsplat_protocol::{Aggregation, DropReason, Preset};
use serde::{Serialize, Serializer};

use crate::statistics::{Identical, Leaked, MetricQuery, mean_of, select};
use crate::times::{Times, times};
use crate::{MethodRecord, MetricRecord, PresetRecord, Results, TargetRow, TargetStatus, WarningCount};
pub use counts::RunCounts;
use unscored::{Unscored, unscored};

/// The summary of a results store: means over scenes, times, failures and warnings. [`Display`](std::fmt::Display) prints it as a
/// table.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct RunReport {
    store: PathBuf,
    #[serde(skip_serializing_if = "Option::is_none")]
    summary: Option<RunCounts>,
    rows: Vec<Row>,
    /// Times of each method under each protocol, from the timing pass.
    times: Vec<MethodTimes>,
    /// Metrics that were not computed, and why.
    not_computed: BTreeMap<String, String>,
    /// Index entries and targets without scores, or without one of them, by reason.
    without: Vec<Unscored>,
    /// Protocols on an index that some papers use under them, with what the preset says about it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    alternative_indices: Vec<AlternativeIndex>,
    /// Warnings about indices and data.
    warnings: Vec<WarningCount>,
    /// A suggestion.
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<String>,
}

/// One method under one protocol.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    preset: String,
    method: String,
    untrained: bool,
    /// Scenes with targets.
    scenes: usize,
    /// Those of them that are in the means: with a scored target.
    scored_scenes: usize,
    targets: usize,
    failed: usize,
    /// Targets of trials that the method does not support.
    not_applicable: usize,
    non_finite: usize,
    identical: usize,
    /// Scored targets that are in no bin, if the protocol puts the overlaps of its index in bins.
    #[serde(skip_serializing_if = "is_zero")]
    outside_bins: u64,
    /// The protocol's means; renders that are identical to the truth are left out.
    means: BTreeMap<String, f64>,
    /// Targets that are also context frames; they are in the means, as in published numbers.
    leaked: usize,
    /// The same without them, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    without_leaked: Option<WithoutLeaked>,
}

/// What a row says of the targets that are not context frames.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct WithoutLeaked {
    scenes: usize,
    scored_scenes: usize,
    targets: usize,
    means: BTreeMap<String, f64>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct MethodTimes {
    preset: String,
    method: String,
    /// Or the reason for having none, as `absent`.
    #[serde(flatten, serialize_with = "times_or_absent")]
    times: Result<Times, String>,
    /// Whether its encoding is the whole answer of a process.
    #[serde(skip)]
    is_process: bool,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct AlternativeIndex {
    preset: String,
    index: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
}

impl RunReport {
    /// Summarises the results in the folder `store`, after a run with this summary if there was one.
    pub fn of(results: &Results, summary: Option<RunCounts>, store: &Path) -> Self {
        let provenance = &results.provenance;
        let (mut rows, mut of_methods) = (Vec::new(), Vec::new());
        for preset in &provenance.presets {
            let protocol = protocol(preset);
            for method in &provenance.methods {
                let targets: Vec<&TargetRow> = results.targets_of(&preset.name, &method.name).collect();
                if !targets.is_empty() {
                    rows.push(Row::of(results, preset, &protocol, method, &targets));
                    of_methods.push(MethodTimes::of(results, preset, method));
                }
            }
        }
        let absent = |metric: &MetricRecord| Some((metric.id.clone(), metric.absent.clone()?));
        Self {
            store: store.to_owned(),
            summary,
            rows,
            times: of_methods,
            not_computed: provenance.metrics.iter().filter_map(absent).collect(),
            without: unscored(results),
            alternative_indices: provenance.presets.iter().filter_map(AlternativeIndex::of).collect(),
            warnings: provenance.warnings.clone(),
            advice: None,
        }
    }

    /// Suggests `--any-size` if images were rejected for their size and the run did not use it, and before that `--images`, if a
    /// copy of the images with this factor has the expected size.
    #[must_use]
    pub fn with_advice(self, takes_any_size: bool, images: Option<u32>) -> Self {
        const ADVICE: &str = "--any-size takes images of any size; the results then belong to another protocol";
        let rejected = self.without.iter().any(|unscored| unscored.what.ends_with(DropReason::ImageSize.name()));
        let copy =
            images.map(|factor| format!("--images {factor} takes copies of the images of the expected size, and "));
        let advice = (rejected && !takes_any_size).then(|| format!("{}{ADVICE}", copy.unwrap_or_default()));
        Self { advice, ..self }
    }
}

impl Row {
    fn of(
        results: &Results,
        preset: &PresetRecord,
        protocol: &Preset,
        method: &MethodRecord,
        targets: &[&TargetRow],
    ) -> Self {
        let means_of = |leaked| means(results, [&preset.name, &method.name], protocol.aggregation, leaked);
        let unsupported_keys = results.unsupported_keys();
        let (unsupported, supported): (Vec<&TargetRow>, Vec<&TargetRow>) =
            targets.iter().copied().partition(|row| unsupported_keys.contains(&row.key));
        let count = |status| supported.iter().filter(|row| row.status == status).count();
        let others: Vec<&TargetRow> = targets.iter().copied().filter(|row| !row.leaked).collect();
        let leaked = targets.len() - others.len();
        Self {
            preset: preset.name.clone(),
            method: method.name.clone(),
            untrained: method.untrained,
            scenes: scenes(targets),
            scored_scenes: scored_scenes(targets),
            targets: targets.len(),
            failed: count(TargetStatus::Failed),
            not_applicable: unsupported.len(),
            non_finite: count(TargetStatus::NonFinite),
            identical: count(TargetStatus::Identical),
            outside_bins: outside_bins(preset, protocol, targets),
            means: means_of(Leaked::Included),
            leaked,
            without_leaked: (leaked > 0).then(|| WithoutLeaked {
                scenes: scenes(&others),
                scored_scenes: scored_scenes(&others),
                targets: others.len(),
                means: means_of(Leaked::Excluded),
            }),
        }
    }
}

/// A protocol's means of a method, as in tables and frontiers without renders that are identical to the truth.
fn means(
    results: &Results,
    [preset, method]: [&str; 2],
    aggregation: Aggregation,
    leaked: Leaked,
) -> BTreeMap<String, f64> {
    let mean = |metric: &str| {
        let query = MetricQuery { preset, method, metric, leaked, identical: Identical::Excluded };
        mean_of(&select(results, &query), aggregation)
    };
    let ids = results.provenance.metrics.iter().map(|metric| &metric.id);
    ids.filter_map(|id| Some((id.clone(), mean(id)?))).collect()
}

/// The number of scenes with any of these targets.
fn scenes(targets: &[&TargetRow]) -> usize {
    targets.iter().map(|row| row.key.scene.as_str()).collect::<BTreeSet<&str>>().len()
}

/// The number of scenes with a scored one of these targets.
fn scored_scenes(targets: &[&TargetRow]) -> usize {
    let scored: Vec<&TargetRow> = targets.iter().copied().filter(|row| row.status == TargetStatus::Scored).collect();
    scenes(&scored)
}

/// [`Row::outside_bins`].
fn outside_bins(preset: &PresetRecord, protocol: &Preset, targets: &[&TargetRow]) -> u64 {
    let bins = protocol.overlap_bins.as_ref();
    let Some(bins) = bins.filter(|bins| bins.mismatched_estimator(&preset.overlap_estimators).is_none()) else {
        return 0;
    };
    let scored = targets.iter().filter(|row| row.status == TargetStatus::Scored);
    scored.filter(|row| row.overlap.and_then(|overlap| bins.name_of(overlap)).is_none()).count() as u64
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
const fn is_zero(count: &u64) -> bool {
    *count == 0
}

#[expect(clippy::expect_used, reason = "a store with another preset cannot be read")]
fn protocol(preset: &PresetRecord) -> Preset {
    preset.protocol().expect("a preset that was parsed before")
}

fn times_or_absent<S: Serializer>(times: &Result<Times, String>, serializer: S) -> Result<S::Ok, S::Error> {
    match times {
        Ok(times) => times.serialize(serializer),
        Err(absent) => Absent { absent }.serialize(serializer),
    }
}

/// Why there are no times.
#[derive(Serialize)]
struct Absent<'a> {
    absent: &'a str,
}

impl MethodTimes {
    fn of(results: &Results, preset: &PresetRecord, method: &MethodRecord) -> Self {
        let times = times(results, &preset.name, &method.name);
        let (preset, is_process, method) = (preset.name.clone(), method.is_process(), method.name.clone());
        Self { preset, method, times, is_process }
    }
}

impl AlternativeIndex {
    /// `None` if the protocol was run on its default index, or on an unpublished one.
    fn of(record: &PresetRecord) -> Option<Self> {
        let index = protocol(record).index;
        let alternative = index.alternative(record.index_name.as_ref()?)?;
        Some(Self { preset: record.name.clone(), index: alternative.name.clone(), note: alternative.note.clone() })
    }
}

/// The name of a metric for readers.
fn metric_name(id: &str) -> &str {
    definition(id).map_or(id, |metric| metric.name)
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::sample_rows;

    /// Both targets of the first scene failed, and one of the second's.
    #[test]
    fn scenes_that_are_not_in_the_means_are_not_counted_as_if_they_were() {
        let scenes = [("a", 0, vec![20.0, 30.0]), ("b", 0, vec![24.0, 26.0]), ("c", 0, vec![40.0])];
        let mut results = sample_rows::results("m", "psnr", &scenes);
        let toml = Preset::named("re10k-2v-256").unwrap().to_toml().unwrap();
        let preset = PresetRecord { name: sample_rows::PRESET.to_owned(), toml, ..PresetRecord::default() };
        results.provenance.presets.push(preset);
        results.provenance.methods.push(MethodRecord { name: "m".to_owned(), ..MethodRecord::default() });
        let row = |results: &Results| {
            let report = RunReport::of(results, None, Path::new("store"));
            let json = serde_json::to_value(&report).unwrap();
            let text = report.to_string().lines().nth(1).unwrap().split_whitespace().collect::<Vec<_>>().join(" ");
            (text, [&json["rows"][0]["scenes"], &json["rows"][0]["scored-scenes"]].map(|count| count.as_u64().unwrap()))
        };
        assert_eq!(row(&results), ("sampled m 3 5 30.0000".to_owned(), [3, 3]));
        for target in &mut results.targets[..3] {
            (target.status, target.scores) = (TargetStatus::Failed, [].into());
        }
        assert_eq!(row(&results), ("sampled m 2 of 3 5 33.0000 3 failed".to_owned(), [3, 2]));
    }

    /// The first scene is 24 without its first target, and the last has no other: (24 + 26) / 2, not (22 + 26 + 40) / 3.
    #[test]
    fn targets_that_are_context_frames_are_counted_and_left_out_in_a_line_of_their_own() {
        let scenes = [("a", 0, vec![20.0, 24.0]), ("b", 0, vec![26.0]), ("c", 0, vec![40.0])];
        let mut results = sample_rows::results("m", "psnr", &scenes);
        let toml = Preset::named("re10k-2v-256").unwrap().to_toml().unwrap();
        let preset = PresetRecord { name: sample_rows::PRESET.to_owned(), toml, ..PresetRecord::default() };
        results.provenance.presets.push(preset);
        results.provenance.methods.push(MethodRecord { name: "m".to_owned(), ..MethodRecord::default() });
        let said = |results: &Results| {
            let report = RunReport::of(results, None, Path::new("store"));
            let json = serde_json::to_value(&report).unwrap()["rows"][0].clone();
            let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
            (json, report.to_string().lines().map(words).collect::<Vec<_>>())
        };
        let (json, lines) = said(&results);
        assert_eq!((&json["leaked"], json.get("without-leaked")), (&0.into(), None));
        assert!(!lines.concat().contains("leaked"), "{lines:?}");
        for at in [0, 3] {
            results.targets[at].leaked = true;
        }
        let (json, lines) = said(&results);
        let mean = (22.0 + 26.0 + 40.0) / 3.0;
        assert_eq!((&json["targets"], &json["leaked"], &json["scenes"]), (&4.into(), &2.into(), &3.into()));
        Tolerance::F64.assert([json["means"]["psnr"].as_f64().unwrap()], [mean], "over all targets");
        let without = serde_json::json!({"scenes": 2, "scored-scenes": 2, "targets": 2, "means": {"psnr": 25.0}});
        assert_eq!(json["without-leaked"], without);
        let of_all = format!("sampled m 3 4 {mean:.4} 2 targets are context frames");
        assert_eq!(lines[1..3], [of_all, "sampled m, leaked targets excluded 2 2 25.0000".to_owned()]);
        assert_eq!(lines[3], "leaked targets excluded: targets that are also context frames do not count");
    }

    /// The published edges end at 0.8; the last scene has no overlap.
    #[test]
    fn targets_outside_all_bins_are_named() {
        let scenes = [("a", 0, vec![20.0, 30.0, 10.0]), ("b", 0, vec![24.0]), ("c", 0, vec![40.0])];
        let mut results = sample_rows::results("m", "psnr", &scenes);
        for (row, overlap) in results.targets.iter_mut().zip([Some(0.9), Some(0.9), Some(0.9), Some(0.8), None]) {
            row.overlap = overlap;
        }
        results.targets[1].status = TargetStatus::Failed;
        results.provenance.methods.push(MethodRecord { name: "m".to_owned(), ..MethodRecord::default() });
        let found = |preset: &str, estimators: &[&str]| {
            let mut results = results.clone();
            results.provenance.presets = vec![PresetRecord {
                name: sample_rows::PRESET.to_owned(),
                toml: Preset::named(preset).unwrap().to_toml().unwrap(),
                overlap_estimators: estimators.iter().map(|name| (*name).to_owned()).collect(),
                ..PresetRecord::default()
            }];
            let report = RunReport::of(&results, None, Path::new("store"));
            let line = report.to_string().lines().nth(1).unwrap().to_owned();
            (
                report.rows[0].outside_bins,
                line.contains("  3 targets outside all bins of overlap: in the mean over all"),
            )
        };
        assert_eq!(found("re10k-overlap", &[]), (3, true));
        assert_eq!(found("re10k-overlap", &["epipolar-ray"]), (0, false), "no overlap is in a bin");
        assert_eq!(found("re10k-2v-256", &[]), (0, false), "without bins");
    }

    /// Both protocols accept a second file; only one was run on it.
    #[test]
    fn an_alternative_index_is_named_with_its_note() {
        let record = |name: &str, index: &str| {
            let toml = Preset::named(name).unwrap().to_toml().unwrap();
            PresetRecord { name: name.to_owned(), toml, index_name: Some(index.to_owned()), ..PresetRecord::default() }
        };
        let mut results = Results::default();
        let twelve = record("dl3dv-12v-512x960", "yonosplat-dl3dv-12v");
        results.provenance.presets = vec![record("re10k-to-dl3dv-256", "depthsplat-dl3dv-2v"), twelve];
        let report = RunReport::of(&results, None, Path::new("store"));
        let text = report.to_string();
        let lines: Vec<&str> = text.lines().filter(|line| line.contains("index")).collect();
        let note = "8 random targets a scene, 137 of 1120 leaked; report which file was used";
        let expected =
            "warning: dl3dv-12v-512x960: not the published setting, but an alternative index, yonosplat-dl3dv-12v";
        assert_eq!(lines, [format!("{expected}: {note}")]);
        let json = serde_json::to_value(&report).unwrap();
        let expected =
            serde_json::json!([{"preset": "dl3dv-12v-512x960", "index": "yonosplat-dl3dv-12v", "note": note}]);
        assert_eq!(json["alternative-indices"], expected);
        results.provenance.presets.pop();
        let json = serde_json::to_value(RunReport::of(&results, None, Path::new("store"))).unwrap();
        assert_eq!(json.get("alternative-indices"), None);
    }

    /// Fields of the times beside the names, or the reason.
    #[test]
    fn times_and_reasons_are_fields_of_their_method() {
        let mut results = sample_rows::results("timed", "psnr", &[("a", 0, vec![20.0])]);
        let other = sample_rows::results("untimed", "psnr", &[("a", 0, vec![21.0])]);
        results.trials.extend(other.trials);
        results.targets.extend(other.targets);
        results.timings.push(sample_rows::timing("timed", "a", &[0.5], &[0.25]));
        let toml = Preset::named("re10k-2v-256").unwrap().to_toml().unwrap();
        let preset = PresetRecord { name: sample_rows::PRESET.to_owned(), toml, ..PresetRecord::default() };
        results.provenance.presets.push(preset);
        results.provenance.schema_version = crate::store::SCHEMA_VERSION;
        let record = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
        results.provenance.methods = ["timed", "untimed"].map(record).to_vec();
        let report = RunReport::of(&results, None, Path::new("store"));
        let json = serde_json::to_value(&report).unwrap();
        let [timed, untimed] = [0, 1].map(|at: usize| json["times"][at].as_object().unwrap());
        assert_eq!((&timed["method"], &timed["trials"], timed.get("absent")), (&"timed".into(), &1.into(), None));
        let reason = "no timing pass was made: `atsplat run --timing` makes one";
        assert_eq!((&untimed["absent"], untimed.len()), (&reason.into(), 3), "with preset and method: {untimed:?}");
        let text = report.to_string();
        assert!(text.contains(&format!("\nno times of untimed: {reason}\n")), "{text}");
        assert!(text.contains("\nsampled, timed: encoding 500.00 ms"), "{text}");
    }
}
