use std::cmp::Ordering;

use atsplat_metrics::Direction;
use serde::{Deserialize, Serialize};

use super::probe::{Attribution, Stage, StageVerdict};
use super::{DataComparison, Difference};
use crate::statistics::{Paired, direction};

/// What became of a baseline's numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct DriftReport {
    /// Of everything: the worst below.
    pub verdict: Verdict,
    /// One for each metric of each method under each preset.
    pub comparisons: Vec<Comparison>,
    /// What changed beside scores.
    pub findings: Vec<Finding>,
    /// The pictures that the numbers were made from.
    pub data: DataComparison,
    /// What decides numbers and was otherwise.
    pub differences: Vec<Difference>,
    /// Which stage moved a probe's numbers; `None` where no probe was run.
    pub attribution: Option<Attribution>,
    /// Why there is no attribution although the baseline has a probe.
    pub not_attributed: Option<String>,
}

/// Whether somebody has to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing moved.
    Same,
    /// What moved stays within its bound or limit.
    Within,
    /// There was nothing to compare.
    Nothing,
    /// Something moved.
    Drifted,
}

/// How two numbers were compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Basis {
    /// Bit by bit: a deterministic method on the same machine type.
    Exact,
    /// Target by target within [`super::metric_bound`]: a deterministic method on another machine type.
    Bound,
    /// The paired interval against a limit: drift where it lies beyond the limit as a whole.
    Interval,
}

/// One metric of one method under one preset, then and now.
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
    pub verdict: Verdict,
    /// How it was reached.
    pub basis: Basis,
    /// Mean over the scenes of the baseline, over the targets that both have.
    pub baseline: Option<f64>,
    /// The same of the results.
    pub now: Option<f64>,
    /// Results less baseline; `None` where no target has both.
    pub paired: Option<Paired>,
    /// Targets whose score is another number.
    pub changed: u64,
    /// Largest change of a target's score.
    pub largest: f64,
    /// Where that was: scene, entry and frame.
    pub largest_at: Option<String>,
    /// How far the mean may move, where intervals decide.
    pub limit: Option<f64>,
}

impl Comparison {
    /// Whether the mean moved for the better, by the metric's direction; `None` where it did not move.
    pub fn sense(&self) -> Option<bool> {
        match (direction(&self.metric), self.paired.as_ref()?.difference.partial_cmp(&0.0)?) {
            (_, Ordering::Equal) => None,
            (Direction::Higher, order) => Some(order == Ordering::Greater),
            (Direction::Lower, order) => Some(order == Ordering::Less),
        }
    }
}

/// Something that changed beside a score, counted.
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
    pub verdict: Verdict,
    /// How often.
    pub count: u64,
    /// The first of them.
    pub example: String,
}

/// What may change beside a score.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FindingKind {
    /// The protocol's or the index's hash: numbers answer another question.
    Protocol,
    /// Targets of the baseline that have no row.
    Missing,
    /// Targets that the baseline does not know; no drift, but not watched either.
    New,
    /// Trials whose hash is another: frames, cameras or preprocessing.
    Trial,
    /// Targets that were compared and now failed, or the other way round.
    Status,
    /// Context or target pictures of other samples: the data, decoding or resizing.
    Data,
    /// Renders of other bits.
    Render,
    /// Trials of other token or Gaussian counts.
    Count,
    /// Scores that were there and are no longer computed.
    Score,
    /// Scores that the baseline does not have; no drift, but not watched either.
    NewScore,
}

impl FindingKind {
    /// What happened, in words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Protocol => "another protocol",
            Self::Missing => "targets are missing",
            Self::New => "targets are new",
            Self::Trial => "trials ask another question",
            Self::Status => "targets ended otherwise",
            Self::Data => "pictures are others",
            Self::Render => "renders have other bits",
            Self::Count => "trials have other counts of tokens or Gaussians",
            Self::Score => "scores are no longer computed",
            Self::NewScore => "scores are new",
        }
    }
}

impl DriftReport {
    /// Whether anything drifted.
    pub fn drifted(&self) -> bool {
        self.verdict == Verdict::Drifted
    }

    /// The first stage that changed: where to look. Other pictures are the data's change unless decoding or resizing changed
    /// on the probe, which alone may make other pictures of the same files.
    pub fn first_stage(&self) -> Option<Stage> {
        let probed = self.attribution.as_ref().and_then(Attribution::first);
        let explained = matches!(probed, Some(Stage::Decode | Stage::Resize));
        if self.data.verdict() == StageVerdict::Changed && !explained { Some(Stage::Data) } else { probed }
    }

    /// The same, with what a probe says of stages.
    #[must_use]
    pub fn with_attribution(self, attribution: Result<Attribution, super::DriftError>) -> Self {
        match attribution {
            Ok(attribution) => {
                let found = attribution.stages.iter().map(|stage| match stage.verdict {
                    StageVerdict::Same => Verdict::Same,
                    StageVerdict::Empty => Verdict::Nothing,
                    StageVerdict::Changed => Verdict::Drifted,
                });
                Self { verdict: found.fold(self.verdict, Verdict::max), attribution: Some(attribution), ..self }
            }
            Err(error) => Self { verdict: Verdict::Drifted, not_attributed: Some(error.to_string()), ..self },
        }
    }
}
