use std::collections::BTreeMap;

use atsplat_files::Sha256Digest;
use atsplat_numeric::Extremes as _;
use atsplat_pixels::{Image, ImageU8};
use atsplat_splat::{GaussianParts, Gaussians};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::limit_scene::limit_view;
use super::{Inputs, Stage, Stages, View, container};
use crate::DriftError;

/// The outputs of all stages with the inputs of the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Outputs {
    /// Inputs of the first stage.
    pub inputs: Inputs,
    /// Output of [`Stage::Decode`].
    pub decoded: Vec<ImageU8>,
    /// Output of [`Stage::Resize`].
    pub views: Vec<View>,
    /// Output of [`Stage::Model`].
    pub gaussians: Gaussians,
    /// Output of [`Stage::Renderer`] for each target.
    pub renders: Vec<Image>,
    /// Output of [`Stage::Renderer`] for [`Inputs::limit_scene`], which is not scored.
    pub limit_render: Image,
    /// Output of [`Stage::Metric`] for each target.
    pub scores: Vec<BTreeMap<String, f64>>,
}

/// A human-readable summary of a stage's output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Fingerprint {
    /// Which stage.
    pub stage: Stage,
    /// SHA-256 of its values as little-endian f64.
    pub sha256: String,
    /// Number of values.
    pub values: u64,
    /// Smallest value; `None` without values, or if one is NaN or infinite, which JSON cannot represent.
    #[serde(alias = "least")]
    pub min: Option<f64>,
    /// Mean value; `None` likewise.
    pub mean: Option<f64>,
    /// Largest value; `None` likewise.
    #[serde(alias = "most")]
    pub max: Option<f64>,
}

/// Runs all stages.
///
/// # Errors
/// [`DriftError::Stage`] of the first stage that fails.
pub fn run(stages: &dyn Stages, inputs: &Inputs) -> Result<Outputs, DriftError> {
    let decoded = inputs.files.iter().map(|file| stages.decode(file)).collect::<Result<Vec<_>, _>>()?;
    let views = resized(stages, inputs, &decoded)?;
    let gaussians = stages.model(context(inputs, &views)?)?;
    let renders = rendered(stages, &gaussians, targets(inputs, &views)?)?;
    let scores = scored(stages, &renders, targets(inputs, &views)?)?;
    let limit_render = stages.render(&inputs.limit_scene, &limit_view()?)?;
    Ok(Outputs { inputs: inputs.clone(), decoded, views, gaussians, renders, limit_render, scores })
}

pub(super) fn resized(stages: &dyn Stages, inputs: &Inputs, decoded: &[ImageU8]) -> Result<Vec<View>, DriftError> {
    let view = |(image, camera): (&ImageU8, _)| stages.resize(&View { image: image.clone(), camera });
    decoded.iter().zip(inputs.cameras.iter().copied()).map(view).collect()
}

pub(super) fn rendered(stages: &dyn Stages, gaussians: &Gaussians, targets: &[View]) -> Result<Vec<Image>, DriftError> {
    targets.iter().map(|target| stages.render(gaussians, target)).collect()
}

pub(super) fn scored(
    stages: &dyn Stages,
    renders: &[Image],
    targets: &[View],
) -> Result<Vec<BTreeMap<String, f64>>, DriftError> {
    renders.iter().zip(targets).map(|(render, target)| stages.score(render, &target.image)).collect()
}

/// The context views.
pub(super) fn context<'a>(inputs: &Inputs, views: &'a [View]) -> Result<&'a [View], DriftError> {
    views.get(..inputs.context).ok_or_else(|| too_few_views(inputs, views))
}

/// The target views.
pub(super) fn targets<'a>(inputs: &Inputs, views: &'a [View]) -> Result<&'a [View], DriftError> {
    views.get(inputs.context..).ok_or_else(|| too_few_views(inputs, views))
}

fn too_few_views(inputs: &Inputs, views: &[View]) -> DriftError {
    DriftError::invalid("the probe's views", format!("at least {}, its context", inputs.context), views.len())
}

impl Outputs {
    /// Parses the bytes of [`Self::to_bytes`].
    ///
    /// # Errors
    /// [`DriftError::Invalid`] naming the missing or invalid tensor.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, DriftError> {
        container::read(bytes)
    }

    /// Serialises to safetensors: every stage's values under its name, in their type.
    ///
    /// # Errors
    /// [`DriftError::Invalid`] if the format cannot represent the values.
    pub fn to_bytes(&self) -> Result<Vec<u8>, DriftError> {
        container::write(self)
    }

    /// The fingerprint of every stage.
    pub fn fingerprints(&self) -> Vec<Fingerprint> {
        Stage::PROBED.map(|stage| fingerprint(stage, &self.parts(stage).concat())).to_vec()
    }

    /// The mean of each score over targets.
    pub fn mean_scores(&self) -> BTreeMap<String, f64> {
        mean_scores(&self.scores)
    }

    /// A stage's output as numbers, in parts of one kind each.
    pub(super) fn parts(&self, stage: Stage) -> Vec<Vec<f64>> {
        match stage {
            Stage::Data => vec![self.inputs.files.iter().flatten().map(|&byte| f64::from(byte)).collect()],
            Stage::Decode => vec![image_values(&self.decoded)],
            Stage::Resize => vec![view_values(&self.views)],
            Stage::Model => gaussian_values(&self.gaussians),
            Stage::Renderer => vec![render_values(&self.renders, &self.limit_render)],
            Stage::Metric => vec![score_values(&self.scores)],
        }
    }
}

pub(super) fn mean_scores(scores: &[BTreeMap<String, f64>]) -> BTreeMap<String, f64> {
    let mut means: BTreeMap<String, f64> = BTreeMap::new();
    for (id, score) in scores.iter().flatten() {
        *means.entry(id.clone()).or_default() += score / scores.len() as f64;
    }
    means
}

pub(super) fn image_values(images: &[ImageU8]) -> Vec<f64> {
    images.iter().flat_map(ImageU8::samples).map(|&sample| f64::from(sample)).collect()
}

/// Samples, then intrinsics; the stage changes both.
pub(super) fn view_values(views: &[View]) -> Vec<f64> {
    let k = |view: &View| {
        let k = view.camera.intrinsics;
        [k.fx, k.fy, k.cx, k.cy]
    };
    let samples = views.iter().flat_map(|view| view.image.samples()).map(|&sample| f64::from(sample));
    samples.chain(views.iter().flat_map(k)).collect()
}

/// Means, quaternions, logarithmic scales, opacity logits and harmonics.
pub(super) fn gaussian_values(gaussians: &Gaussians) -> Vec<Vec<f64>> {
    let GaussianParts { means, quaternions, log_scales, opacity_logits, sh, .. } = gaussians.parts();
    let parts = [
        means.as_flattened(),
        quaternions.as_flattened(),
        log_scales.as_flattened(),
        opacity_logits.as_slice(),
        sh.as_flattened(),
    ];
    parts.map(|part| part.iter().map(|&value| f64::from(value)).collect::<Vec<f64>>()).into()
}

pub(super) fn render_values(renders: &[Image], limit_render: &Image) -> Vec<f64> {
    renders.iter().chain([limit_render]).flat_map(Image::samples).map(|&sample| f64::from(sample)).collect()
}

pub(super) fn score_values(scores: &[BTreeMap<String, f64>]) -> Vec<f64> {
    scores.iter().flat_map(|scores| scores.values().copied()).collect()
}

fn fingerprint(stage: Stage, values: &[f64]) -> Fingerprint {
    let mut hash = Sha256::new();
    let (mut min, mut max, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
    for value in values {
        hash.update(value.to_le_bytes());
        (min, max, sum) = (min.minimum_of(*value), max.maximum_of(*value), sum + value);
    }
    let sha256 = Sha256Digest::finish(hash).to_string();
    let [min, mean, max] =
        [min, sum / values.len() as f64, max].map(|value| Some(value).filter(|value| value.is_finite()));
    Fingerprint { stage, sha256, values: values.len() as u64, min, mean, max }
}
