use std::collections::BTreeSet;

use atsplat_files::Sha256Digest;
use atsplat_numeric::{mean, median};
use serde::Serialize;

use super::DatasetFacts;
use crate::extrapolation::TargetDistances;
use crate::{BinCounts, BinRule, EvaluationIndex, IndexEntry, IndexNotices, KnownIndex, OverlapBins};

/// The result of a lint. Its JSON and its text contain the same numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct LintReport {
    /// The file's hash and irregularities, if the index was read from a file.
    pub file: Option<FileFacts>,
    /// [`EvaluationIndex::content_hash`].
    pub content_sha256: Sha256Digest,
    /// The official index that this is, if any.
    pub recognised: Option<RecognisedIndex>,
    /// Scene keys.
    pub keys: u64,
    /// Keys without an entry (`null`): scenes that the protocol omits.
    pub null: u64,
    /// Keys with at least one entry.
    pub scenes: u64,
    /// Entries; more than scenes if a scene has several.
    pub entries: u64,
    /// Target frames.
    pub targets: u64,
    /// Number of context frames of an entry.
    pub context_per_entry: Option<CountDistribution>,
    /// Number of targets of a scene, over all its entries.
    pub targets_per_scene: Option<CountDistribution>,
    /// Last minus first context frame of an entry.
    pub context_gap: Option<CountDistribution>,
    /// Targets that are context frames of the same entry.
    pub leaked: TargetCount,
    /// Targets before the first or after the last context frame.
    pub outside_window: TargetCount,
    /// Targets by signed distance from their window.
    pub targets_by_distance: TargetDistances,
    /// Entries whose first context frame is frame 0, with no frames before their window.
    pub windows_at_zero: u64,
    /// Repetitions.
    pub repeats: Repeats,
    /// Entries without context frames.
    pub without_context: u64,
    /// Entries without targets.
    pub without_targets: u64,
    /// The overlap values, if the index has any.
    pub overlap: Option<OverlapFacts>,
    /// Which entries give trials on the dataset, if one was given.
    pub dataset: Option<DatasetFacts>,
}

/// The file that an index was read from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FileFacts {
    /// Hash of its bytes.
    pub sha256: Sha256Digest,
    /// Its size in bytes.
    pub size: u64,
    /// Its irregularities.
    #[serde(flatten)]
    pub notices: IndexNotices,
}

/// The official index that an index was recognised as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct RecognisedIndex {
    /// Whether the bytes are equal to the published file's; otherwise only the content is.
    pub by_bytes: bool,
    /// The official index.
    #[serde(flatten)]
    pub known: &'static KnownIndex,
}

/// A number of targets, and the number of scenes that contain them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct TargetCount {
    /// Number of targets.
    pub targets: u64,
    /// Number of scenes.
    pub scenes: u64,
}

/// Counts of repetitions, without the first occurrence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Repeats {
    /// Targets that occur earlier in their entry.
    pub targets: u64,
    /// Context frames that occur earlier in their entry.
    pub context: u64,
    /// Entries with the context and targets of an earlier entry of the same scene.
    pub entries: u64,
}

/// The distribution of some counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct CountDistribution {
    /// Smallest.
    pub min: u64,
    /// Median; the mean of the middle two of an even number.
    pub median: f64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Largest.
    pub max: u64,
}

/// The overlap values of an index.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct OverlapFacts {
    /// How the values were computed, as far as known.
    pub definition: String,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Names of the estimators that the index records, if any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub estimators: Vec<String>,
    /// Edges of the bins.
    pub edges: Vec<f64>,
    /// Counts under the published rule.
    pub published: BinCounts,
    /// Counts under the strict rule.
    pub strict: BinCounts,
}

impl CountDistribution {
    /// The distribution of some counts; `None` if there are none.
    pub fn of(counts: impl IntoIterator<Item = u64>) -> Option<Self> {
        let counts: Vec<u64> = counts.into_iter().collect();
        let values = || counts.iter().map(|count| *count as f64);
        let (min, max) = (*counts.iter().min()?, *counts.iter().max()?);
        Some(Self { min, median: median(values())?, mean: mean(values())?, max })
    }
}

/// The lint of the index alone, without file and dataset.
pub(super) fn of(index: &EvaluationIndex, bins: &OverlapBins) -> LintReport {
    let content_sha256 = index.content_hash();
    let entries = || index.entries().map(|(_, _, entry)| entry);
    let count = |matches: &dyn Fn(&IndexEntry) -> bool| entries().filter(|entry| matches(entry)).count() as u64;
    let with_entries = || index.scenes.values().filter(|entries| !entries.is_empty());
    let scenes = index.scene_count() as u64;
    LintReport {
        file: None,
        content_sha256,
        recognised: KnownIndex::by_content(&content_sha256).map(|known| RecognisedIndex { by_bytes: false, known }),
        keys: index.scenes.len() as u64,
        null: index.scenes.len() as u64 - scenes,
        scenes,
        entries: entries().count() as u64,
        targets: index.target_count() as u64,
        context_per_entry: CountDistribution::of(entries().map(|entry| entry.context.len() as u64)),
        targets_per_scene: CountDistribution::of(
            with_entries().map(|entries| entries.iter().map(|entry| entry.target.len() as u64).sum()),
        ),
        context_gap: CountDistribution::of(
            entries().filter_map(|entry| entry.window().map(|(first, last)| (last - first) as u64)),
        ),
        leaked: places(index, |entry| entry.leaked().count()),
        outside_window: places(index, |entry| {
            let outside = |frame: &&usize| entry.frames_outside_window(**frame).is_some_and(|distance| distance != 0);
            entry.target.iter().filter(outside).count()
        }),
        targets_by_distance: TargetDistances::of(entries()),
        windows_at_zero: count(&|entry| entry.window().is_some_and(|(first, _)| first == 0)),
        repeats: Repeats {
            targets: entries().map(|entry| repetitions(&entry.target)).sum(),
            context: entries().map(|entry| repetitions(&entry.context)).sum(),
            entries: with_entries().map(|entries| repeated_entries(entries)).sum(),
        },
        without_context: count(&|entry| entry.context.is_empty()),
        without_targets: count(&|entry| entry.target.is_empty()),
        overlap: overlap(index, bins, &content_sha256),
        dataset: None,
    }
}

fn places(index: &EvaluationIndex, count: impl Fn(&IndexEntry) -> usize) -> TargetCount {
    let mut places = TargetCount::default();
    for entries in index.scenes.values() {
        let targets: usize = entries.iter().map(&count).sum();
        places.targets += targets as u64;
        places.scenes += u64::from(targets > 0);
    }
    places
}

fn repetitions(frames: &[usize]) -> u64 {
    (frames.len() - frames.iter().collect::<BTreeSet<_>>().len()) as u64
}

fn repeated_entries(entries: &[IndexEntry]) -> u64 {
    let distinct: BTreeSet<_> = entries.iter().map(|entry| (&entry.context, &entry.target)).collect();
    (entries.len() - distinct.len()) as u64
}

fn overlap(index: &EvaluationIndex, bins: &OverlapBins, content: &Sha256Digest) -> Option<OverlapFacts> {
    let mut values: Vec<f64> = index.overlaps().map(|overlap| overlap.value).collect();
    values.sort_unstable_by(f64::total_cmp);
    let (min, max) = (*values.first()?, *values.last()?);
    let shipped = KnownIndex::by_content(content).is_some_and(|known| known.repository == "cvg/NoPoSplat");
    let estimators = index.overlap_estimators();
    let definition = if shipped {
        "as published by NoPoSplat: dense matching with RoMa, whose code was never released".to_owned()
    } else if estimators.is_empty() {
        "as written in the index, which does not say how it was computed".to_owned()
    } else {
        format!("by {}, as the index records", estimators.join(" and "))
    };
    // Bins are meaningless for values of an estimator that they were not made for.
    let thirds = bins.mismatched_estimator(&estimators).map(|_| OverlapBins::thirds_of(index));
    let bins = thirds.as_ref().unwrap_or(bins);
    Some(OverlapFacts {
        definition,
        estimators,
        min,
        max,
        edges: bins.edges().to_vec(),
        published: bins.with_rule(BinRule::Published).count(index),
        strict: bins.with_rule(BinRule::Strict).count(index),
    })
}
