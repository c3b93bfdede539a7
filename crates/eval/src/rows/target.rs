use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{TrialKey, finite};
use crate::EvalError;

/// What [`TargetRow::not_computed`] says of a metric that is infinite because what it compares is the same: a PSNR of
/// identical pictures, or of pictures that are identical once they are rounded to 8 bits.
pub const IDENTICAL: &str = "identical";

/// One target view under one method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetRow {
    /// Which trial.
    #[serde(flatten)]
    pub key: TrialKey,
    /// Position among the trial's targets.
    pub target: u32,
    /// Position of the frame in the scene.
    pub frame: u64,
    /// Frames outside the window of context frames: negative before it, positive after it, 0 inside.
    pub signed_distance: i64,
    /// Whether the method was given this very frame.
    pub leaked: bool,
    /// Overlap of the context views, where the index has one; nominally in [0, 1].
    pub overlap: Option<f64>,
    /// Width of the scored picture in pixels.
    pub width: u32,
    /// Height of the scored picture in pixels.
    pub height: u32,
    /// SHA-256 of the true picture's samples; `None` where it could not be read.
    pub truth_hash: Option<String>,
    /// SHA-256 of the render's samples as little-endian f32; `None` where there is none.
    pub render_hash: Option<String>,
    /// What became of it.
    pub status: TargetStatus,
    /// Why it failed.
    pub detail: Option<String>,
    /// Samples of the render that are NaN or infinite.
    pub non_finite: u64,
    /// Finite scores, by the id of their [`atsplat_metrics::Definition`]. A PSNR of identical pictures is infinite and
    /// not here: [`Self::not_computed`] has [`IDENTICAL`] in its place.
    pub scores: BTreeMap<String, f64>,
    /// Why a score is not there, by the same ids.
    pub not_computed: BTreeMap<String, String>,
}

/// What became of a target view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TargetStatus {
    /// Compared.
    Scored,
    /// Compared, and the same to the bit.
    Identical,
    /// The render has samples that are no numbers; nothing was compared.
    NonFinite,
    /// There is no render, or no truth, or they do not fit each other.
    Failed,
}

impl TargetRow {
    /// # Errors
    /// [`EvalError::NotFinite`] for a score or an overlap that is no number.
    pub fn check(&self) -> Result<(), EvalError> {
        finite(&self.key, "overlap", self.overlap)?;
        self.scores.iter().try_for_each(|(id, score)| finite(&self.key, id, [*score]))
    }
}

impl TargetStatus {
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
