//! The training loop: steps, evaluations, logs and checkpoints.

mod backbone;
mod computed_by;
mod initial_weights;
mod new_run;
mod open;
mod resumed;
mod sample_check;
mod start;
mod step;
mod weights;

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use atsplat_files::FolderLock;
use atsplat_model::ModelConfig;
use atsplat_model::network::{Device, MatmulPrecision, Network, Processor};
use atsplat_scene::Warnings;

pub(crate) use backbone::frozen;
pub use start::Start;

use crate::checkpoint::{Checkpoints, State};
use crate::config::WHAT;
use crate::device_state::DeviceState;
use crate::evaluation::Evaluation;
use crate::logs::{EvaluationRecord, LogFile, StepRecord};
use crate::objective::Objective;
use crate::samples::{DataWarnings, ReplacedDraws, Source};
use crate::skipped_step::SkippedStep;
use crate::{FeatureCache, TrainConfig, TrainError};

/// If a call of [`Trainer::run`] stops before the configuration's last step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// After this many steps of the whole run.
    pub steps: Option<u64>,
    /// After this much time in this call.
    pub time: Option<Duration>,
}

/// What a run reports as it happens.
#[derive(Debug)]
pub enum Event<'a> {
    /// A step was done or skipped.
    Step(&'a StepRecord),
    /// An evaluation was done.
    Evaluation(&'a EvaluationRecord),
    /// A checkpoint was written.
    Checkpoint(&'a Path),
    /// A problem that does not stop the run, or what must be known about its data.
    Notice(&'a str),
    /// All draws of this call that gave no sample and were replaced; reported again if they are of more scenes.
    Replaced(&'a ReplacedDraws),
}

/// The log of a run's steps, created when the run starts.
const STEPS: &str = "steps.jsonl";
/// The log of its evaluations.
const EVALUATIONS: &str = "evaluations.jsonl";
/// A run's weights, written with each checkpoint.
pub const WEIGHTS: &str = "weights.safetensors";

/// A run in a folder.
#[derive(Debug)]
pub struct Trainer {
    config: TrainConfig,
    model: ModelConfig,
    samples: Box<dyn Source>,
    objective: Objective,
    features: Option<FeatureCache>,
    evaluation: Option<Evaluation>,
    /// Runs the network and its renderer.
    device: Device,
    /// On the CPU, the network of every step is a copy of it with other trained weights.
    template: Network,
    checkpoints: Checkpoints,
    steps: LogFile,
    evaluations: LogFile,
    /// While the run is on a graphics adapter, its weights, moments and averages are those before the first step of this call.
    state: State,
    /// The current ones, on a graphics adapter.
    device_state: Option<DeviceState>,
    /// The latest steps, if they were skipped.
    skipped: Vec<SkippedStep>,
    /// To be reported when the run starts.
    notices: Vec<String>,
    /// Warnings counted while the evaluation's samples were made.
    evaluation_warnings: DataWarnings,
    /// Warnings that were reported.
    reported_warnings: Warnings,
    /// Scenes whose replaced draws were reported.
    reported_replaced_scenes: BTreeSet<String>,
    /// Number of scenes that were reported because samples of theirs have poses without a stable normalisation.
    reported_unstable_scenes: usize,
    /// Number of steps of this call whose gradient is 0.
    zero_gradients: u64,
    /// Number of replaced draws before the next step.
    replaced_so_far: u64,
    folder: PathBuf,
    /// Keeps other processes from training in the folder.
    _lock: FolderLock,
}

impl Trainer {
    /// Opens data, folder and logs.
    ///
    /// # Errors
    /// [`TrainError`] if anything that the run needs is missing or malformed, and [`TrainError::InUse`] if another process trains in
    /// the folder; all of it is checked before long work starts.
    pub fn new(config: TrainConfig, folder: &Path, start: &Start) -> Result<Self, TrainError> {
        Self::on(Processor::Cpu, None, config, folder, start)
    }

    /// [`Self::new`] with network, renderer, losses and optimiser on this processor; the evaluation's renders are the CPU's. On a
    /// graphics adapter, groups of samples run one after the other, images and weights stay there, and steps are not those of the
    /// CPU bit for bit. Checkpoints and weights record the program's version and its `commit`, if that is known.
    ///
    /// # Errors
    /// As [`Self::new`]; [`TrainError::Model`] if the processor cannot be opened or does not render, [`TrainError::Malformed`] if
    /// the resumed run was computed on another adapter, or on the CPU instead of one, and for matrix products in bfloat16 on an
    /// adapter.
    pub fn on(
        processor: Processor,
        commit: Option<&str>,
        config: TrainConfig,
        folder: &Path,
        start: &Start,
    ) -> Result<Self, TrainError> {
        processor.check_build()?;
        if config.matmul_precision != MatmulPrecision::F32 && processor != Processor::Cpu {
            let expected = "f32 on a graphics adapter";
            return Err(TrainError::malformed(WHAT, "matmul-precision", expected, config.matmul_precision.name()));
        }
        start.check(&config, folder)?;
        // The sources count what is wrong with their data.
        let samples = Box::new(config.samples(&mut Warnings::new())?);
        Self::open(processor, commit, config, samples, folder, start)
    }

    /// [`Self::new`] on samples of another source.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_samples(
        config: TrainConfig,
        samples: Box<dyn Source>,
        folder: &Path,
        start: &Start,
    ) -> Result<Self, TrainError> {
        start.check(&config, folder)?;
        Self::open(Processor::Cpu, None, config, samples, folder, start)
    }

    /// The state after the last step; on a graphics adapter, weights, moments and averages are those before this call's first step
    /// ([`Self::current_state`] reads them).
    pub const fn state(&self) -> &State {
        &self.state
    }

    /// The state after the last step, on whatever processor it is.
    pub fn current_state(&self) -> Cow<'_, State> {
        let Some(device_state) = &self.device_state else { return Cow::Borrowed(&self.state) };
        let mut state = self.state.clone();
        device_state.copy_to(&mut state);
        Cow::Owned(state)
    }

    /// The state, to be changed in tests.
    pub const fn state_mut(&mut self) -> &mut State {
        &mut self.state
    }

    /// The configuration.
    pub const fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// The evaluation on fixed samples, if the configuration has one.
    pub const fn evaluation(&self) -> Option<&Evaluation> {
        self.evaluation.as_ref()
    }

    /// What was wrong with the data so far without stopping the run; a scene's warnings are counted once, however often it
    /// is loaded, and by how many sources. [`Self::run`] reports them as notices, kind by kind.
    pub fn warnings(&self) -> Warnings {
        let mut warnings = self.evaluation_warnings.clone();
        warnings.merge(self.samples.data_warnings());
        warnings.total()
    }

    /// The network with its current weights, or their average if the configuration has one, without gradients.
    ///
    /// # Errors
    /// [`TrainError::Model`].
    pub fn network(&self) -> Result<Network, TrainError> {
        let template = Network::new(&self.model, &self.device)?.trained_at(self.model.resolution);
        self.current_state().result().network(&template)
    }

    /// Trains until the configuration's last step or a limit, and reports how many draws were replaced in the run so far; returns
    /// whether the last step was done. The folder then contains a checkpoint of the last step and the weights.
    ///
    /// # Errors
    /// [`TrainError::Stopped`] after too many skipped steps in a row, [`TrainError::Untrained`] if all steps so far were skipped;
    /// [`TrainError::Io`] and others if files cannot be written.
    pub fn run(&mut self, limits: Limits, on_event: &mut dyn FnMut(&Event<'_>)) -> Result<bool, TrainError> {
        let (start, all) = (Instant::now(), self.config.steps.get());
        self.notices.drain(..).for_each(|notice| on_event(&Event::Notice(&notice)));
        self.report_warnings(on_event);
        self.zero_gradients = 0;
        let trained = self.train(limits, start, on_event);
        self.report_warnings(on_event);
        let zeros = self.zero_gradients;
        // The first one was reported when it happened.
        if zeros > 1 {
            on_event(&Event::Notice(&format!("{zeros} steps trained nothing, as their gradients are 0")));
        }
        let State { step, replaced, .. } = &self.state;
        if replaced.count > 0 {
            let total = format!("draws that gave no sample and were replaced, up to step {step}: {replaced}");
            on_event(&Event::Notice(&total));
        }
        trained.map(|()| self.state.step == all)
    }

    fn train(
        &mut self,
        limits: Limits,
        start: Instant,
        on_event: &mut dyn FnMut(&Event<'_>),
    ) -> Result<(), TrainError> {
        let all = self.config.steps.get();
        let last = limits.steps.map_or(all, |steps| steps.min(all));
        if self.state.step == 0 {
            self.evaluate(on_event)?;
        }
        while self.state.step < last && limits.time.is_none_or(|time| start.elapsed() < time) {
            self.step(on_event)?;
            let done = self.state.step;
            if let Some(settings) = &self.config.evaluation
                && (done.is_multiple_of(settings.every.get()) || done == all)
            {
                self.evaluate(on_event)?;
            }
            if done.is_multiple_of(self.config.checkpoints.every.get()) && done < last {
                self.report_checkpoint(on_event)?;
            }
        }
        self.require_update()?;
        self.report_checkpoint(on_event)
    }

    /// Whether all steps so far were skipped, of which there are some: its weights would look trained.
    const fn is_untrained(&self) -> bool {
        self.state.step > 0 && self.state.updates == 0
    }

    /// An error if all steps so far were skipped.
    fn require_update(&self) -> Result<(), TrainError> {
        if !self.is_untrained() {
            return Ok(());
        }
        // Those of earlier calls are in the log alone.
        let last = self.skipped.last().map_or_else(|| format!("see {STEPS}"), ToString::to_string);
        Err(TrainError::Untrained { steps: self.state.step, last })
    }

    /// Reports each kind of warning whose count grew since the last report, with its first example, and replaced draws and poses without
    /// a stable normalisation if they are of more scenes.
    fn report_warnings(&mut self, on_event: &mut dyn FnMut(&Event<'_>)) {
        let warnings = self.warnings();
        let reported = |kind| self.reported_warnings.count(kind);
        for (kind, count, first) in warnings.summary().filter(|(kind, count, _)| *count > reported(*kind)) {
            on_event(&Event::Notice(&format!("warning: {count} × {kind}; the first: {first}")));
        }
        self.reported_warnings = warnings;
        let replaced = self.samples.replaced();
        if replaced.scenes.len() > self.reported_replaced_scenes.len() {
            replaced.log_new(&self.reported_replaced_scenes);
            on_event(&Event::Replaced(&replaced));
            self.reported_replaced_scenes.extend(replaced.scenes.into_keys());
        }
        let unstable = self.samples.unstable_poses();
        if unstable.scenes.len() > self.reported_unstable_scenes {
            on_event(&Event::Notice(&unstable.to_string()));
            self.reported_unstable_scenes = unstable.scenes.len();
        }
    }

    fn evaluate(&mut self, on_event: &mut dyn FnMut(&Event<'_>)) -> Result<(), TrainError> {
        let Some(evaluation) = &self.evaluation else { return Ok(()) };
        match evaluation.run(&self.network()?, self.state.step) {
            Ok(record) => {
                self.evaluations.append(&record)?;
                on_event(&Event::Evaluation(&record));
            }
            // A step that fails in the same way is counted and stops the run; a failed evaluation does not.
            Err(error) => on_event(&Event::Notice(&format!("evaluation after step {}: {error}", self.state.step))),
        }
        Ok(())
    }

    fn report_checkpoint(&mut self, on_event: &mut dyn FnMut(&Event<'_>)) -> Result<(), TrainError> {
        let path = self.write_checkpoint()?;
        on_event(&Event::Checkpoint(&path));
        self.report_warnings(on_event);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
