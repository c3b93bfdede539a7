//! One sample's loss and its gradient by every parameter.

use std::time::Instant;

use atsplat_camera::ImageSize;
use atsplat_model::network::{GaussianTensors, Network, RenderedTensors};
use atsplat_splat::{Channels, GradientReach, RenderOptions, View};
use burn::Tensor;
use burn::tensor::TensorData;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use crate::config::LossConfig;
use crate::fault::FaultKind;
use crate::losses::{Perceptual, Stack, d_ssim, mse, uncertainty};
use crate::samples::Sample;
use crate::{FeatureCache, TrainError};

/// What a sample costs, term by term, unweighted but for the total; means over sets where there are several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Terms {
    /// All terms with their weights.
    pub total: f64,
    /// Of the final renders.
    pub mse: f64,
    /// Of the final renders.
    pub perceptual: f64,
    /// Sum over the intermediate sets.
    pub intermediate_mse: f64,
    /// Sum over the intermediate sets.
    pub intermediate_d_ssim: f64,
    /// Sum over the intermediate sets.
    pub uncertainty: f64,
}

impl Terms {
    /// Each term by name.
    pub const fn named(&self) -> [(&'static str, f64); 6] {
        let Self { total, mse, perceptual, intermediate_mse, intermediate_d_ssim, uncertainty } = *self;
        [
            ("mse", mse),
            ("perceptual", perceptual),
            ("intermediate-mse", intermediate_mse),
            ("intermediate-d-ssim", intermediate_d_ssim),
            ("uncertainty", uncertainty),
            ("total", total),
        ]
    }

    /// The mean of several, in their order.
    pub fn mean(all: &[Self]) -> Self {
        let of = |term: fn(&Self) -> f64| all.iter().map(term).sum::<f64>() / all.len().max(1) as f64;
        Self {
            total: of(|terms| terms.total),
            mse: of(|terms| terms.mse),
            perceptual: of(|terms| terms.perceptual),
            intermediate_mse: of(|terms| terms.intermediate_mse),
            intermediate_d_ssim: of(|terms| terms.intermediate_d_ssim),
            uncertainty: of(|terms| terms.uncertainty),
        }
    }
}

/// Wall-clock seconds of the parts of one sample's step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Seconds {
    /// Making the sample.
    pub sample: f64,
    /// The network, forward.
    pub forward: f64,
    /// The splatter, forward, all sets.
    pub splat: f64,
    /// Losses and their gradients by pictures.
    pub losses: f64,
    /// Splatter and network, backward.
    pub backward: f64,
}

impl Seconds {
    /// Of several samples.
    pub fn sum(all: impl Iterator<Item = Self>) -> Self {
        all.fold(Self::default(), |a, b| Self {
            sample: a.sample + b.sample,
            forward: a.forward + b.forward,
            splat: a.splat + b.splat,
            losses: a.losses + b.losses,
            backward: a.backward + b.backward,
        })
    }
}

/// What one sample teaches.
#[derive(Clone, Debug, Default)]
pub struct Lesson {
    /// Its loss.
    pub terms: Terms,
    /// By parameter, in files' layout; a parameter that nothing depends on is absent.
    pub gradients: IndexMap<String, Vec<f32>>,
    /// Where time went.
    pub seconds: Seconds,
}

/// The loss of a configuration.
#[derive(Debug)]
pub struct Objective {
    config: LossConfig,
    perceptual: Perceptual,
}

impl Objective {
    /// Of a configuration; reads the weights of a learned perceptual loss.
    ///
    /// # Errors
    /// As [`Perceptual::new`].
    pub fn new(config: LossConfig) -> Result<Self, TrainError> {
        let perceptual = Perceptual::new(&config.perceptual)?;
        Ok(Self { config, perceptual })
    }

    /// The perceptual term, for provenance.
    pub fn perceptual(&self) -> String {
        self.perceptual.name()
    }

    /// Runs the network on a sample, renders every set of Gaussians, and goes back. The network must have been made with
    /// a device that differentiates. A frozen backbone's `features` come from there. `call_seed` is what random selection
    /// draws with.
    ///
    /// # Errors
    /// [`FaultKind`] where the step is of no use; nothing was changed.
    pub fn learn(
        &self,
        network: &Network,
        sample: &Sample,
        features: Option<&FeatureCache>,
        call_seed: u64,
    ) -> Result<Lesson, FaultKind> {
        finite_pictures(sample)?;
        let mut clock = Clock::start();
        let mut lesson = Lesson::default();
        let views = match features {
            Some(features) => features.views(network, &sample.context),
            None => sample.context.views(),
        };
        let views = views.map_err(|error| FaultKind::Refused(error.to_string()))?;
        let forward = network.forward(&[views], call_seed).map_err(|error| FaultKind::Refused(error.to_string()))?;
        lesson.seconds.forward = clock.lap();

        let mut pulls = Pulls { sum: None };
        self.last(&forward.gaussians, sample, &mut lesson, &mut clock, &mut pulls)?;
        for pair in forward.blocks.windows(2) {
            let [block, next] = pair else { continue };
            let gaussians = network.gaussians(&block.tokens);
            let scores = next.expanded.as_ref().and_then(|expanded| expanded.scores.clone());
            self.intermediate(&gaussians, scores, sample, &mut lesson, &mut clock, &mut pulls)?;
        }
        if let Some((name, _)) = lesson.terms.named().into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(FaultKind::Term(name));
        }
        if let Some(pulled) = pulls.sum {
            lesson.gradients = network.gradients(&pulled.backward());
        }
        lesson.seconds.backward = clock.lap();
        let broken = lesson.gradients.iter().filter(|(_, values)| values.iter().any(|value| !value.is_finite()));
        let broken: Vec<String> = broken.map(|(name, _)| name.clone()).take(4).collect();
        if broken.is_empty() { Ok(lesson) } else { Err(FaultKind::Gradients(broken)) }
    }

    /// The final Gaussians: `MSE + λp · perceptual`.
    fn last(
        &self,
        gaussians: &GaussianTensors,
        sample: &Sample,
        lesson: &mut Lesson,
        clock: &mut Clock,
        pulls: &mut Pulls,
    ) -> Result<(), FaultKind> {
        let (truth, stack) = (&sample.targets.pictures, sample.targets.stack());
        let images = self.render(gaussians, sample, stack, None)?;
        lesson.seconds.splat += clock.lap();
        let rgb = numbers(&images.rgb);
        let mut loss = mse(&rgb, truth);
        lesson.terms.mse = loss.value;
        if self.config.perceptual_weight > 0.0 {
            let perceptual = self.perceptual.evaluate(&rgb, truth, stack);
            lesson.terms.perceptual = perceptual.value;
            loss.add(&perceptual, self.config.perceptual_weight);
        }
        lesson.terms.total += loss.value;
        pulls.add(&images.rgb, &loss.gradient, 1.0);
        lesson.seconds.losses += clock.lap();
        Ok(())
    }

    /// The Gaussians of a block before the last: `λint · (MSE + λs · D-SSIM) + λunc · uncertainty`.
    fn intermediate(
        &self,
        gaussians: &GaussianTensors,
        scores: Option<Tensor<2>>,
        sample: &Sample,
        lesson: &mut Lesson,
        clock: &mut Clock,
        pulls: &mut Pulls,
    ) -> Result<(), FaultKind> {
        let all = sample.targets.stack();
        let stack = Stack {
            views: self.config.intermediate_targets.map_or(all.views, |most| most.get().min(all.views)),
            ..all
        };
        let truth = sample.targets.pictures.get(..stack.samples()).unwrap_or_default();
        let scores = scores.filter(|_| self.config.uncertainty_weight > 0.0);
        if scores.is_none() && self.config.intermediate_weight <= 0.0 {
            return Ok(());
        }
        let images = self.render(gaussians, sample, stack, scores)?;
        lesson.seconds.splat += clock.lap();
        let rgb = numbers(&images.rgb);
        let dissimilarity = d_ssim(&rgb, truth, stack);
        let mut loss = mse(&rgb, truth);
        lesson.terms.intermediate_mse += loss.value;
        lesson.terms.intermediate_d_ssim += dissimilarity.loss.value;
        loss.add(&dissimilarity.loss, self.config.intermediate_d_ssim_weight);
        lesson.terms.total += self.config.intermediate_weight * loss.value;
        if self.config.intermediate_weight > 0.0 {
            pulls.add(&images.rgb, &loss.gradient, self.config.intermediate_weight);
        }
        if let Some(map) = &images.scalar {
            let loss = uncertainty(&numbers(map), &dissimilarity.map);
            lesson.terms.uncertainty += loss.value;
            lesson.terms.total += self.config.uncertainty_weight * loss.value;
            pulls.add(map, &loss.gradient, self.config.uncertainty_weight);
        }
        lesson.seconds.losses += clock.lap();
        Ok(())
    }

    /// Renders to the first of a sample's targets; scores of tokens go to all Gaussians of their token.
    fn render(
        &self,
        gaussians: &GaussianTensors,
        sample: &Sample,
        stack: Stack,
        scores: Option<Tensor<2>>,
    ) -> Result<RenderedTensors, FaultKind> {
        let [_, count, _] = gaussians.means.dims();
        let scalars = scores.map(|scores| {
            let [_, tokens] = scores.dims();
            scores.unsqueeze_dim::<3>(2).repeat_dim(2, count / tokens.max(1)).reshape([count])
        });
        let options = RenderOptions {
            background: self.config.background,
            channels: Channels { scalar: scalars.is_some(), ..Channels::default() },
            gradients: GradientReach { scalar_stops: true, ..GradientReach::default() },
            ..RenderOptions::default()
        };
        let views = target_views(sample, stack.views);
        gaussians.render(0, &views, &options, scalars).map_err(|error| FaultKind::Refused(error.to_string()))
    }
}

/// The first targets of a sample, as the renderer takes them.
pub(crate) fn target_views(sample: &Sample, count: usize) -> Vec<View> {
    let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
    let size = ImageSize { width: side(sample.targets.size.width), height: side(sample.targets.size.height) };
    sample.targets.cameras.iter().take(count).map(|&camera| View { camera, size }).collect()
}

fn finite_pictures(sample: &Sample) -> Result<(), FaultKind> {
    for (what, posed) in [("context", &sample.context), ("target", &sample.targets)] {
        let broken = (0..posed.cameras.len()).find(|view| posed.picture(*view).iter().any(|value| !value.is_finite()));
        if let Some(view) = broken {
            return Err(FaultKind::Picture(format!("{what} picture {view}")));
        }
    }
    Ok(())
}

/// What the backward pass starts from: `Σ weight · image · gradient`, whose derivative by an image is its gradient.
struct Pulls {
    sum: Option<Tensor<1>>,
}

impl Pulls {
    #[expect(clippy::cast_possible_truncation, reason = "weights are moderate numbers")]
    fn add<const D: usize>(&mut self, image: &Tensor<D>, gradient: &[f32], weight: f64) {
        let gradient: Vec<f32> = gradient.iter().map(|value| value * weight as f32).collect();
        let gradient = Tensor::<D>::from_data(TensorData::new(gradient, image.dims()), &image.device());
        let pull = (image.clone() * gradient).sum();
        self.sum = Some(match self.sum.take() {
            Some(sum) => sum + pull,
            None => pull,
        });
    }
}

/// Time since it was last asked.
struct Clock(Instant);

impl Clock {
    fn start() -> Self {
        Self(Instant::now())
    }

    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let seconds = (now - self.0).as_secs_f64();
        self.0 = now;
        seconds
    }
}

pub(crate) fn numbers<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.clone().into_data_as::<f32>().as_slice::<f32>().unwrap_or_default().to_vec()
}
