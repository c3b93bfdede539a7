//! The loss of samples and its gradient with respect to every parameter.

use std::time::Instant;

use atsplat_model::network::{GaussianTensors, Network, RenderedTensors, Views, f32_values};
use atsplat_splat::{Channels, GradientReach, RenderOptions, View};
use burn::Tensor;
use burn::tensor::TensorData;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use crate::config::LossConfig;
use crate::fault::{FaultKind, SampleFault};
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

/// Wall-clock seconds that a group of samples took, by part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PartSeconds {
    /// Making the samples.
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
    /// The sum over several groups.
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

/// The losses of a group of samples, which go through the network together, and the gradients of their sum.
#[derive(Clone, Debug, Default)]
pub struct GroupGradients {
    /// The loss of each sample.
    pub terms: Vec<Terms>,
    /// By parameter name, in the layout of weights files; a parameter that no loss depends on is absent.
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

    /// Runs the network on samples with the same number of context pictures of the same size, renders every set of Gaussians, and
    /// propagates the sum of all losses back. The network must be on an autodiff device. `features` is the cache of a frozen
    /// backbone's features; `call_seed` seeds random selection in the first sample, the next number that in the second; `share` of
    /// the run is done.
    ///
    /// # Errors
    /// [`SampleFault`] if the step cannot be used; nothing is changed.
    pub fn gradients(
        &self,
        network: &Network,
        samples: &[Sample],
        features: Option<&FeatureCache>,
        call_seed: u64,
        share: f64,
    ) -> Result<GroupGradients, SampleFault> {
        let mut clock = Clock::start();
        let of_all = |what| SampleFault { sample: names(samples), what };
        let refused = |error: &dyn std::fmt::Display| FaultKind::Refused(error.to_string());
        let views = |sample: &Sample| {
            finite_pictures(sample)?;
            let views = features.map_or_else(|| sample.context.views(), |own| own.views(network, &sample.context));
            views.map_err(|error| refused(&error))
        };
        let views: Result<Vec<Views>, SampleFault> =
            samples.iter().map(|sample| views(sample).map_err(|what| sample.fault(what))).collect();
        let forward = network.forward(&views?, call_seed).map_err(|error| of_all(refused(&error)))?;
        let mut group = Group {
            samples,
            terms: vec![Terms::default(); samples.len()],
            seconds: PartSeconds { forward: clock.lap(), ..PartSeconds::default() },
            clock,
            backward: WeightedGradients::default(),
        };
        let weight = self.config.distance_weight_at(share);
        if weight > 0.0 {
            group.add_distances(forward.initial.depths.as_ref(), weight)?;
        }
        self.add_final(&forward.gaussians, self.config.perceptual_weight_at(share), &mut group)?;
        for pair in forward.blocks.windows(2) {
            let [block, next] = pair else { continue };
            let gaussians = network.gaussians(&block.tokens);
            let scores = next.expanded.as_ref().and_then(|expanded| expanded.scores.clone());
            self.add_intermediate(&gaussians, scores, &mut group)?;
        }
        let Group { terms, mut seconds, mut clock, backward, .. } = group;
        for (sample, terms) in samples.iter().zip(&terms) {
            if let Some((name, _)) = terms.named().into_iter().find(|(_, value)| !value.is_finite()) {
                return Err(sample.fault(FaultKind::Term(name)));
            }
        }
        let gradients = backward.sum.map(|sum| network.gradients(&sum.backward())).unwrap_or_default();
        seconds.backward = clock.lap();
        let broken = gradients.iter().filter(|(_, values)| values.iter().any(|value| !value.is_finite()));
        let broken: Vec<String> = broken.map(|(name, _)| name.clone()).take(4).collect();
        if broken.is_empty() {
            Ok(GroupGradients { terms, gradients, seconds })
        } else {
            Err(of_all(FaultKind::Gradients(broken)))
        }
    }

    /// Adds the loss of the final Gaussians: `MSE + λp · perceptual`.
    fn add_final(
        &self,
        gaussians: &GaussianTensors,
        perceptual_weight: f64,
        group: &mut Group<'_>,
    ) -> Result<(), SampleFault> {
        for (at, sample) in group.samples.iter().enumerate() {
            let (truth, stack) = (&sample.targets.pictures, sample.targets.stack());
            let images = self.render(gaussians, group, at, stack, None)?;
            group.seconds.splat += group.clock.lap();
            let rgb = f32_values(images.rgb.clone());
            let mut loss = mse(&rgb, truth);
            let terms = group.terms_of(at);
            terms.mse = loss.value;
            if perceptual_weight > 0.0 {
                let perceptual = self.perceptual.evaluate(&rgb, truth, stack);
                terms.perceptual = perceptual.value;
                loss.add(&perceptual, perceptual_weight);
            }
            terms.total += loss.value;
            group.backward.add(&images.rgb, &loss.gradient, 1.0);
            group.seconds.losses += group.clock.lap();
        }
        Ok(())
    }

    /// Adds the loss of the Gaussians of a block before the last: `λint · (MSE + λs · D-SSIM) + λunc · uncertainty`.
    fn add_intermediate(
        &self,
        gaussians: &GaussianTensors,
        scores: Option<Tensor<2>>,
        group: &mut Group<'_>,
    ) -> Result<(), SampleFault> {
        let scores = scores.filter(|_| self.config.uncertainty_weight > 0.0);
        if scores.is_none() && self.config.intermediate_weight <= 0.0 {
            return Ok(());
        }
        for (at, sample) in group.samples.iter().enumerate() {
            let all = sample.targets.stack();
            let stack = Stack {
                views: self.config.intermediate_targets.map_or(all.views, |most| most.get().min(all.views)),
                ..all
            };
            #[expect(clippy::expect_used, reason = "the stack holds at most all of the sample's targets")]
            let truth = sample.targets.pictures.get(..stack.samples()).expect("a prefix of the targets");
            let images = self.render(gaussians, group, at, stack, scores.as_ref())?;
            group.seconds.splat += group.clock.lap();
            let rgb = f32_values(images.rgb.clone());
            let dissimilarity = d_ssim(&rgb, truth, stack);
            let mut loss = mse(&rgb, truth);
            let terms = group.terms_of(at);
            terms.intermediate_mse += loss.value;
            terms.intermediate_d_ssim += dissimilarity.loss.value;
            loss.add(&dissimilarity.loss, self.config.intermediate_d_ssim_weight);
            terms.total += self.config.intermediate_weight * loss.value;
            let uncertainty = images.scalar.as_ref().map(|map| {
                let loss = uncertainty(&f32_values(map.clone()), &dissimilarity.map);
                terms.uncertainty += loss.value;
                terms.total += self.config.uncertainty_weight * loss.value;
                (map, loss)
            });
            if self.config.intermediate_weight > 0.0 {
                group.backward.add(&images.rgb, &loss.gradient, self.config.intermediate_weight);
            }
            if let Some((map, loss)) = uncertainty {
                group.backward.add(map, &loss.gradient, self.config.uncertainty_weight);
            }
            group.seconds.losses += group.clock.lap();
        }
        Ok(())
    }

    /// Renders the first targets of one sample; the score of a token goes to all of its Gaussians.
    fn render(
        &self,
        gaussians: &GaussianTensors,
        group: &Group<'_>,
        at: usize,
        stack: Stack,
        scores: Option<&Tensor<2>>,
    ) -> Result<RenderedTensors, SampleFault> {
        let sample = &group.samples[at];
        let [_, count, _] = gaussians.means.dims();
        let scalars = scores.map(|scores| {
            let [_, tokens] = scores.dims();
            let own = scores.clone().narrow(0, at, 1);
            own.unsqueeze_dim::<3>(2).repeat_dim(2, count / tokens.max(1)).reshape([count])
        });
        let options = RenderOptions {
            background: self.config.background,
            channels: Channels { scalar: scalars.is_some(), ..Channels::default() },
            gradients: GradientReach { scalar_stops: true, ..GradientReach::default() },
            ..RenderOptions::default()
        };
        let views = target_views(sample, stack.views);
        let rendered = gaussians.render(at, &views, &options, scalars);
        rendered.map_err(|error| sample.fault(FaultKind::Refused(error.to_string())))
    }
}

/// Samples on their way through the losses.
struct Group<'a> {
    samples: &'a [Sample],
    terms: Vec<Terms>,
    seconds: PartSeconds,
    clock: Clock,
    backward: WeightedGradients,
}

impl Group<'_> {
    fn terms_of(&mut self, sample: usize) -> &mut Terms {
        &mut self.terms[sample]
    }

    /// Adds the loss of the anchors' depths, `[samples, patches]`.
    fn add_distances(&mut self, depths: Option<&Tensor<2>>, weight: f64) -> Result<(), SampleFault> {
        let missing = || {
            let missing = "losses.distance-weight: the network has no anchors, or the sample no exact distances";
            FaultKind::Refused(missing.to_owned())
        };
        let depths = depths.ok_or_else(|| SampleFault { sample: names(self.samples), what: missing() })?;
        let values = f32_values(depths.clone());
        let mut gradient = Vec::with_capacity(values.len());
        let own = values.chunks(values.len() / self.samples.len().max(1));
        for ((sample, predicted), terms) in self.samples.iter().zip(own).zip(&mut self.terms) {
            let exact = sample.distances.as_ref().ok_or_else(|| sample.fault(missing()))?;
            let loss = log_distance(predicted, &exact.distances);
            terms.distance = loss.value;
            terms.total += weight * loss.value;
            gradient.extend(loss.gradient);
        }
        self.backward.add(depths, &gradient, weight);
        Ok(())
    }
}

fn names(samples: &[Sample]) -> String {
    samples.iter().map(|sample| sample.name.as_str()).collect::<Vec<_>>().join(", ")
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
