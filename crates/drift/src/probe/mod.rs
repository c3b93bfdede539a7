//! A probe: one tiny trial with the outputs of all stages stored in a baseline, to trace a changed number to its stage.
//!
//! Five stages turn [`Inputs`] into scores: decode, resize, model, renderer, metric. A baseline contains each stage's output
//! ([`Outputs`]); [`attribute`] runs the current stages on the baseline's outputs. The inputs are stored in the baseline, so
//! the probe does not cover the data; [`super::DataComparison`] compares it by the rows of the runs.

mod attribution;
mod container;
mod inputs;
mod limit_scene;
mod outputs;
mod pipeline;
mod recipe;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use atsplat_pixels::{Image, ImageU8};
use atsplat_splat::Gaussians;
use serde::{Deserialize, Serialize};

pub use attribution::{Attribution, MetricEffect, StageChange, StageVerdict, attribute};
pub use inputs::{Inputs, View};
pub use outputs::{Fingerprint, Outputs, run};
pub use pipeline::Pipeline;
pub use recipe::{ProbeWeights, Recipe};

use super::DriftError;

/// A stage of the pipeline from files to a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// The input files; not part of the probe, whose inputs are embedded.
    Data,
    /// Decodes files to images.
    Decode,
    /// Resizes images and intrinsics as the protocol says.
    Resize,
    /// Reconstructs Gaussians from context views.
    Model,
    /// Renders Gaussians; files have its older name, `splatter`.
    #[serde(rename = "splatter")]
    Renderer,
    /// Scores a render against the ground truth.
    Metric,
}

impl Stage {
    /// The stages of a probe, in pipeline order.
    pub const PROBED: [Self; 5] = [Self::Decode, Self::Resize, Self::Model, Self::Renderer, Self::Metric];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Decode => "decode",
            Self::Resize => "resize",
            Self::Model => "model",
            Self::Renderer => "renderer",
            Self::Metric => "metric",
        }
    }

    fn failed(self) -> impl FnOnce(&dyn std::fmt::Display) -> DriftError {
        move |reason| DriftError::Stage { stage: self.name(), reason: reason.to_string() }
    }
}

/// An implementation of the stages; [`Pipeline`] is the current one.
#[expect(clippy::missing_errors_doc, reason = "every stage fails with DriftError::Stage")]
pub trait Stages {
    /// [`Stage::Decode`].
    fn decode(&self, bytes: &[u8]) -> Result<ImageU8, DriftError>;
    /// [`Stage::Resize`].
    fn resize(&self, view: &View) -> Result<View, DriftError>;
    /// [`Stage::Model`].
    fn model(&self, context: &[View]) -> Result<Gaussians, DriftError>;
    /// [`Stage::Renderer`]: renders the view of `target`, whose image is ignored.
    fn render(&self, gaussians: &Gaussians, target: &View) -> Result<Image, DriftError>;
    /// [`Stage::Metric`]: finite scores by id.
    fn score(&self, render: &Image, truth: &ImageU8) -> Result<BTreeMap<String, f64>, DriftError>;
}
