//! A probe: one tiny trial whose every stage a baseline remembers, so that a moved number can be traced to its stage.
//!
//! Five stages turn [`Inputs`] into scores: decode, resize, model, splatter, metric. A baseline holds what each gave
//! ([`Outputs`]); [`attribute`] runs today's stages on yesterday's outputs. The inputs are the baseline's own, so the stage
//! before them, the data, is not the probe's: [`super::DataComparison`] has it from the rows of the runs themselves.

mod attribution;
mod container;
mod inputs;
mod outputs;
mod pipeline;
mod recipe;
mod sheet;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub use attribution::{Attribution, MetricEffect, StageChange, StageVerdict, attribute};
pub use inputs::{Inputs, View};
pub use outputs::{Fingerprint, Outputs, run};
pub use pipeline::Pipeline;
pub use recipe::{ProbeWeights, Recipe};

use super::DriftError;

/// A part of the way from files to a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// The files themselves; not on the probe, which brings its own.
    Data,
    /// Bytes of files into pictures.
    Decode,
    /// Pictures and intrinsics into those of the protocol.
    Resize,
    /// Context views into Gaussians.
    Model,
    /// Gaussians and a camera into a picture.
    Splatter,
    /// A picture and the truth into scores.
    Metric,
}

impl Stage {
    /// Those that a probe runs, in the order of the data.
    pub const PROBED: [Self; 5] = [Self::Decode, Self::Resize, Self::Model, Self::Splatter, Self::Metric];

    /// The name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Decode => "decode",
            Self::Resize => "resize",
            Self::Model => "model",
            Self::Splatter => "splatter",
            Self::Metric => "metric",
        }
    }

    fn failed(self) -> impl FnOnce(&dyn std::fmt::Display) -> DriftError {
        move |reason| DriftError::Stage { stage: self.name(), reason: reason.to_string() }
    }
}

/// What the stages are; [`Pipeline`] is what this atsplat does.
pub trait Stages {
    /// [`Stage::Decode`].
    ///
    /// # Errors
    /// [`DriftError::Stage`], here and below.
    fn decode(&self, bytes: &[u8]) -> Result<atsplat_pixels::ImageU8, DriftError>;
    /// [`Stage::Resize`].
    ///
    /// # Errors
    /// [`DriftError::Stage`].
    fn resize(&self, view: &View) -> Result<View, DriftError>;
    /// [`Stage::Model`].
    ///
    /// # Errors
    /// [`DriftError::Stage`].
    fn model(&self, context: &[View]) -> Result<atsplat_splat::Gaussians, DriftError>;
    /// [`Stage::Splatter`]: what `target` would show; its picture is not looked at.
    ///
    /// # Errors
    /// [`DriftError::Stage`].
    fn splat(&self, gaussians: &atsplat_splat::Gaussians, target: &View) -> Result<atsplat_pixels::Image, DriftError>;
    /// [`Stage::Metric`]: finite scores by id.
    ///
    /// # Errors
    /// [`DriftError::Stage`].
    fn score(
        &self,
        render: &atsplat_pixels::Image,
        truth: &atsplat_pixels::ImageU8,
    ) -> Result<std::collections::BTreeMap<String, f64>, DriftError>;
}
