use std::cmp::Ordering;

use atsplat_metrics::Direction;
use atsplat_results::statistics::{Paired, direction};
use serde::{Deserialize, Serialize};

use super::probe::{Attribution, Outputs, StageVerdict, Stages, attribute};
use super::{Change, DataComparison, Difference, DriftError};

/// Comparison of results with a baseline.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct DriftReport {
    /// The worst verdict of all parts.
    pub verdict: DriftVerdict,
    /// One per metric, method and preset.
    pub comparisons: Vec<Comparison>,
    /// Changes other than of scores.
    pub findings: Vec<Finding>,
    /// The images that the numbers were computed from.
    pub data: DataComparison,
    /// Settings that affect numbers and differ.
    pub differences: Vec<Difference>,
    /// What changed and explains changed numbers, in the order in which these are made: the first is where to look first.
    pub changes: Vec<Change>,
    /// Which stage changed a probe's numbers; `None` if no probe was run.
    pub attribution: Option<Attribution>,
    /// Which stage of the probe failed, and why; there is no attribution then.
    pub not_attributed: Option<String>,
}

/// Outcome of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriftVerdict {
    /// Nothing changed.
    Same,
    /// All changes are within their bound or limit.
    Within,
    /// There was nothing to compare.
    Nothing,
    /// Something changed.
    Drifted,
}

/// How two numbers were compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Basis {
    /// Bit by bit: a deterministic method on the same machine type.
    Exact,
    /// Target by target within [`super::metric_bound`], or else as [`Self::Interval`]: a deterministic method on another machine type.
    Bound,
    /// The paired interval against a limit: drift if the whole interval is beyond the limit, or if the mean of a scene changed by more
    /// than [`super::scene_limit`], as the interval of few changed scenes contains 0.
    Interval,
}

/// One metric of one method under one preset in baseline and results.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Comparison {
    /// Name of the preset.
    pub preset: String,
    /// Name of the method.
    pub method: String,
    /// Id of the metric.
    pub metric: String,
    /// The verdict on this number.
    pub verdict: DriftVerdict,
    /// How it was reached.
    pub basis: Basis,
    /// The baseline's mean over scenes, over the targets that are compared: common ones whose render is identical to the truth in
    /// neither run, because tables leave those out.
    pub baseline: Option<f64>,
    /// The results' mean over the same targets.
    pub now: Option<f64>,
    /// Results minus baseline over the same targets; `None` if there are none.
    pub paired: Option<Paired>,
    /// Common targets that are left out because their render is identical to the truth in one run or both.
    pub identical: u64,
    /// Targets whose score changed.
    pub changed: u64,
    /// Largest change of a target's score.
    pub largest: f64,
    /// Scene, entry and frame of the largest change.
    pub largest_at: Option<String>,
    /// The scene whose mean changed most.
    pub largest_scene: Option<SceneChange>,
    /// How far the mean may change, if intervals decide.
    pub limit: Option<f64>,
    /// How far the mean of a scene may change, if intervals decide.
    pub scene_limit: Option<f64>,
}

/// A scene with the change of its mean.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneChange {
    /// The scene.
    pub scene: String,
    /// Results minus baseline.
    pub change: f64,
}

impl Comparison {
    /// Whether the mean improved, by the metric's direction; `None` if it did not change.
    pub fn improved(&self) -> Option<bool> {
        match (direction(&self.metric), self.paired.as_ref()?.difference.partial_cmp(&0.0)?) {
            (_, Ordering::Equal) => None,
            (Direction::Higher, order) => Some(order == Ordering::Greater),
            (Direction::Lower, order) => Some(order == Ordering::Less),
        }
    }
}

/// A kind of change other than of a score, with its count.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Finding {
    /// Name of the preset.
    pub preset: String,
    /// Name of the method.
    pub method: String,
    /// What changed.
    pub kind: FindingKind,
    /// Whether it counts as drift.
    pub verdict: DriftVerdict,
    /// Number of occurrences.
    pub count: u64,
    /// The first occurrence; empty if the kind says everything.
    pub example: String,
}

/// Kinds of changes other than of scores.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FindingKind {
    /// Fields of the protocol: the numbers are not comparable.
    Protocol,
    /// Entries of the index: the numbers are not comparable.
    Index,
    /// The file of the index, with the same entries: not drift.
    RewrittenIndex,
    /// Targets of the baseline without a row in the results.
    Missing,
    /// Targets that the baseline does not have; not drift, but not monitored either.
    New,
    /// Trials with another hash: frames, cameras or preprocessing.
    Trial,
    /// Targets that tables group differently: by whether they are context frames, their distance from these, or their overlap.
    Grouping,
    /// Targets with another status, such as failed instead of scored.
    Status,
    /// Context or target images with other samples, from the data, decoding or resizing.
    Data,
    /// Renders that are not bit-identical.
    Render,
    /// Trials with other token or Gaussian counts.
    Count,
    /// Scores that are no longer computed.
    Score,
    /// Scores that the baseline does not have; not drift, but not monitored either.
    NewScore,
}

impl FindingKind {
    /// Description in reports.
    pub const fn description(self) -> &'static str {
        match self {
            Self::Protocol => "another protocol",
            Self::Index => "entries of the index have changed",
            Self::RewrittenIndex => "another index file with the same entries",
            Self::Missing => "targets are missing",
            Self::New => "targets are new",
            Self::Trial => "trials have other frames, cameras or preprocessing",
            Self::Grouping => "targets have another mark of context frames, distance or overlap",
            Self::Status => "targets have another status",
            Self::Data => "images have changed",
            Self::Render => "renders are not bit-identical",
            Self::Count => "trials have other numbers of tokens or Gaussians",
            Self::Score => "scores are no longer computed",
            Self::NewScore => "scores are new",
        }
    }
}

impl DriftReport {
    /// Whether the verdict is drift.
    pub fn drifted(&self) -> bool {
        self.verdict == DriftVerdict::Drifted
    }

    /// Whether no target has a score both in the results and in the baseline, and nothing that both have changed.
    pub(super) fn compared_nothing(&self) -> bool {
        let is_nothing = |comparison: &Comparison| comparison.verdict == DriftVerdict::Nothing;
        self.verdict == DriftVerdict::Nothing && self.comparisons.iter().all(is_nothing)
    }

    /// Runs the stages on the outputs of the baseline's probe, which they gave for its recipe, and adds what changed. A stage that fails
    /// now has changed, since it did not fail for the baseline.
    #[must_use]
    pub fn with_probe(self, stages: &dyn Stages, outputs: &Outputs, same_machine: bool) -> Self {
        match attribute(stages, outputs, same_machine) {
            Ok(attribution) => self.with_attribution(attribution),
            Err(error) => self.with_failed_stage(&error),
        }
    }

    /// Adds the attribution of a probe. Where nothing was compared, its verdict stays: the baseline may be that of another run.
    #[must_use]
    pub fn with_attribution(self, attribution: Attribution) -> Self {
        let found = attribution.stages.iter().map(|stage| match stage.verdict {
            StageVerdict::Same => DriftVerdict::Same,
            StageVerdict::Empty => DriftVerdict::Nothing,
            StageVerdict::Changed => DriftVerdict::Drifted,
        });
        let verdict = found.fold(self.verdict, DriftVerdict::max).min(self.worst_of_probe());
        let changes = self.changes_with(&attribution);
        Self { verdict, changes, attribution: Some(attribution), ..self }
    }

    /// Adds that a stage of the baseline's probe fails.
    #[must_use]
    pub(super) fn with_failed_stage(self, error: &DriftError) -> Self {
        Self { verdict: self.worst_of_probe(), not_attributed: Some(error.to_string()), ..self }
    }

    /// The worst verdict that a probe can give.
    fn worst_of_probe(&self) -> DriftVerdict {
        if self.compared_nothing() { DriftVerdict::Nothing } else { DriftVerdict::Drifted }
    }
}
