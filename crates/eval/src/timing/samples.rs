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

/// A warm-up of which a timed part takes longer than in the next run by this factor prepared something, such as a model's weights:
/// both count as warm-ups.
const COLD: f64 = 1.1;
/// Seconds by which it takes longer at least, as the times of short parts vary by more than [`COLD`].
const COLD_SECS: f64 = 0.01;

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

/// Seconds of one run of a method.
#[derive(Clone, Copy, Debug)]
struct Parts {
    encode: f64,
    /// Of all targets.
    render: f64,
}

impl Parts {
    /// Both, timed or not.
    const fn sum(self) -> f64 {
        self.encode + self.render
    }

    /// The parts that are timed; nothing for others.
    const fn of(self, timed: Timed) -> Self {
        Self {
            encode: if timed.encoding { self.encode } else { 0.0 },
            render: if timed.rendering { self.render } else { 0.0 },
        }
    }

    /// Whether it prepared something that the next run had.
    fn is_cold(self, next: Self) -> bool {
        let is_slower = |secs: f64, next: f64| secs > COLD * next && secs - next > COLD_SECS;
        is_slower(self.encode, next.encode) || is_slower(self.render, next.render)
    }
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
        let (timed, mut repetitions, mut total, mut first) = (method.timed(), 0, 0.0, None);
        for _ in 0..plan.warm_up {
            let before = samples.clone();
            let parts = samples.repeat(input, method, &targets)?;
            if parts.of(timed).sum() >= plan.warm_up_until.as_secs_f64() {
                (repetitions, total, first) = (1, parts.sum(), Some((before, parts.of(timed))));
                break;
            }
            samples = Self { warm_up: before.warm_up + 1, ..before };
        }
        while !plan.is_enough(repetitions, samples.secs_of(timed))
            || (total < MIN_DURATION.as_secs_f64() && repetitions < MAX_REPETITIONS)
        {
            let parts = samples.repeat(input, method, &targets)?;
            if let Some((before, first)) = first.take()
                && first.is_cold(parts.of(timed))
            {
                samples = Self { warm_up: before.warm_up + 2, ..before };
                (repetitions, total) = (0, 0.0);
                continue;
            }
            repetitions += 1;
            total += parts.sum();
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

    /// Runs the method once: from context images to a scene, then renders some targets.
    fn repeat(&mut self, input: TrialInput<'_>, method: &dyn Method, targets: &[usize]) -> Result<Parts, MethodError> {
        let start = Instant::now();
        let prediction = method.predict(input)?;
        let mut parts = Parts { encode: start.elapsed().as_secs_f64(), render: 0.0 };
        self.encode.push(parts.encode);
        let cost = prediction.cost();
        self.process_peak_bytes = cost.process_peak_bytes.or(self.process_peak_bytes);
        for (name, secs) in cost.stages {
            self.stages.entry(name).or_default().push(secs);
        }
        for target in targets {
            let secs = render_secs(prediction.as_ref(), *target).map_err(MethodError::Failed)?;
            self.render.push(secs);
            parts.render += secs;
        }
        Ok(parts)
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

    /// Files of Gaussians are read in five seconds each time; the first render prepares something.
    #[test]
    fn a_run_is_cold_by_its_timed_parts_alone() {
        let parts = |encode, render| Parts { encode, render };
        let (first, next) = (parts(5.0, 0.3), parts(5.1, 0.1));
        assert!(first.of(Timed::RENDERING).is_cold(next.of(Timed::RENDERING)));
        let all = Timed { encoding: true, rendering: true };
        assert!(first.of(all).is_cold(next.of(all)), "however long the encoding takes");
        let encoding = Timed { encoding: true, rendering: false };
        assert!(!first.of(encoding).is_cold(next.of(encoding)));
        assert!((first.of(Timed::RENDERING).sum() - 0.3).abs() < 1e-12, "which is no long work");
        assert!(!parts(5.0, 0.003).is_cold(parts(5.0, 0.001)), "short times vary");
        assert!(!next.is_cold(first), "a slower run after it");
    }

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
