//! The loss of one sample and its gradient with respect to every parameter.

use std::time::Instant;

use atsplat_model::network::{GaussianTensors, Network, RenderedTensors, f32_values};
use atsplat_splat::{Channels, GradientReach, RenderOptions, View};
use burn::Tensor;
use burn::tensor::TensorData;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use crate::config::LossConfig;
use crate::fault::FaultKind;
use crate::losses::{Perceptual, Stack, d_ssim, log_distance, mse, uncertainty};
use crate::samples::{Sample, pixel_size};
use crate::{FeatureCache, TrainError};

/// The loss of a sample, term by term, unweighted except for the total; a mean over samples in a step's record.
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
    /// Of the anchors, where exact distances are known.
    #[serde(default)]
    pub distance: f64,
}

impl Terms {
    /// Each term by name.
    pub const fn named(&self) -> [(&'static str, f64); 7] {
        let Self { total, mse, perceptual, intermediate_mse, intermediate_d_ssim, uncertainty, distance } = *self;
        [
            ("mse", mse),
            ("perceptual", perceptual),
            ("intermediate-mse", intermediate_mse),
            ("intermediate-d-ssim", intermediate_d_ssim),
            ("uncertainty", uncertainty),
            ("distance", distance),
            ("total", total),
        ]
    }

    /// The mean, summed in the given order.
    pub fn mean(all: &[Self]) -> Self {
        let of = |term: fn(&Self) -> f64| all.iter().map(term).sum::<f64>() / all.len().max(1) as f64;
        Self {
            total: of(|terms| terms.total),
            mse: of(|terms| terms.mse),
            perceptual: of(|terms| terms.perceptual),
            intermediate_mse: of(|terms| terms.intermediate_mse),
            intermediate_d_ssim: of(|terms| terms.intermediate_d_ssim),
            uncertainty: of(|terms| terms.uncertainty),
            distance: of(|terms| terms.distance),
        }
    }
}

/// Wall-clock seconds that one sample took, by part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PartSeconds {
    /// Making the sample.
    pub sample: f64,
    /// The network, forward.
    pub forward: f64,
    /// The splatter, forward, all sets.
    pub splat: f64,
    /// Losses and their gradients with respect to the pictures.
    pub losses: f64,
    /// Splatter and network, backward.
    pub backward: f64,
}

impl PartSeconds {
    /// The sum over several samples.
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

/// The loss of one sample and its gradients.
#[derive(Clone, Debug, Default)]
pub struct SampleGradients {
    /// The loss.
    pub terms: Terms,
    /// By parameter name, in the layout of weights files; a parameter that the loss does not depend on is absent.
    pub gradients: IndexMap<String, Vec<f32>>,
    /// Time taken.
    pub seconds: PartSeconds,
}

/// The training loss of a configuration.
#[derive(Debug)]
pub struct Objective {
    config: LossConfig,
    perceptual: Perceptual,
}

impl Objective {
    /// The loss of a configuration; reads the weights of a learned perceptual loss.
    ///
    /// # Errors
    /// As [`Perceptual::new`].
    pub fn new(config: LossConfig) -> Result<Self, TrainError> {
        let perceptual = Perceptual::new(&config.perceptual)?;
        Ok(Self { config, perceptual })
    }

    /// Name of the perceptual term, for provenance.
    pub fn perceptual(&self) -> String {
        self.perceptual.name()
    }

    /// Runs the network on a sample, renders every set of Gaussians, and propagates back. The network must be on an
    /// autodiff device. `features` is the cache of a frozen backbone's features; `call_seed` seeds random selection; `share`
    /// of the run is done.
    ///
    /// # Errors
    /// [`FaultKind`] if the step cannot be used; nothing is changed.
    pub fn gradients(
        &self,
        network: &Network,
        sample: &Sample,
        features: Option<&FeatureCache>,
        call_seed: u64,
        share: f64,
    ) -> Result<SampleGradients, FaultKind> {
        finite_pictures(sample)?;
        let mut clock = Clock::start();
        let mut result = SampleGradients::default();
        let views = match features {
            Some(features) => features.views(network, &sample.context),
            None => sample.context.views(),
        };
        let views = views.map_err(|error| FaultKind::Refused(error.to_string()))?;
        let forward = network.forward(&[views], call_seed).map_err(|error| FaultKind::Refused(error.to_string()))?;
        result.seconds.forward = clock.lap();

        let mut backward = WeightedGradients::default();
        let weight = self.config.distance_weight_at(share);
        if weight > 0.0 {
            let (Some(distances), Some(exact)) = (&forward.initial.depths, &sample.distances) else {
                let missing = "losses.distance-weight: the network has no anchors, or the sample no exact distances";
                return Err(FaultKind::Refused(missing.to_owned()));
            };
            let loss = log_distance(&f32_values(distances.clone()), &exact.distances);
            result.terms.distance = loss.value;
            result.terms.total += weight * loss.value;
            backward.add(distances, &loss.gradient, weight);
        }
        self.add_final(&forward.gaussians, sample, &mut result, &mut clock, &mut backward)?;
        for pair in forward.blocks.windows(2) {
            let [block, next] = pair else { continue };
            let gaussians = network.gaussians(&block.tokens);
            let scores = next.expanded.as_ref().and_then(|expanded| expanded.scores.clone());
            self.add_intermediate(&gaussians, scores, sample, &mut result, &mut clock, &mut backward)?;
        }
        if let Some((name, _)) = result.terms.named().into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(FaultKind::Term(name));
        }
        if let Some(sum) = backward.sum {
            result.gradients = network.gradients(&sum.backward());
        }
        result.seconds.backward = clock.lap();
        let broken = result.gradients.iter().filter(|(_, values)| values.iter().any(|value| !value.is_finite()));
        let broken: Vec<String> = broken.map(|(name, _)| name.clone()).take(4).collect();
        if broken.is_empty() { Ok(result) } else { Err(FaultKind::Gradients(broken)) }
    }

    /// Adds the loss of the final Gaussians: `MSE + λp · perceptual`.
    fn add_final(
        &self,
        gaussians: &GaussianTensors,
        sample: &Sample,
        result: &mut SampleGradients,
        clock: &mut Clock,
        backward: &mut WeightedGradients,
    ) -> Result<(), FaultKind> {
        let (truth, stack) = (&sample.targets.pictures, sample.targets.stack());
        let images = self.render(gaussians, sample, stack, None)?;
        result.seconds.splat += clock.lap();
        let rgb = f32_values(images.rgb.clone());
        let mut loss = mse(&rgb, truth);
        result.terms.mse = loss.value;
        if self.config.perceptual_weight > 0.0 {
            let perceptual = self.perceptual.evaluate(&rgb, truth, stack);
            result.terms.perceptual = perceptual.value;
            loss.add(&perceptual, self.config.perceptual_weight);
        }
        result.terms.total += loss.value;
        backward.add(&images.rgb, &loss.gradient, 1.0);
        result.seconds.losses += clock.lap();
        Ok(())
    }

    /// Adds the loss of the Gaussians of a block before the last: `λint · (MSE + λs · D-SSIM) + λunc · uncertainty`.
    fn add_intermediate(
        &self,
        gaussians: &GaussianTensors,
        scores: Option<Tensor<2>>,
        sample: &Sample,
        result: &mut SampleGradients,
        clock: &mut Clock,
        backward: &mut WeightedGradients,
    ) -> Result<(), FaultKind> {
        let all = sample.targets.stack();
        let stack = Stack {
            views: self.config.intermediate_targets.map_or(all.views, |most| most.get().min(all.views)),
            ..all
        };
        #[expect(clippy::expect_used, reason = "the stack holds at most all of the sample's targets")]
        let truth = sample.targets.pictures.get(..stack.samples()).expect("a prefix of the targets");
        let scores = scores.filter(|_| self.config.uncertainty_weight > 0.0);
        if scores.is_none() && self.config.intermediate_weight <= 0.0 {
            return Ok(());
        }
        let images = self.render(gaussians, sample, stack, scores)?;
        result.seconds.splat += clock.lap();
        let rgb = f32_values(images.rgb.clone());
        let dissimilarity = d_ssim(&rgb, truth, stack);
        let mut loss = mse(&rgb, truth);
        result.terms.intermediate_mse += loss.value;
        result.terms.intermediate_d_ssim += dissimilarity.loss.value;
        loss.add(&dissimilarity.loss, self.config.intermediate_d_ssim_weight);
        result.terms.total += self.config.intermediate_weight * loss.value;
        if self.config.intermediate_weight > 0.0 {
            backward.add(&images.rgb, &loss.gradient, self.config.intermediate_weight);
        }
        if let Some(map) = &images.scalar {
            let loss = uncertainty(&f32_values(map.clone()), &dissimilarity.map);
            result.terms.uncertainty += loss.value;
            result.terms.total += self.config.uncertainty_weight * loss.value;
            backward.add(map, &loss.gradient, self.config.uncertainty_weight);
        }
        result.seconds.losses += clock.lap();
        Ok(())
    }

    /// Renders the first targets of a sample; the score of a token goes to all of its Gaussians.
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

/// The first targets of a sample as the renderer's views.
pub(crate) fn target_views(sample: &Sample, count: usize) -> Vec<View> {
    let size = pixel_size(sample.targets.size);
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

/// What the backward pass starts from: `Σ weight · image · gradient`, whose derivative with respect to an image is that
/// image's weighted gradient.
#[derive(Default)]
struct WeightedGradients {
    sum: Option<Tensor<1>>,
}

impl WeightedGradients {
    #[expect(clippy::cast_possible_truncation, reason = "weights are moderate numbers")]
    fn add<const D: usize>(&mut self, image: &Tensor<D>, gradient: &[f32], weight: f64) {
        let gradient: Vec<f32> = gradient.iter().map(|value| value * weight as f32).collect();
        let gradient = Tensor::<D>::from_data(TensorData::new(gradient, image.dims()), &image.device());
        let term = (image.clone() * gradient).sum();
        self.sum = Some(match self.sum.take() {
            Some(sum) => sum + term,
            None => term,
        });
    }
}

/// A stopwatch of consecutive parts.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_are_added_by_part() {
        let of = |first: f64| PartSeconds {
            sample: first,
            forward: first + 1.0,
            splat: first + 2.0,
            losses: first + 4.0,
            backward: first + 8.0,
        };
        let sum = PartSeconds { sample: 12.0, forward: 15.0, splat: 18.0, losses: 24.0, backward: 36.0 };
        assert_eq!(PartSeconds::sum([2.0, 3.0, 7.0].map(of).into_iter()), sum);
    }
}
