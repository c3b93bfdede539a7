use serde::{Deserialize, Serialize};

use super::{TrialKey, finite};
use crate::EvalError;

/// One trial under one method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialRow {
    /// Which trial.
    #[serde(flatten)]
    pub key: TrialKey,
    /// [`atsplat_protocol::trial::Trial::hash`] in hexadecimal.
    pub trial_hash: String,
    /// [`atsplat_protocol::trial::Trial::pose_hash`] in hexadecimal.
    pub pose_hash: String,
    /// [`atsplat_protocol::trial::Trial::data_hash`] in hexadecimal; `None` in rows that were written before there was one.
    #[serde(default)]
    pub data_hash: Option<String>,
    /// SHA-256 of the files that the method brought its answer in, in hexadecimal; `None` for methods that bring none.
    #[serde(default)]
    pub input_hash: Option<String>,
    /// What became of it.
    pub status: TrialStatus,
    /// Why it failed.
    pub detail: Option<String>,
    /// Frames that the method was given.
    pub context: Vec<u64>,
    /// SHA-256 of the samples of the pictures of these frames, decoded and preprocessed, in the same order; empty where one
    /// could not be read, and in stores of schema 1.
    #[serde(default)]
    pub context_hashes: Vec<String>,
    /// How many targets it was asked for.
    pub targets: u32,
    /// Overlap of the context views, where the index has one.
    pub overlap: Option<f64>,
    /// Width of the pictures in pixels.
    pub width: u32,
    /// Height of the pictures in pixels.
    pub height: u32,
    /// Tokens before expansion; `None` for methods without tokens.
    pub initial_tokens: Option<u64>,
    /// Tokens that became Gaussians.
    pub final_tokens: Option<u64>,
    /// Gaussians, all of them; `None` for methods without.
    pub gaussians: Option<u64>,
    /// Gaussians that reached a picture, averaged over the targets.
    pub gaussians_drawn: Option<f64>,
    /// Estimated peak of memory in bytes.
    pub peak_bytes: Option<u64>,
    /// Effects that the renderer ran, by name.
    pub effects: Vec<String>,
    /// What a reader must know: pose normalisations that fell back, and the like.
    pub notes: Vec<String>,
}

/// What became of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrialStatus {
    /// Every target has a row that was compared.
    Done,
    /// Some targets failed.
    Partial,
    /// The method made nothing.
    Failed,
    /// The method does not answer this kind of trial, and says so: another number of views, a size that its patches do
    /// not divide.
    NotApplicable,
}

impl TrialRow {
    /// # Errors
    /// [`EvalError::NotFinite`] for an overlap or a mean that is no number.
    pub fn check(&self) -> Result<(), EvalError> {
        finite(&self.key, "overlap", self.overlap)?;
        finite(&self.key, "gaussians-drawn", self.gaussians_drawn)
    }
}

impl TrialStatus {
    /// The status of this name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Done, Self::Partial, Self::Failed, Self::NotApplicable].into_iter().find(|status| status.name() == name)
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
