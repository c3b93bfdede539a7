use std::collections::BTreeMap;

use atsplat_metrics::definition;
use serde::{Deserialize, Serialize};

use super::{Impossible, MetricRecord, TrialKey, finite};
use crate::ResultsError;

/// The entry in [`TargetRow::not_computed`] of a metric that is infinite because its inputs are equal: the PSNR of identical
/// images, or of images that are identical after rounding to 8 bits.
pub const IDENTICAL: &str = "identical";

/// The entry in [`TargetRow::not_computed`] of a learned metric whose weights were not found.
pub const WEIGHTS_ABSENT: &str = "weights absent";

/// Why a target lacks a metric that its store has ([`TargetRow::lacks`]).
pub(crate) const ADDED_LATER: &str = "added to the results later; running the method again computes it";

/// One target view under one method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetRow {
    /// Trial that the target belongs to.
    #[serde(flatten)]
    pub key: TrialKey,
    /// Position among the trial's targets.
    pub target: u32,
    /// Position of the frame in the scene.
    pub frame: u64,
    /// Frames outside the window of context frames: negative before it, positive after it, 0 inside.
    pub signed_distance: i64,
    /// Whether the frame is also a context frame.
    pub leaked: bool,
    /// Overlap of the context views, if the index has it, in [0, 1].
    pub overlap: Option<f64>,
    /// Width of the scored image in pixels.
    pub width: u32,
    /// Height of the scored image in pixels.
    pub height: u32,
    /// SHA-256 of the ground-truth image's samples; `None` if it could not be read.
    pub truth_hash: Option<String>,
    /// SHA-256 of the render's samples as little-endian f32; `None` without a render.
    pub render_hash: Option<String>,
    /// Scored, or why not.
    pub status: TargetStatus,
    /// Why it failed.
    pub detail: Option<String>,
    /// Samples of the render that are NaN or infinite.
    pub non_finite: u64,
    /// Finite scores by the id of their [`atsplat_metrics::Definition`]. The PSNR of identical images is infinite and
    /// listed as [`IDENTICAL`] in [`Self::not_computed`] instead.
    pub scores: BTreeMap<String, f64>,
    /// Why a score is missing, by the same ids.
    pub not_computed: BTreeMap<String, String>,
}

/// Outcome of a target view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TargetStatus {
    /// Compared.
    Scored,
    /// Compared, and bit-identical to the ground truth.
    Identical,
    /// The render has non-finite samples and was not compared.
    NonFinite,
    /// The render or the ground truth is missing, or their sizes differ.
    Failed,
}

impl TargetRow {
    /// # Errors
    /// [`ResultsError::NotFinite`] for a score or an overlap that is not finite, [`ResultsError::Impossible`] for one outside its range
    /// and for scores of a target that was not compared.
    pub fn check(&self) -> Result<(), ResultsError> {
        finite(&self.key, "overlap", self.overlap)?;
        self.scores.iter().try_for_each(|(id, score)| finite(&self.key, id, [*score]))?;
        self.impossible().map_or(Ok(()), |found| Err(found.of_row(&self.key)))
    }

    /// Whether it lacks a metric that can be computed now: it was compared when the metric was not requested, or its weights were
    /// not found.
    pub(crate) fn lacks(&self, metric: &MetricRecord) -> bool {
        let is_lacking = || match self.not_computed.get(&metric.id) {
            Some(why) => why == WEIGHTS_ABSENT,
            None => !self.scores.contains_key(&metric.id),
        };
        self.status != TargetStatus::Failed && metric.absent.is_none() && is_lacking()
    }

    /// The first field with an impossible value. Metrics that this toolkit does not know have no range.
    pub(crate) fn impossible(&self) -> Option<Impossible> {
        let not_compared = matches!(self.status, TargetStatus::Failed | TargetStatus::NonFinite);
        if let Some((id, score)) = self.scores.first_key_value().filter(|_| not_compared) {
            let expected = format!("no score of a target whose status is {}", self.status.name());
            return Some(Impossible { field: id.clone(), expected, found: score.to_string() });
        }
        let score = |(id, score): (&String, &f64)| {
            let metric = definition(id).filter(|metric| score.is_finite() && !metric.is_possible(*score))?;
            Impossible::unless_within(id, Some(*score), metric.range())
        };
        Impossible::unless_within("overlap", self.overlap, [0.0, 1.0]).or_else(|| self.scores.iter().find_map(score))
    }
}

impl TargetStatus {
    /// Whether it has scores.
    pub const fn is_scored(self) -> bool {
        matches!(self, Self::Scored | Self::Identical)
    }

    /// The status of this name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Scored, Self::Identical, Self::NonFinite, Self::Failed].into_iter().find(|status| status.name() == name)
    }

    /// The name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scored => "scored",
            Self::Identical => "identical",
            Self::NonFinite => "non-finite",
            Self::Failed => "failed",
        }
    }
}
