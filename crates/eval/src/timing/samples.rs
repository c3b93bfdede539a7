use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

use atsplat_pixels::ImageU8;
use atsplat_protocol::Preset;
use atsplat_protocol::trial::Trial;

use super::{TimingPlan, memory};
use crate::method::{Answer, Method, Question, Refusal};
use crate::runner::spread;

/// Pictures of a trial that each repetition renders.
const PICTURES: usize = 3;
/// Short work is repeated until it took so long in all, so that the machine's load can be told.
const LEAST: Duration = Duration::from_millis(50);
/// No more repetitions than these for that.
const MOST: usize = 200;

/// Seconds from which on work is long: two repetitions tell its spread, and a pass must not last for hours.
const LONG: f64 = 5.0;

/// A trial with its context pictures decoded.
#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) trial: Trial,
    pub(super) pictures: Vec<Arc<ImageU8>>,
}

/// Whether so many repetitions, which took so long in all, suffice because each was long.
pub(super) fn is_long(repetitions: usize, secs: f64) -> bool {
    repetitions >= 2 && secs >= LONG * repetitions as f64
}

/// What the clock said.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Samples {
    pub(super) encode: Vec<f64>,
    pub(super) render: Vec<f64>,
    pub(super) stages: BTreeMap<String, Vec<f64>>,
    pub(super) held_bytes: Option<u64>,
    pub(super) peak_bytes: Option<u64>,
}

impl Samples {
    /// Repeats a method's work on one trial, on the threads that the caller runs in.
    pub(super) fn of(
        plan: TimingPlan,
        preset: &Preset,
        prepared: &Prepared,
        method: &dyn Method,
    ) -> Result<Self, String> {
        let question = Question { preset, trial: &prepared.trial, pictures: &prepared.pictures };
        // A method's bug costs its times and nothing else.
        let measured = catch_unwind(AssertUnwindSafe(|| Self::measured(plan, question, method)));
        measured.unwrap_or_else(|_panic| Err("the method panicked".to_owned()))
    }

    fn measured(plan: TimingPlan, question: Question<'_>, method: &dyn Method) -> Result<Self, String> {
        let targets = question.trial.targets().len();
        let targets = spread(targets, PICTURES);
        let (mut samples, mut start) = (Self::default(), Instant::now());
        let can_forget = memory::forget_peak();
        samples.held_bytes = memory::held_bytes();
        for _ in 0..plan.warm_up {
            Self::default().repeat(question, method, &targets)?;
            start = Instant::now();
        }
        let mut repetitions = 0;
        while repetitions < plan.repetitions as usize || (start.elapsed() < LEAST && repetitions < MOST) {
            samples.repeat(question, method, &targets)?;
            repetitions += 1;
            if is_long(repetitions, start.elapsed().as_secs_f64()) {
                break;
            }
        }
        samples.peak_bytes = memory::peak_bytes().filter(|_| can_forget);
        let timed = method.timed();
        if !timed.encoding {
            samples.encode.clear();
            samples.stages.clear();
        }
        if !timed.rendering {
            samples.render.clear();
        }
        Ok(samples)
    }

    /// Once from pictures to Gaussians and on to some pictures of them.
    fn repeat(&mut self, question: Question<'_>, method: &dyn Method, targets: &[usize]) -> Result<(), String> {
        let start = Instant::now();
        let answer = method.begin(question).map_err(|refusal: Refusal| refusal.to_string())?;
        self.encode.push(start.elapsed().as_secs_f64());
        for (name, secs) in &answer.cost().stages {
            self.stages.entry(name.clone()).or_default().push(*secs);
        }
        for target in targets {
            self.render.push(rendered(answer.as_ref(), *target)?);
        }
        Ok(())
    }
}

/// Seconds for one picture.
fn rendered(answer: &dyn Answer, target: usize) -> Result<f64, String> {
    let start = Instant::now();
    let pictures = answer.render(&[target]);
    let secs = start.elapsed().as_secs_f64();
    match pictures.into_iter().next() {
        Some(picture) => picture.map(|_picture| secs),
        None => Err(format!("no picture of target {target}")),
    }
}
