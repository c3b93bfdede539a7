//! Samples on their way through the losses.

use atsplat_model::network::f32_values;
use burn::Tensor;
use burn::tensor::{Device, TensorData};

use super::names;
use super::terms::{Clock, PartSeconds, Terms};
use crate::fault::{FaultKind, SampleFault};
use crate::losses::{Stack, graph, log_distance};
use crate::samples::Sample;

pub(super) struct Group<'a> {
    pub(super) samples: &'a [Sample],
    pub(super) terms: Vec<Terms>,
    pub(super) seconds: PartSeconds,
    pub(super) clock: Clock,
    device: Device,
    /// Of each sample, once a loss in the graph needed them.
    targets: Vec<Option<(Tensor<4>, graph::DSsim)>>,
    /// Losses that are part of the graph and have not been read.
    unread: Vec<GraphLoss>,
    /// What the backward pass starts from. A loss that is computed beside the graph enters as `weight · image · gradient`, whose
    /// derivative with respect to the image is that image's weighted gradient.
    pub(super) sum: Option<Tensor<1>>,
}

/// A term of a sample's record.
type Slot = fn(&mut Terms) -> &mut f64;

struct GraphLoss {
    sample: usize,
    slot: Slot,
    weight: f64,
    value: Tensor<1>,
}

impl<'a> Group<'a> {
    pub(super) fn new(samples: &'a [Sample], seconds: PartSeconds, clock: Clock, device: Device) -> Self {
        let terms = vec![Terms::default(); samples.len()];
        let targets = vec![None; samples.len()];
        Self { samples, terms, seconds, clock, device, targets, unread: Vec::new(), sum: None }
    }

    /// The first targets of a sample, `[views, height, width, 3]`, and what compares with them.
    pub(super) fn in_graph(&mut self, at: usize, views: usize) -> (Tensor<4>, graph::DSsim) {
        let (targets, d_ssim) = match self.targets[at].take() {
            Some(known) => known,
            None => self.copied_targets(at),
        };
        let first = targets.clone().slice_dim(0, 0..views);
        self.targets[at] = Some((targets, d_ssim.clone()));
        (first, d_ssim)
    }

    fn copied_targets(&self, at: usize) -> (Tensor<4>, graph::DSsim) {
        let targets = &self.samples[at].targets;
        let Stack { views, height, width } = targets.stack();
        let pictures = TensorData::new(targets.pictures.clone(), [views, height, width, 3]);
        let of_size = |(others, _): &&(Tensor<4>, graph::DSsim)| others.dims()[1..3] == [height, width];
        let known = self.targets.iter().flatten().find(of_size).map(|(_, d_ssim)| d_ssim.clone());
        let d_ssim = known.unwrap_or_else(|| graph::DSsim::new([height, width], &self.device));
        (Tensor::from_data(pictures, &self.device), d_ssim)
    }

    /// Adds a loss with a known gradient with respect to an image.
    #[expect(clippy::cast_possible_truncation, reason = "weights are moderate numbers")]
    pub(super) fn add_gradient<const D: usize>(&mut self, image: &Tensor<D>, gradient: &[f32], weight: f64) {
        let gradient: Vec<f32> = gradient.iter().map(|value| value * weight as f32).collect();
        let gradient = Tensor::<D>::from_data(TensorData::new(gradient, image.dims()), &image.device());
        self.add((image.clone() * gradient).sum());
    }

    /// Adds a loss of a sample that is part of the graph.
    pub(super) fn add_in_graph(&mut self, sample: usize, slot: Slot, weight: f64, value: Tensor<1>) {
        self.unread.push(GraphLoss { sample, slot, weight, value: value.clone().detach() });
        if weight > 0.0 {
            self.add(value * weight);
        }
    }

    /// Adds the loss of the anchors' depths, `[samples, patches]`.
    pub(super) fn add_distances(
        &mut self,
        depths: Option<&Tensor<2>>,
        weight: f64,
        in_graph: bool,
    ) -> Result<(), SampleFault> {
        let missing = || {
            let missing = "losses.distance-weight: the network has no anchors, or the sample no exact distances";
            FaultKind::Refused(missing.to_owned())
        };
        let depths = depths.ok_or_else(|| SampleFault { sample: names(self.samples), what: missing() })?;
        let samples = self.samples.iter();
        let exact = samples.map(|sample| sample.distances.as_ref().ok_or_else(|| sample.fault(missing())));
        let exact = exact.collect::<Result<Vec<_>, SampleFault>>()?;
        if in_graph {
            for (at, exact) in exact.into_iter().enumerate() {
                let own = depths.clone().slice_dim(0, at..at + 1).squeeze_dim::<1>(0);
                let loss = graph::log_distance(own, &exact.distances);
                self.add_in_graph(at, |terms| &mut terms.distance, weight, loss);
            }
            return Ok(());
        }
        let values = f32_values(depths.clone());
        let mut gradient = Vec::with_capacity(values.len());
        let own = values.chunks(values.len() / self.samples.len().max(1));
        for ((exact, predicted), terms) in exact.into_iter().zip(own).zip(&mut self.terms) {
            let loss = log_distance(predicted, &exact.distances);
            terms.distance = loss.value;
            terms.total += weight * loss.value;
            gradient.extend(loss.gradient);
        }
        self.add_gradient(depths, &gradient, weight);
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
        let values = f32_values(Tensor::cat(self.unread.iter().map(|loss| loss.value.clone()).collect(), 0));
        for (loss, value) in self.unread.drain(..).zip(values) {
            let terms = &mut self.terms[loss.sample];
            *(loss.slot)(terms) += f64::from(value);
            terms.total += loss.weight * f64::from(value);
        }
    }
}
