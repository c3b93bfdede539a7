use serde::{Deserialize, Serialize};

use super::{Impossible, TrialKey, finite};
use crate::ResultsError;

/// One trial under one method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialRow {
    /// Preset, method, scene and entry.
    #[serde(flatten)]
    pub key: TrialKey,
    /// [`atsplat_protocol::trial::Trial::hash`] in hexadecimal.
    pub trial_hash: String,
    /// [`atsplat_protocol::trial::Trial::pose_hash`] in hexadecimal.
    pub pose_hash: String,
    /// [`atsplat_protocol::trial::Trial::data_hash`] in hexadecimal; `None` in rows of older
    /// versions.
    #[serde(default)]
    pub data_hash: Option<String>,
    /// SHA-256 of an imported method's files, in hexadecimal; `None` for other methods.
    #[serde(default)]
    pub input_hash: Option<String>,
    /// The outcome.
    pub status: TrialStatus,
    /// Why it failed.
    pub detail: Option<String>,
    /// Context frames.
    pub context: Vec<u64>,
    /// SHA-256 of the samples of these frames' images, decoded and preprocessed, in the same order; empty if one could not
    /// be read, and in stores of schema 1.
    #[serde(default)]
    pub context_hashes: Vec<String>,
    /// Number of targets.
    pub targets: u32,
    /// Overlap of the context views, if the index has it.
    pub overlap: Option<f64>,
    /// Width of the images in pixels.
    pub width: u32,
    /// Height of the images in pixels.
    pub height: u32,
    /// Tokens before expansion; `None` for methods without tokens.
    pub initial_tokens: Option<u64>,
    /// Tokens after expansion, which are decoded to Gaussians.
    pub final_tokens: Option<u64>,
    /// All Gaussians; `None` for methods without Gaussians.
    pub gaussians: Option<u64>,
    /// Gaussians that contributed to an image, averaged over the targets.
    pub gaussians_drawn: Option<f64>,
    /// Mean PSNR in dB of an optimisation's last step on each context view; `None` for methods that are not optimised for each
    /// trial, if it is infinite, which a note says, and in rows of older versions.
    #[serde(default)]
    pub context_psnr: Option<f64>,
    /// Estimated peak memory in bytes.
    pub peak_bytes: Option<u64>,
    /// The graphics adapter of the method's network; `None` on the CPU, without a network, and in rows of older versions.
    #[serde(default)]
    pub network_adapter: Option<String>,
    /// The graphics adapter that rendered; `None` on the CPU, without Gaussians, and in rows of older versions.
    #[serde(default)]
    pub renderer_adapter: Option<String>,
    /// Effects that the renderer ran, by name.
    pub effects: Vec<String>,
    /// Remarks for the reader, such as fallbacks of pose normalisation.
    pub notes: Vec<String>,
}

/// Outcome of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrialStatus {
    /// No target failed. Renders with samples that are not finite were not compared, which may be all of them.
    Done,
    /// Some targets failed.
    Partial,
    /// Every target failed.
    Failed,
    /// The method does not support this kind of trial, such as its number of views or a size that its patches do not
    /// divide.
    NotApplicable,
}

impl TrialRow {
    /// # Errors
    /// [`ResultsError::NotFinite`] for an overlap or a mean that is not finite, [`ResultsError::Impossible`] for one outside its range.
    pub fn check(&self) -> Result<(), ResultsError> {
        finite(&self.key, "overlap", self.overlap)?;
        finite(&self.key, "gaussians-drawn", self.gaussians_drawn)?;
        finite(&self.key, "context-psnr", self.context_psnr)?;
        self.impossible().map_or(Ok(()), |found| Err(found.of_row(&self.key)))
    }

    /// The first field with an impossible value.
    pub(crate) fn impossible(&self) -> Option<Impossible> {
        let drawn = || Impossible::unless_within("gaussians-drawn", self.gaussians_drawn, [0.0, f64::INFINITY]);
        Impossible::unless_within("overlap", self.overlap, [0.0, 1.0]).or_else(drawn)
    }

    /// Whether no Gaussian contributes to the render of any target.
    pub fn renders_nothing(&self) -> bool {
        self.gaussians_drawn.is_some_and(|drawn| drawn <= 0.0)
    }
}

impl TrialStatus {
    /// The status of this name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Done, Self::Partial, Self::Failed, Self::NotApplicable].into_iter().find(|status| status.name() == name)
    }

    /// Whether targets lack a number that they should have: not if the method does not support the trial.
    pub const fn is_incomplete(self) -> bool {
        matches!(self, Self::Partial | Self::Failed)
    }

    /// The name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Partial => "partial",
            Self::Failed => "failed",
            Self::NotApplicable => "not-applicable",
        }
    }
}
