use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

use atsplat_pixels::ImageU8;
use atsplat_protocol::Preset;
use atsplat_protocol::trial::Trial;
use atsplat_results::times::rendered_targets;

use super::load::LoadMonitor;
use super::{TimingPlan, memory};
use crate::method::{Method, MethodError, Prediction, Timed, TrialInput};

/// Short work is repeated for at least this long, so that the machine's load can be measured.
const MIN_DURATION: Duration = LoadMonitor::SHORTEST;
/// Maximum number of repetitions for that purpose.
const MAX_REPETITIONS: usize = 200;

/// A warm-up that takes longer than the next run by this factor prepared something, such as a model's weights: both count as
/// warm-ups.
const COLD: f64 = 1.1;

/// A trial with decoded context images.
#[derive(Debug)]
pub(super) struct PreparedTrial {
    pub(super) trial: Trial,
    pub(super) images: Vec<Arc<ImageU8>>,
}

/// Measured times and memory.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Samples {
    /// Runs before the repetitions, which do not count.
    pub(super) warm_up: u32,
    pub(super) encode: Vec<f64>,
    pub(super) render: Vec<f64>,
    pub(super) stages: BTreeMap<String, Vec<f64>>,
    pub(super) held_bytes: Option<u64>,
    pub(super) peak_bytes: Option<u64>,
    /// Peak memory of the method's processes, if it has any.
    pub(super) process_peak_bytes: Option<u64>,
}

impl Samples {
    /// Repeats a method's work on one trial in the caller's thread pool.
    pub(super) fn of(
        plan: TimingPlan,
        preset: &Preset,
        prepared: &PreparedTrial,
        method: &dyn Method,
    ) -> Result<Self, MethodError> {
        let preset = preset.rendered_for(method.setting());
        let input = TrialInput { preset: &preset, trial: &prepared.trial, images: &prepared.images };
        // A panic in the method costs its times only.
        let measured = catch_unwind(AssertUnwindSafe(|| Self::measured(plan, input, method)));
        measured.unwrap_or_else(|_panic| Err(MethodError::Failed("the method panicked".to_owned())))
    }

    fn measured(plan: TimingPlan, input: TrialInput<'_>, method: &dyn Method) -> Result<Self, MethodError> {
        let targets = rendered_targets(input.trial.targets().len());
        let mut samples = Self::default();
        let is_peak_reset = memory::reset_peak();
        samples.held_bytes = memory::held_bytes();
        let (timed, mut repetitions, mut total, mut before_first) = (method.timed(), 0, 0.0, None);
        for _ in 0..plan.warm_up {
            let before = samples.clone();
            let secs = samples.repeat(input, method, &targets)?;
            if secs >= plan.warm_up_until.as_secs_f64() {
                (repetitions, total, before_first) = (1, secs, Some(before));
                break;
            }
            samples = Self { warm_up: before.warm_up + 1, ..before };
        }
        while !plan.is_enough(repetitions, samples.secs_of(timed))
            || (total < MIN_DURATION.as_secs_f64() && repetitions < MAX_REPETITIONS)
        {
            let secs = samples.repeat(input, method, &targets)?;
            if let Some(before) = before_first.take()
                && total > COLD * secs
            {
                samples = Self { warm_up: before.warm_up + 2, ..before };
                (repetitions, total) = (0, 0.0);
                continue;
            }
            repetitions += 1;
            total += secs;
        }
        samples.peak_bytes = memory::peak_bytes().filter(|_| is_peak_reset);
        if samples.process_peak_bytes.is_some() {
            (samples.held_bytes, samples.peak_bytes) = (None, samples.process_peak_bytes);
        }
        if !timed.encoding {
            samples.encode.clear();
            samples.stages.clear();
        }
        if !timed.rendering {
            samples.render.clear();
        }
        samples.check_stages().map_err(MethodError::Failed)?;
        Ok(samples)
    }

    /// Seconds of the parts that are timed.
    fn secs_of(&self, timed: Timed) -> f64 {
        let encode = self.encode.iter().filter(|_| timed.encoding);
        encode.chain(self.render.iter().filter(|_| timed.rendering)).sum()
    }

    /// A table has one sample of each stage for each repetition.
    fn check_stages(&self) -> Result<(), String> {
        let repetitions = self.encode.len();
        match self.stages.iter().find(|(_, secs)| secs.len() != repetitions) {
            None => Ok(()),
            Some((name, secs)) => Err(format!(
                "expected seconds of the stage {name} for each of {repetitions} repetitions of a trial, or for none, found {}",
                secs.len()
            )),
        }
    }

    /// Runs the method once: from context images to a scene, then renders some targets. Returns the seconds of all of it.
    fn repeat(&mut self, input: TrialInput<'_>, method: &dyn Method, targets: &[usize]) -> Result<f64, MethodError> {
        let start = Instant::now();
        let prediction = method.predict(input)?;
        self.encode.push(start.elapsed().as_secs_f64());
        let cost = prediction.cost();
        self.process_peak_bytes = cost.process_peak_bytes.or(self.process_peak_bytes);
        for (name, secs) in cost.stages {
            self.stages.entry(name).or_default().push(secs);
        }
        for target in targets {
            self.render.push(render_secs(prediction.as_ref(), *target).map_err(MethodError::Failed)?);
        }
        Ok(start.elapsed().as_secs_f64())
    }
}

/// Seconds to render one target.
fn render_secs(prediction: &dyn Prediction, target: usize) -> Result<f64, String> {
    let start = Instant::now();
    let images = prediction.render(&[target]);
    let secs = start.elapsed().as_secs_f64();
    match images.into_iter().next() {
        Some(image) => image.map(|_image| secs),
        None => Err(format!("no image of target {target}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_of_some_repetitions_only_is_rejected() {
        let samples = |stages: [(&str, &[f64]); 2]| Samples {
            encode: vec![1.0, 2.0, 3.0, 4.0, 5.0],
            stages: stages.map(|(name, secs)| (name.to_owned(), secs.to_vec())).into(),
            ..Samples::default()
        };
        let always = [0.5; 5];
        assert_eq!(samples([("a", &always), ("b", &always)]).check_stages(), Ok(()));
        assert_eq!(Samples { encode: vec![1.0], ..Samples::default() }.check_stages(), Ok(()), "no stages");
        // Three and five samples would be read back as four and four.
        let why = samples([("a", &always[..3]), ("b", &always)]).check_stages().unwrap_err();
        assert!(why.contains("stage a for each of 5") && why.ends_with("found 3"), "{why}");
        let equally_few = samples([("a", &always[..3]), ("b", &always[..3])]);
        assert!(equally_few.check_stages().is_err(), "they are not one per repetition");
    }
}
