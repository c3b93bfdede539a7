//! Samples on their way through the losses.

use std::ops::Range;

use atsplat_model::network::{BackwardPass, RenderedTensors, f32_values};
use burn::Tensor;
use burn::tensor::{Device, TensorData};

use super::names;
use super::terms::{Clock, PartSeconds, Terms};
use crate::losses::{Stack, graph, log_distance};
use crate::samples::Sample;
use crate::skipped_step::{FailureReason, SampleFailure};

pub(super) struct Group<'a> {
    pub(super) samples: &'a [Sample],
    pub(super) terms: Vec<Terms>,
    pub(super) seconds: PartSeconds,
    pub(super) clock: Clock,
    device: Device,
    /// Once a loss in the graph needed them.
    runs: Vec<Run>,
    /// Those of the renderings so far.
    pub(super) renderings: Vec<BackwardPass>,
    /// Losses that are part of the graph and have not been read.
    unread: Vec<GraphLoss>,
    /// What the backward pass starts from. A loss that is computed outside the graph enters as `weight · images · gradient`, whose
    /// derivative with respect to the images is their weighted gradient.
    pub(super) sum: Option<Tensor<1>>,
}

/// A term of a sample's record.
type Slot = fn(&mut Terms) -> &mut f64;

/// A term of consecutive samples.
struct GraphLoss {
    first: usize,
    slot: Slot,
    weight: f64,
    /// One for each sample.
    values: Tensor<1>,
}

/// Consecutive samples with equal numbers and sizes of targets, for which losses in the graph are computed together.
#[derive(Clone, Debug)]
pub(super) struct Run {
    pub(super) samples: Range<usize>,
    /// The targets of a sample.
    pub(super) stack: Stack,
    /// `[samples, views, height, width, 3]`.
    truth: Tensor<5>,
    pub(super) d_ssim: graph::DSsim,
}

impl Run {
    pub(super) fn count(&self) -> usize {
        self.samples.len()
    }

    /// The first targets of every sample, `[images, height, width, 3]`.
    pub(super) fn truth(&self, views: usize) -> Tensor<4> {
        let Stack { height, width, .. } = self.stack;
        self.truth.clone().slice_dim(1, 0..views).reshape([self.count() * views, height, width, 3])
    }
}

impl<'a> Group<'a> {
    pub(super) fn new(samples: &'a [Sample], seconds: PartSeconds, clock: Clock, device: Device) -> Self {
        let terms = vec![Terms::default(); samples.len()];
        Self {
            samples,
            terms,
            seconds,
            clock,
            device,
            runs: Vec::new(),
            renderings: Vec::new(),
            unread: Vec::new(),
            sum: None,
        }
    }

    /// Keeps the backward pass of a rendering, and counts its time.
    pub(super) fn add_rendering(&mut self, images: &RenderedTensors) {
        self.renderings.push(images.backward.clone());
        self.seconds.splat += self.clock.lap();
    }

    /// The samples by runs, whose targets are copied to the device when they are first asked for.
    pub(super) fn runs(&mut self) -> Vec<Run> {
        if self.runs.is_empty() {
            let mut first = 0;
            for samples in self.samples.chunk_by(|a, b| a.targets.stack() == b.targets.stack()) {
                let run = self.run(first..first + samples.len(), samples);
                self.runs.push(run);
                first += samples.len();
            }
        }
        self.runs.clone()
    }

    fn run(&self, range: Range<usize>, samples: &[Sample]) -> Run {
        #[expect(clippy::expect_used, reason = "`chunk_by` gives at least one")]
        let stack = samples.first().expect("a sample").targets.stack();
        let Stack { views, height, width } = stack;
        let images = samples.iter().flat_map(|sample| sample.targets.images.iter().copied()).collect();
        let images = TensorData::new::<f32, _>(images, [samples.len(), views, height, width, 3]);
        let of_size = |run: &&Run| (run.stack.height, run.stack.width) == (height, width);
        let known = self.runs.iter().find(of_size).map(|run| run.d_ssim.clone());
        let d_ssim = known.unwrap_or_else(|| graph::DSsim::new([height, width], &self.device));
        Run { samples: range, stack, truth: Tensor::from_data(images, &self.device), d_ssim }
    }

    /// Adds losses of images with known gradients with respect to colour and to the scalar, each with its weight.
    #[expect(clippy::cast_possible_truncation, reason = "weights are moderate numbers")]
    pub(super) fn add_of_images(
        &mut self,
        images: &RenderedTensors,
        rgb: Option<(&[f32], f64)>,
        scalar: Option<(&[f32], f64)>,
    ) {
        let [rgb, scalar] = [rgb, scalar].map(|loss| loss.map(|(gradient, weight)| (gradient, weight as f32)));
        if rgb.is_some() || scalar.is_some() {
            self.add(images.with_derivatives(rgb, scalar));
        }
    }

    /// Adds a loss of consecutive samples that is part of the graph.
    pub(super) fn add_in_graph(&mut self, first: usize, slot: Slot, weight: f64, values: Tensor<1>) {
        self.unread.push(GraphLoss { first, slot, weight, values: values.clone().detach() });
        if weight > 0.0 {
            self.add(values.sum() * weight);
        }
    }

    /// Adds the loss of the anchors' depths, `[samples, patches]`.
    pub(super) fn add_distances(
        &mut self,
        depths: Option<&Tensor<2>>,
        weight: f64,
        in_graph: bool,
    ) -> Result<(), SampleFailure> {
        let missing = || {
            let missing = "losses.distance-weight: the network has no anchors, or the sample no exact distances";
            FailureReason::Error(missing.to_owned())
        };
        let depths = depths.ok_or_else(|| SampleFailure { sample: names(self.samples), reason: missing() })?;
        let samples = self.samples.iter();
        let exact = samples.map(|sample| sample.distances.as_ref().ok_or_else(|| sample.failure(missing())));
        let exact = exact.collect::<Result<Vec<_>, SampleFailure>>()?;
        if in_graph {
            let exact: Vec<&[f32]> = exact.into_iter().map(|exact| exact.distances.as_slice()).collect();
            let losses = graph::log_distance(depths.clone(), &exact);
            self.add_in_graph(0, |terms| &mut terms.distance, weight, losses);
            return Ok(());
        }
        #[expect(clippy::cast_possible_truncation, reason = "weights are moderate numbers")]
        let narrow_weight = weight as f32;
        let values = f32_values(depths.clone());
        let mut gradient = Vec::with_capacity(values.len());
        let by_sample = values.chunks(values.len() / self.samples.len().max(1));
        for ((exact, predicted), terms) in exact.into_iter().zip(by_sample).zip(&mut self.terms) {
            let loss = log_distance(predicted, &exact.distances);
            terms.distance = loss.value;
            terms.total += weight * loss.value;
            gradient.extend(loss.gradient.into_iter().map(|value| value * narrow_weight));
        }
        let gradient = Tensor::<2>::from_data(TensorData::new(gradient, depths.dims()), &depths.device());
        self.add((depths.clone() * gradient).sum());
        Ok(())
    }

    fn add(&mut self, term: Tensor<1>) {
        self.sum = Some(match self.sum.take() {
            Some(sum) => sum + term,
            None => term,
        });
    }

    /// Reads the losses that are part of the graph, all at once.
    pub(super) fn read(&mut self) {
        if self.unread.is_empty() {
            return;
        }
        let values = f32_values(Tensor::cat(self.unread.iter().map(|loss| loss.values.clone()).collect(), 0));
        let mut values = values.into_iter().map(f64::from);
        for loss in self.unread.drain(..) {
            let [count] = loss.values.dims();
            for (terms, value) in self.terms.iter_mut().skip(loss.first).zip(values.by_ref().take(count)) {
                *(loss.slot)(terms) += value;
                terms.total += loss.weight * value;
            }
        }
    }
}
