//! One step: gradients of a batch of samples, then the optimiser.

use std::ops::Range;
use std::time::Instant;

use atsplat_files::Sha256Digest;
use burn::Tensor;
use burn::module::Module as _;
use rayon::prelude::*;

use super::{Event, Trainer};
use crate::logs::StepRecord;
use crate::objective::{FlatGradient, GroupInput, PartSeconds, Terms};
use crate::samples::{Sample, SampleId, digest_of_all};
use crate::skipped_step::{Diagnosis, FailureReason, SampleFailure, SkippedStep};
use crate::update::update;
use crate::{TrainConfig, TrainError};

/// At most this many numbers of gradients wait to be summed, or those of one micro-batch for each thread.
const WAITING_NUMBERS: usize = 1 << 26;
/// Numbers of a gradient that a thread sums at once.
const SUMMED_TOGETHER: usize = 1 << 16;

/// Samples that go through the network as one batch.
struct SampleGroup<'a> {
    samples: &'a [Sample],
    /// Number of the first.
    first: u64,
    /// Share of the run that is done.
    progress: f64,
    /// Seconds that drawing them took.
    drawing: f64,
}

/// What was computed for samples, group by group.
struct Computed<T> {
    groups: Vec<T>,
    /// Hash of each sample.
    digests: Vec<Sha256Digest>,
}

impl<T> Computed<T> {
    /// Those of a step's parts as one, and the hash of all samples.
    fn joined(parts: Vec<Self>) -> (Vec<T>, Sha256Digest) {
        let (mut groups, mut digests) = (Vec::new(), Vec::new());
        for part in parts {
            groups.extend(part.groups);
            digests.extend(part.digests);
        }
        (groups, digest_of_all(&digests))
    }

    fn map<U>(self, of_group: impl FnMut(T) -> U) -> Computed<U> {
        Computed { groups: self.groups.into_iter().map(of_group).collect(), digests: self.digests }
    }
}

/// Numbers of the samples of a step.
pub(super) fn numbers(config: &TrainConfig, step: u64) -> Range<u64> {
    let batch = config.batch.get() as u64;
    step * batch..(step + 1) * batch
}

impl Trainer {
    /// Does one step, or skips and counts it.
    ///
    /// # Errors
    /// [`TrainError::Stopped`] after as many skipped steps in a row as the configuration allows.
    pub fn step(&mut self, on_event: &mut dyn FnMut(&Event<'_>)) -> Result<(), TrainError> {
        let start = Instant::now();
        let step = self.state.step;
        let numbers: Vec<u64> = numbers(&self.config, step).collect();
        let given = self.state.initial_weights.as_ref().filter(|_| step == 0);
        let mut record = StepRecord {
            step,
            terms: None,
            gradient_norm: None,
            rate: self.config.schedule.rate(step, self.config.steps.get()),
            secs: 0.0,
            parts: PartSeconds::default(),
            skip_reason: None,
            samples_sha256: None,
            initial_weights_sha256: given.map(|given| given.sha256.clone()),
        };
        let done = if self.device_state.is_some() {
            self.step_on_adapter(&numbers, &mut record)
        } else {
            self.step_on_cpu(&numbers, &mut record)
        };
        match done {
            Ok(()) => {
                self.state.skipped_in_a_row = 0;
                self.skipped.clear();
            }
            Err(skipped) => {
                record.skip_reason = Some(skipped.to_string());
                self.state.skipped_in_a_row += 1;
                self.skipped.push(skipped);
            }
        }
        self.state.step += 1;
        let replaced = self.samples.replaced_count();
        self.state.replaced.count += replaced.saturating_sub(self.replaced_so_far);
        self.replaced_so_far = replaced;
        record.secs = start.elapsed().as_secs_f64();
        self.steps.append(&record)?;
        on_event(&Event::Step(&record));
        if record.gradient_norm.is_some_and(|norm| norm <= 0.0) {
            self.zero_gradients += 1;
            if self.zero_gradients == 1 {
                let why = "its gradient is 0, as where no target shows a Gaussian";
                on_event(&Event::Notice(&format!("step {step} trained nothing: {why}")));
            }
        }
        if self.state.skipped_in_a_row >= self.config.most_faults.get() {
            let parameters = self.current_state().parameters.non_finite();
            let (in_a_row, skipped) = (self.state.skipped_in_a_row, std::mem::take(&mut self.skipped));
            return Err(TrainError::Stopped(Box::new(Diagnosis { in_a_row, skipped, parameters })));
        }
        Ok(())
    }

    fn step_on_cpu(&mut self, numbers: &[u64], record: &mut StepRecord) -> Result<(), SkippedStep> {
        let layout = self.template.flat_layout();
        let count = layout.count();
        let values = layout.flattened(self.state.parameters.values(), &self.template.device());
        let network = self.template.clone().with_flat(values);
        let (objective, features, precision) = (&self.objective, self.features.as_ref(), self.config.matmul_precision);
        let gradients = |group: &SampleGroup<'_>| {
            // Each group has a separate graph over the same weights, so groups run in parallel.
            let network = network.clone().fork(&network.device());
            let SampleGroup { samples, first, progress, drawing } = *group;
            let input = GroupInput { samples, features, call_seed: first, progress };
            let mut group = precision.scope(|| objective.host_gradient(&network, &layout, &input))?;
            group.seconds.sample = drawing;
            Ok(group)
        };
        let mut sum = vec![0.0f32; count];
        let mut add = |group: FlatGradient<Vec<f32>>| {
            let pieces = sum.par_chunks_mut(SUMMED_TOGETHER).zip(group.gradient.par_chunks(SUMMED_TOGETHER));
            pieces.for_each(|(sum, part)| sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part));
            (group.terms, group.seconds)
        };
        let (micro_batch, waiting) = (self.config.micro_batch.get(), waiting(count));
        let mut parts = Vec::new();
        for numbers in numbers.chunks(micro_batch.saturating_mul(waiting)) {
            // Every group is computed, so that the same reason is reported at any number of threads.
            let computed: Vec<Result<Computed<_>, SkippedStep>> =
                numbers.par_chunks(micro_batch).map(|part| self.groups(part, gradients)).collect();
            parts.extend(computed.into_iter().map(|part| part.map(|part| part.map(&mut add))));
        }
        let (groups, digest) = Computed::joined(parts.into_iter().collect::<Result<_, SkippedStep>>()?);
        record.samples_sha256 = Some(digest);
        let gradients = layout.unflattened(&sum);
        let norm = update(&mut self.state, &gradients, numbers.len(), record.rate, &self.config);
        complete(record, norm, groups.into_iter().unzip())
    }

    #[expect(clippy::expect_used, reason = "the caller has looked, and a batch has samples")]
    fn step_on_adapter(&mut self, numbers: &[u64], record: &mut StepRecord) -> Result<(), SkippedStep> {
        let mut device_state = self.device_state.take().expect("a run on an adapter");
        let mut sum: Option<Tensor<1>> = None;
        let mut add = |group: &SampleGroup<'_>| {
            let SampleGroup { samples, first, progress, drawing } = *group;
            let input = GroupInput { samples, features: self.features.as_ref(), call_seed: first, progress };
            let FlatGradient { terms, gradient, mut seconds } =
                self.objective.flat_gradient(device_state.network(), &input)?;
            seconds.sample = drawing;
            sum = Some(match sum.take() {
                Some(sum) => sum + gradient,
                None => gradient,
            });
            Ok((terms, seconds))
        };
        // An adapter runs one group at a time, with all of its threads.
        let parts = numbers.chunks(self.config.micro_batch.get());
        let parts: Result<Vec<Computed<_>>, SkippedStep> = parts.map(|part| self.groups(part, &mut add)).collect();
        let done = parts.map(Computed::joined).map(|(groups, digest)| {
            record.samples_sha256 = Some(digest);
            let gradient = sum.expect("the gradient of the first group");
            let norm = device_state.update(self.state.updates, gradient, numbers.len(), record.rate, &self.config);
            (norm, groups.into_iter().unzip())
        });
        self.device_state = Some(device_state);
        let (norm, groups) = done?;
        self.state.updates += u64::from(norm.is_ok());
        complete(record, norm, groups)
    }

    /// What `compute` returns for the samples with these consecutive numbers: once for all of them if they have the same number
    /// and sizes of images, else for each run of samples that do.
    fn groups<T>(
        &self,
        numbers: &[u64],
        mut compute: impl FnMut(&SampleGroup<'_>) -> Result<T, SampleFailure>,
    ) -> Result<Computed<T>, SkippedStep> {
        let step = self.state.step;
        let start = Instant::now();
        let draw = |&number: &u64| {
            let sample = self.samples.sample(SampleId { seed: self.config.seed, number, step });
            sample.map_err(|error| {
                let reason = FailureReason::Error(error.to_string());
                SkippedStep { step, sample: format!("sample {number}"), reason }
            })
        };
        let samples: Vec<Sample> = numbers.iter().map(draw).collect::<Result<_, SkippedStep>>()?;
        for (number, sample) in numbers.iter().zip(&samples) {
            tracing::debug!(step, number, sample = sample.name.as_str(), "drew a sample");
        }
        let digests = samples.iter().map(Sample::digest).collect();
        let mut drawing = start.elapsed().as_secs_f64();
        let progress = step as f64 / self.config.steps.get() as f64;
        let mut groups = Vec::new();
        let mut done = 0;
        for samples in samples.chunk_by(Sample::has_shape_of) {
            let computed = compute(&SampleGroup { samples, first: numbers[done], progress, drawing });
            groups.push(computed.map_err(|SampleFailure { sample, reason }| SkippedStep { step, sample, reason })?);
            done += samples.len();
            drawing = 0.0;
        }
        Ok(Computed { groups, digests })
    }
}

/// Number of micro-batches whose gradients wait to be summed, each with this many numbers.
fn waiting(numbers: usize) -> usize {
    (WAITING_NUMBERS / numbers.max(1)).max(rayon::current_num_threads())
}

/// Fills in the record of a step whose gradients are known.
fn complete(
    record: &mut StepRecord,
    norm: Result<f64, FailureReason>,
    (terms, seconds): (Vec<Vec<Terms>>, Vec<PartSeconds>),
) -> Result<(), SkippedStep> {
    let sample = || "all of the step".to_owned();
    record.gradient_norm = Some(norm.map_err(|reason| SkippedStep { step: record.step, sample: sample(), reason })?);
    record.terms = Some(Terms::mean(&terms.concat()));
    record.parts = PartSeconds::sum(seconds.into_iter());
    Ok(())
}

#[cfg(test)]
mod tests {
    use atsplat_tests::on_threads;

    use super::*;

    /// 2.1 million numbers are `nano`'s, 167 million the paper's.
    #[test]
    fn few_gradients_of_a_large_network_wait() {
        let of_numbers = on_threads(3, || [1, 2_100_000, 167_000_000].map(waiting));
        assert_eq!(of_numbers, [1 << 26, 31, 3]);
    }
}
