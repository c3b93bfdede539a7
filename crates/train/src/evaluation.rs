//! Evaluation of the network on fixed samples, compared with the baseline that copies the nearest context view.

use std::time::Instant;

use atsplat_files::Sha256Digest;
use atsplat_metrics::ssim::{Ssim, ssim};
use atsplat_metrics::{DECIBEL_CAP, Pair, Score, Values, psnr};
use atsplat_model::ImageSize;
use atsplat_model::network::Network;
use atsplat_pixels::Image;
use atsplat_splat::RenderOptions;
use atsplat_splat::cpu::CpuRenderer;
use rayon::prelude::*;

use crate::TrainError;
use crate::config::WHAT;
use crate::logs::EvaluationRecord;
use crate::objective::target_views;
use crate::samples::{PosedImages, Sample, SampleId, Source, digest_of_all, pixel_size};

/// Most memory for the images of an evaluation's samples, which are all kept: 8 GiB.
const MAX_BYTES: u64 = 8 << 30;

/// The fixed samples of an evaluation.
#[derive(Debug)]
pub struct Evaluation {
    samples: Vec<Sample>,
    digest: Sha256Digest,
    background: [f64; 3],
}

/// Scores of one render.
#[derive(Clone, Copy, Debug, Default)]
struct Scores {
    psnr: f64,
    ssim: f64,
    /// If the images are equal: PSNR is then infinite, and capped above.
    is_identical: bool,
}

/// A target with what is compared with it.
pub(crate) struct ScoredTarget {
    pub(crate) render: Image,
    pub(crate) truth: Image,
    scores: Scores,
    /// Those of the nearest context view.
    nearest: Scores,
}

impl ScoredTarget {
    /// PSNR of the render in dB, if means count it: neither the nearest context view nor the render equals the target.
    pub(crate) fn counted_psnr(&self) -> Option<f64> {
        (!self.is_identical()).then_some(self.scores.psnr)
    }

    const fn is_identical(&self) -> bool {
        self.scores.is_identical || self.nearest.is_identical
    }
}

impl Evaluation {
    /// The first samples of a source, at the end of its curriculum.
    ///
    /// # Errors
    /// As [`Source::sample`]; [`TrainError::Malformed`] if this many samples of the first one's size need more than 8 GiB.
    pub fn new(source: &dyn Source, seed: u64, count: u64, background: [f64; 3]) -> Result<Self, TrainError> {
        let sample = |number| {
            let sample = source.sample(SampleId { seed, number, step: u64::MAX });
            sample.map_err(TrainError::of_evaluation)
        };
        let mut samples = Vec::new();
        if count > 0 {
            // If the configuration does not state the size of the images, it is known now.
            let first = sample(0)?;
            let views = first.context.cameras.len() + first.targets.cameras.len();
            require_memory(count, views, first.context.size)?;
            samples.push(first);
        }
        let others: Result<Vec<_>, _> = (1..count).into_par_iter().map(sample).collect();
        samples.extend(others?);
        Ok(Self::from_samples(samples, background))
    }

    /// An evaluation on given samples.
    pub fn from_samples(samples: Vec<Sample>, background: [f64; 3]) -> Self {
        let digests: Vec<Sha256Digest> = samples.par_iter().map(Sample::digest).collect();
        Self { samples, digest: digest_of_all(&digests), background }
    }

    /// The samples.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// A hash of the samples' images, cameras and distances.
    pub const fn digest(&self) -> Sha256Digest {
        self.digest
    }

    /// Scores a network; `step` goes into the record. The result does not depend on the number of threads. Targets that equal their
    /// nearest context view, or whose render equals them, are counted and left out of all means.
    ///
    /// # Errors
    /// [`TrainError::Model`], [`TrainError::Splat`]; [`TrainError::Metric`] for renders that are not finite;
    /// [`TrainError::Malformed`] if no target is left.
    pub fn run(&self, network: &Network, step: u64) -> Result<EvaluationRecord, TrainError> {
        let start = Instant::now();
        // Without the images, of which there may be many.
        let scored = |sample: &Sample| {
            let scored = self.scored(network, sample)?;
            let pairs = scored.iter().map(|target| (target.is_identical(), [target.scores, target.nearest]));
            Ok::<_, TrainError>(pairs.collect::<Vec<(bool, [Scores; 2])>>())
        };
        let scored: Result<Vec<_>, TrainError> = match network.adapter() {
            None => self.samples.par_iter().map(scored).collect(),
            // An adapter runs one sample at a time, with all of its threads.
            Some(_) => self.samples.iter().map(scored).collect(),
        };
        let (identical, scored): (Vec<_>, Vec<_>) = scored?.concat().into_iter().partition(|(identical, _)| *identical);
        if scored.is_empty() {
            let expected = "a target that differs from the context views, such as one of two views with `inset = 1` and `outside = 0`";
            let found = format!("{} identical to their context view or render", identical.len());
            return Err(TrainError::malformed("evaluation", "targets", expected, found));
        }
        let mean = |score: &dyn Fn(&[Scores; 2]) -> f64| {
            scored.iter().map(|(_, pair)| score(pair)).sum::<f64>() / scored.len() as f64
        };
        Ok(EvaluationRecord {
            step,
            psnr: mean(&|[render, _]| render.psnr),
            ssim: mean(&|[render, _]| render.ssim),
            nearest_view_psnr: mean(&|[_, nearest]| nearest.psnr),
            nearest_view_ssim: mean(&|[_, nearest]| nearest.ssim),
            targets: scored.len(),
            identical: identical.len(),
            secs: start.elapsed().as_secs_f64(),
            samples_sha256: Some(self.digest),
        })
    }

    /// Renders the targets of a sample and compares each with the truth, as it does its nearest context view.
    ///
    /// # Errors
    /// As [`Self::renders`]; [`TrainError::Metric`] for renders that are not finite.
    pub(crate) fn scored(&self, network: &Network, sample: &Sample) -> Result<Vec<ScoredTarget>, TrainError> {
        let renders = self.renders(network, sample)?.into_iter().zip(sample.nearest()).enumerate();
        let scored = renders.map(|(target, (render, nearest))| {
            let truth = image(&sample.targets, target)?;
            let (of_render, nearest) = (scores(&render, &truth)?, scores(&image(&sample.context, nearest)?, &truth)?);
            Ok(ScoredTarget { render, truth, scores: of_render, nearest })
        });
        scored.collect()
    }

    /// The network's renders of the targets of a sample. Its images are resized as by the weights of a finished run
    /// ([`Network::input_size`]).
    ///
    /// # Errors
    /// [`TrainError::Model`], [`TrainError::Splat`], [`TrainError::Pixels`].
    pub fn renders(&self, network: &Network, sample: &Sample) -> Result<Vec<Image>, TrainError> {
        let gaussians = network.reconstruct(&sample.context.views()?, 0)?.gaussians;
        let options = RenderOptions { background: self.background, ..RenderOptions::default() };
        let views = target_views(sample, usize::MAX);
        let rendered = CpuRenderer::default().render_many(&gaussians, &views, &options)?;
        let image = |rendering: atsplat_splat::Rendering<f32>| {
            Ok(Image::new(rendering.size.width, rendering.size.height, rendering.rgb.into_flattened())?)
        };
        rendered.into_iter().map(image).collect()
    }
}

/// An error for more samples of this many views than fit into [`MAX_BYTES`].
pub(crate) fn require_memory(samples: u64, views: usize, size: ImageSize) -> Result<(), TrainError> {
    let factors = [views, size.height, size.width, 3, size_of::<f32>()];
    let each = factors.into_iter().fold(1_u64, |product, factor| product.saturating_mul(factor as u64));
    let most = MAX_BYTES / each.max(1);
    if samples <= most {
        return Ok(());
    }
    let expected = format!(
        "at most {most}: they are all kept in memory, {views} views of {size} each, for which 8 GiB are allowed"
    );
    Err(TrainError::malformed(WHAT, "evaluation.samples", expected, samples))
}

/// One image as an image.
pub(crate) fn image(posed: &PosedImages, view: usize) -> Result<Image, TrainError> {
    let size = pixel_size(posed.size);
    Ok(Image::new(size.width, size.height, posed.image(view).to_vec())?)
}

fn scores(render: &Image, truth: &Image) -> Result<Scores, TrainError> {
    let pair = Pair::new(render, truth)?;
    let ssim = ssim(&pair, Values::Clipped, Ssim::SKIMAGE_GAUSSIAN)?;
    let psnr = psnr(&pair, Values::Clipped);
    let is_identical = psnr == Score::Identical;
    #[expect(clippy::expect_used, reason = "`Pair` accepts finite images only")]
    let psnr = psnr.capped(DECIBEL_CAP).expect("finite images have a PSNR");
    Ok(Scores { psnr, ssim, is_identical })
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    /// A difference of 0.1 everywhere has PSNR 20 dB. Two constants have no variance, so that SSIM is its luminance term.
    #[test]
    fn scores_of_constant_images() {
        let constant = |value: f32| Image::new(16, 16, vec![value; 16 * 16 * 3]).unwrap();
        let found = scores(&constant(0.5), &constant(0.6)).unwrap();
        let ssim = (2.0 * 0.5 * 0.6 + 1e-4) / (0.25 + 0.36 + 1e-4);
        Tolerance::absolute(1e-5).assert([found.psnr, found.ssim], [20.0, ssim], "PSNR and SSIM");
    }
}
