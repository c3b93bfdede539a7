//! The loss of samples and its gradient with respect to every parameter.

mod group;
mod images;
mod terms;

use atsplat_model::network::{BackwardPass, FlatLayout, GaussianTensors, Network, RenderedTensors, Views, f32_values};
use atsplat_splat::{Channels, RenderOptions, StoppedGradients, View};
use burn::Tensor;
use burn::tensor::{Device, Gradients};
use indexmap::IndexMap;

pub use terms::{PartSeconds, Terms};

use crate::config::LossConfig;
use crate::losses::{Perceptual, Stack};
use crate::samples::{Sample, pixel_size};
use crate::skipped_step::{FailureReason, SampleFailure};
use crate::{FeatureCache, TrainError};
use group::{Group, Run};
use terms::Clock;

/// A group of samples, which go through the network as one batch, and what else decides their losses.
#[derive(Clone, Copy, Debug)]
pub struct GroupInput<'a> {
    /// The samples, with equal numbers and sizes of context images.
    pub samples: &'a [Sample],
    /// Cache of a frozen backbone's features.
    pub features: Option<&'a FeatureCache>,
    /// Seeds random selection in the first sample; the next number that in the second.
    pub call_seed: u64,
    /// Share of the run that is done, from 0 to 1.
    pub progress: f64,
}

impl<'a> GroupInput<'a> {
    /// Samples at the start of a run, without a cache.
    pub const fn new(samples: &'a [Sample]) -> Self {
        Self { samples, features: None, call_seed: 0, progress: 0.0 }
    }
}

/// The losses of a group of samples, which go through the network as one batch, and the gradients of their sum.
#[derive(Clone, Debug, Default)]
pub struct GroupGradients {
    /// The loss of each sample.
    pub terms: Vec<Terms>,
    /// Gradients by parameter name, in the layout of weights files; a parameter that no loss depends on is absent.
    pub gradients: IndexMap<String, Vec<f32>>,
    /// Time taken.
    pub seconds: PartSeconds,
}

/// [`GroupGradients`] as one tensor on the network's device, or as numbers on the host.
#[derive(Clone, Debug)]
pub struct FlatGradient<G> {
    /// The loss of each sample.
    pub terms: Vec<Terms>,
    /// The gradient in the order of [`Network::flat`].
    pub gradient: G,
    /// Time taken until the device had computed the losses and accepted the rest.
    pub seconds: PartSeconds,
}

/// The training loss of a configuration.
#[derive(Debug)]
pub struct Objective {
    config: LossConfig,
    perceptual: Perceptual,
    /// Whether losses are part of the graph, so that no image leaves the device.
    in_graph: bool,
}

/// What a backward pass of a group leaves.
struct Differentiated {
    terms: Vec<Terms>,
    seconds: PartSeconds,
    clock: Clock,
    /// `None` if no loss depends on the network.
    gradients: Option<Gradients>,
}

impl Objective {
    /// The loss of a configuration; reads the weights of a learned perceptual loss.
    ///
    /// # Errors
    /// As [`Perceptual::new`].
    pub fn new(config: LossConfig) -> Result<Self, TrainError> {
        let perceptual = Perceptual::new(&config.perceptual, &Device::flex().autodiff())?;
        Ok(Self { config, perceptual, in_graph: false })
    }

    /// The same loss as part of the graph on a device with gradients: rendered images do not leave it. Values and gradients are
    /// those of [`Self::new`] up to rounding.
    ///
    /// # Errors
    /// As [`Perceptual::new`].
    pub fn in_graph(config: LossConfig, device: &Device) -> Result<Self, TrainError> {
        let perceptual = Perceptual::new(&config.perceptual, device)?;
        Ok(Self { config, perceptual, in_graph: true })
    }

    /// Name of the perceptual term, for provenance.
    pub fn perceptual(&self) -> String {
        self.perceptual.name()
    }

    /// Runs the network on a group, renders every set of Gaussians, and propagates the sum of all losses back. The network must be
    /// on an autodiff device.
    ///
    /// # Errors
    /// [`SampleFailure`] if the step cannot be used; nothing is changed.
    pub fn gradients(&self, network: &Network, input: &GroupInput<'_>) -> Result<GroupGradients, SampleFailure> {
        let done = self.differentiate(network, input)?;
        let Differentiated { terms, mut seconds, mut clock, gradients } = done;
        let gradients = gradients.map(|gradients| network.gradients(&gradients)).unwrap_or_default();
        seconds.backward = clock.lap();
        let broken = gradients.iter().filter(|(_, values)| values.iter().any(|value| !value.is_finite()));
        finite_gradients(broken.map(|(name, _)| name.as_str()), input.samples)?;
        Ok(GroupGradients { terms, gradients, seconds })
    }

    /// [`Self::gradients`] as one tensor on the network's device; the caller has to check whether they are finite.
    ///
    /// # Errors
    /// [`SampleFailure`] if the step cannot be used; nothing is changed.
    pub fn flat_gradient(
        &self,
        network: &Network,
        input: &GroupInput<'_>,
    ) -> Result<FlatGradient<Tensor<1>>, SampleFailure> {
        let done = self.differentiate(network, input)?;
        let Differentiated { terms, mut seconds, mut clock, gradients } = done;
        let gradient = match gradients {
            Some(gradients) => network.flat_gradient(&gradients),
            None => network.flat().zeros_like(),
        };
        seconds.backward = clock.lap();
        Ok(FlatGradient { terms, gradient, seconds })
    }

    /// [`Self::flat_gradient`] as finite numbers on the host; the layout is the network's.
    ///
    /// # Errors
    /// [`SampleFailure`] if the step cannot be used; nothing is changed.
    pub(crate) fn host_gradient(
        &self,
        network: &Network,
        layout: &FlatLayout,
        input: &GroupInput<'_>,
    ) -> Result<FlatGradient<Vec<f32>>, SampleFailure> {
        let FlatGradient { terms, gradient, seconds } = self.flat_gradient(network, input)?;
        let gradient = f32_values(gradient);
        finite_gradients(layout.non_finite(&gradient), input.samples)?;
        Ok(FlatGradient { terms, gradient, seconds })
    }

    fn differentiate(&self, network: &Network, input: &GroupInput<'_>) -> Result<Differentiated, SampleFailure> {
        let GroupInput { samples, features, call_seed, progress } = *input;
        let mut clock = Clock::start();
        let failed = |error: &dyn std::fmt::Display| FailureReason::Error(error.to_string());
        let views = |sample: &Sample| {
            finite_images(sample)?;
            let views = features.map_or_else(|| sample.context.views(), |cache| cache.views(network, &sample.context));
            views.map_err(|error| failed(&error))
        };
        let views: Result<Vec<Views>, SampleFailure> =
            samples.iter().map(|sample| views(sample).map_err(|reason| sample.failure(reason))).collect();
        let forward = network.forward(&views?, call_seed);
        let forward = forward.map_err(|error| SampleFailure { sample: names(samples), reason: failed(&error) })?;
        let seconds = PartSeconds { forward: clock.lap(), ..PartSeconds::default() };
        let mut group = Group::new(samples, seconds, clock, network.device());
        let weight = self.config.distance_weight_at(progress);
        if weight > 0.0 {
            group.add_distances(forward.initial.place.depths(), weight, self.in_graph)?;
            group.seconds.losses += group.clock.lap();
        }
        self.add_final(&forward.gaussians, self.config.perceptual_weight_at(progress), &mut group)?;
        for (block, next) in forward.blocks.iter().zip(forward.blocks.iter().skip(1)) {
            let gaussians = network.gaussians(&block.tokens);
            group.seconds.forward += group.clock.lap();
            let scores = next.expanded.as_ref().and_then(|expanded| expanded.scores.clone());
            self.add_intermediate(&gaussians, scores, &mut group)?;
        }
        group.read();
        group.seconds.losses += group.clock.lap();
        let Group { terms, seconds, clock, renderings, sum, .. } = group;
        for (sample, terms) in samples.iter().zip(&terms) {
            if let Some((name, _)) = terms.named().into_iter().find(|(_, value)| !value.is_finite()) {
                return Err(sample.failure(FailureReason::NonFiniteTerm(name)));
            }
        }
        let gradients = sum.map(|sum| sum.backward());
        match renderings.iter().find_map(BackwardPass::failure) {
            Some(why) => {
                let reason = FailureReason::Error(format!("the backward pass of a rendering: {why}"));
                Err(SampleFailure { sample: names(samples), reason })
            }
            None => Ok(Differentiated { terms, seconds, clock, gradients }),
        }
    }

    /// Adds the loss of the final Gaussians: `MSE + λp · perceptual`.
    fn add_final(&self, gaussians: &GaussianTensors, weight: f64, group: &mut Group<'_>) -> Result<(), SampleFailure> {
        if self.in_graph {
            for run in group.runs() {
                let images = self.render_run(gaussians, group.samples, &run, run.stack.views, None)?;
                group.add_rendering(&images);
                self.compare_final_in_graph(images, &run, weight, group);
                group.seconds.losses += group.clock.lap();
            }
            return Ok(());
        }
        for (index, sample) in group.samples.iter().enumerate() {
            let stack = sample.targets.stack();
            let images = self.render(gaussians, group, index, stack, None)?;
            group.add_rendering(&images);
            self.compare_final(&images, index, stack, weight, group);
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
    ) -> Result<(), SampleFailure> {
        let scores = scores.filter(|_| self.config.uncertainty_weight > 0.0);
        if scores.is_none() && self.config.intermediate_weight <= 0.0 {
            return Ok(());
        }
        let views_of =
            |stack: Stack| self.config.intermediate_targets.map_or(stack.views, |most| most.get().min(stack.views));
        if self.in_graph {
            for run in group.runs() {
                let views = views_of(run.stack);
                let images = self.render_run(gaussians, group.samples, &run, views, scores.as_ref())?;
                group.add_rendering(&images);
                self.compare_intermediate_in_graph(images, &run, views, group);
                group.seconds.losses += group.clock.lap();
            }
            return Ok(());
        }
        for (index, sample) in group.samples.iter().enumerate() {
            let all = sample.targets.stack();
            let stack = Stack { views: views_of(all), ..all };
            let images = self.render(gaussians, group, index, stack, scores.as_ref())?;
            group.add_rendering(&images);
            self.compare_intermediate(&images, index, stack, group);
            group.seconds.losses += group.clock.lap();
        }
        Ok(())
    }

    /// Renders the first targets of one sample; the score of a token goes to all of its Gaussians.
    fn render(
        &self,
        gaussians: &GaussianTensors,
        group: &Group<'_>,
        index: usize,
        stack: Stack,
        scores: Option<&Tensor<2>>,
    ) -> Result<RenderedTensors, SampleFailure> {
        let sample = &group.samples[index];
        let scalars = scores.map(|scores| scalars(scores.clone().narrow(0, index, 1), gaussians).squeeze_dim::<1>(0));
        let options = self.options(scalars.is_some());
        let rendered = gaussians.render(index, &target_views(sample, stack.views), &options, scalars);
        rendered.map_err(|error| sample.failure(FailureReason::Error(error.to_string())))
    }

    /// Renders the first targets of every sample of a run, at once.
    fn render_run(
        &self,
        gaussians: &GaussianTensors,
        samples: &[Sample],
        run: &Run,
        views: usize,
        scores: Option<&Tensor<2>>,
    ) -> Result<RenderedTensors, SampleFailure> {
        let scalars = scores.map(|scores| scalars(scores.clone().slice_dim(0, run.samples.clone()), gaussians));
        let options = self.options(scalars.is_some());
        let of_run = &samples[run.samples.clone()];
        let views: Vec<Vec<View>> = of_run.iter().map(|sample| target_views(sample, views)).collect();
        let rendered = gaussians.scenes(run.samples.clone()).render_all(&views, &options, scalars);
        rendered
            .map_err(|error| SampleFailure { sample: names(of_run), reason: FailureReason::Error(error.to_string()) })
    }

    fn options(&self, with_scalars: bool) -> RenderOptions {
        RenderOptions {
            background: self.config.background,
            channels: Channels { scalar: with_scalars, ..Channels::default() },
            gradients: StoppedGradients { scalar_stops: true, ..StoppedGradients::default() },
            ..RenderOptions::default()
        }
    }
}

/// The score of each token, `[scenes, tokens]`, for all of its Gaussians, `[scenes, Gaussians]`.
fn scalars(scores: Tensor<2>, gaussians: &GaussianTensors) -> Tensor<2> {
    let ([_, count, _], [scenes, tokens]) = (gaussians.means.dims(), scores.dims());
    scores.unsqueeze_dim::<3>(2).repeat_dim(2, count / tokens.max(1)).reshape([scenes, count])
}

fn names(samples: &[Sample]) -> String {
    samples.iter().map(|sample| sample.name.as_str()).collect::<Vec<_>>().join(", ")
}

/// The first targets of a sample as the renderer's views.
pub(crate) fn target_views(sample: &Sample, count: usize) -> Vec<View> {
    let size = pixel_size(sample.targets.size);
    sample.targets.cameras.iter().take(count).map(|&camera| View { camera, size }).collect()
}

/// An error if there are parameters whose gradients are not finite; it names the first four.
fn finite_gradients<'a>(broken: impl Iterator<Item = &'a str>, samples: &[Sample]) -> Result<(), SampleFailure> {
    let broken: Vec<String> = broken.take(4).map(str::to_owned).collect();
    if broken.is_empty() {
        return Ok(());
    }
    Err(SampleFailure { sample: names(samples), reason: FailureReason::NonFiniteGradients(broken) })
}

fn finite_images(sample: &Sample) -> Result<(), FailureReason> {
    for (what, posed) in [("context", &sample.context), ("target", &sample.targets)] {
        let broken = (0..posed.cameras.len()).find(|view| posed.image(*view).iter().any(|value| !value.is_finite()));
        if let Some(view) = broken {
            return Err(FailureReason::NonFiniteImage(format!("{what} image {view}")));
        }
    }
    Ok(())
}
