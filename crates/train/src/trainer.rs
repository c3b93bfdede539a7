//! The loop: samples into lessons, lessons into one step, and all of it written down.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use atsplat_model::network::{Device, Network};
use atsplat_model::weights::{ModelWeights, Precision, StoredTensors, read_backbone};
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_scene::Warnings;
use burn::module::Module as _;
use rayon::prelude::*;

use crate::checkpoint::{Checkpoints, State};
use crate::config::{SourceConfig, WHAT};
use crate::evaluation::Evaluation;
use crate::fault::{Diagnosis, Fault, FaultKind};
use crate::journal::{EvaluationRecord, Journal, StepRecord};
use crate::objective::{Lesson, Objective, Seconds, Terms};
use crate::parameters::Parameters;
use crate::samples::{Draw, Source};
use crate::update::update;
use crate::{FeatureCache, TrainConfig, TrainError};

/// Where a run ends before its last step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// After so many steps in all.
    pub steps: Option<u64>,
    /// After so much time of this call.
    pub time: Option<Duration>,
}

/// What a run tells on the way.
#[derive(Debug)]
pub enum Event<'a> {
    /// A step was done or skipped.
    Step(&'a StepRecord),
    /// An evaluation.
    Evaluation(&'a EvaluationRecord),
    /// A checkpoint was written.
    Checkpoint(&'a Path),
    /// Something that does not stop the run.
    Notice(&'a str),
}

/// How a run begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Start {
    /// With fresh weights, in a folder without a run.
    Fresh,
    /// With the weights of a file, in a folder without a run.
    Weights(PathBuf),
    /// Where the folder's run stopped; from its beginning, which is told, where it had not come to a checkpoint.
    Resume,
}

/// The log of a run's steps, which is there from its beginning.
const STEPS: &str = "steps.jsonl";

/// A run in a folder.
#[derive(Debug)]
pub struct Trainer {
    config: TrainConfig,
    model: ModelConfig,
    samples: Box<dyn Source>,
    objective: Objective,
    features: Option<FeatureCache>,
    evaluation: Option<Evaluation>,
    /// Without weights; every step's network is made like it.
    like: Network,
    checkpoints: Checkpoints,
    steps: Journal,
    evaluations: Journal,
    state: State,
    faults: Vec<Fault>,
    /// What is to be told when the run goes on.
    notices: Vec<String>,
    folder: PathBuf,
}

impl Trainer {
    /// Opens data, folder and logs.
    ///
    /// # Errors
    /// [`TrainError`] where anything that the run needs is not as it should be, before long work starts.
    pub fn new(config: TrainConfig, folder: &Path, start: &Start) -> Result<Self, TrainError> {
        require_begun(folder, start)?;
        let samples = Box::new(config.samples(&mut Warnings::new())?);
        Self::with_samples(config, samples, folder, start)
    }

    /// The same on samples from elsewhere.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_samples(
        config: TrainConfig,
        samples: Box<dyn Source>,
        folder: &Path,
        start: &Start,
    ) -> Result<Self, TrainError> {
        require_begun(folder, start)?;
        let model = config.model.config()?;
        let objective = Objective::new(config.losses.clone())?;
        at_the_size_of_the_model(&config, &model)?;
        let like = Network::new(&model, &Device::flex().autodiff())?;
        let mut initial_weights = None;
        let fresh = match start {
            Start::Weights(path) => {
                let weights = ModelWeights::read(path)?;
                initial_weights = weights.sha256;
                Parameters::of_weights(&model, &weights.tensors)?
            }
            Start::Fresh | Start::Resume => {
                let frozen = match &config.model.backbone {
                    Some(path) => read_backbone(path, &model, None)?.tensors,
                    None => StoredTensors::default(),
                };
                Parameters::fresh(&model, config.seed, frozen)
            }
        };
        let features = match &config.model.feature_cache {
            Some(folder) => Some(FeatureCache::open(folder, &model, fresh.frozen())?),
            None => None,
        };
        let checkpoints = Checkpoints::new(folder, config.checkpoints.keep.get())?;
        let found = checkpoints.read(&config, &fresh)?;
        let begun = |fresh| {
            let state = State { initial_weights: initial_weights.clone(), ..State::new(fresh) };
            if config.average.is_some() { state.with_average() } else { state }
        };
        let (state, notices) = match (found, start) {
            (Some((state, passed_over)), Start::Resume) => {
                let notice = passed_over.into_iter().map(|why| format!("a checkpoint was passed over: {why}"));
                (state, notice.collect())
            }
            (None, Start::Resume) => {
                (begun(fresh), vec!["no checkpoint was written: the run begins again at step 0".to_owned()])
            }
            (None, Start::Fresh | Start::Weights(_)) => (begun(fresh), Vec::new()),
            (Some((state, _)), Start::Fresh | Start::Weights(_)) => {
                let found = format!("one of {} steps", state.step);
                return Err(TrainError::malformed("output folder", folder.display().to_string(), "no run", found));
            }
        };
        let (steps, _) = Journal::open::<StepRecord>(&folder.join(STEPS), state.step)?;
        let (evaluations, _) = Journal::open::<EvaluationRecord>(&folder.join("evaluations.jsonl"), state.step)?;
        let evaluation = match &config.evaluation {
            Some(settings) => {
                let source = settings.source.open(&config.pose_normalisation, &mut Warnings::new())?;
                let background = config.losses.background;
                Some(Evaluation::new(source.as_ref(), config.seed, settings.samples.get(), background)?)
            }
            None => None,
        };
        let folder = folder.to_owned();
        let faults = Vec::new();
        Ok(Self {
            config,
            model,
            samples,
            objective,
            features,
            evaluation,
            like,
            checkpoints,
            steps,
            evaluations,
            state,
            faults,
            notices,
            folder,
        })
    }

    /// What is known so far.
    pub const fn state(&self) -> &State {
        &self.state
    }

    /// To look at, or to break on purpose.
    pub const fn state_mut(&mut self) -> &mut State {
        &mut self.state
    }

    /// The configuration.
    pub const fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Fixed samples, where the configuration asks for an evaluation.
    pub const fn evaluation(&self) -> Option<&Evaluation> {
        self.evaluation.as_ref()
    }

    /// What the network has come to, without gradients: with averaged weights where the configuration asks for them.
    ///
    /// # Errors
    /// [`TrainError::Model`].
    pub fn network(&self) -> Result<Network, TrainError> {
        let like = Network::new(&self.model, &Device::flex())?;
        self.state.result().network(&like)
    }

    /// Trains until the configuration's last step or a limit; gives whether the last step was done. The folder then holds
    /// a checkpoint of the last step and the weights.
    ///
    /// # Errors
    /// [`TrainError::Stopped`] where steps go wrong one after the other, and what the file system says.
    pub fn run(&mut self, limits: Limits, tell: &mut dyn FnMut(&Event<'_>)) -> Result<bool, TrainError> {
        let (start, all) = (Instant::now(), self.config.steps.get());
        self.notices.drain(..).for_each(|notice| tell(&Event::Notice(&notice)));
        let last = limits.steps.map_or(all, |steps| steps.min(all));
        if self.state.step == 0 {
            self.evaluate(tell)?;
        }
        while self.state.step < last && limits.time.is_none_or(|time| start.elapsed() < time) {
            self.step(tell)?;
            let done = self.state.step;
            if let Some(settings) = &self.config.evaluation
                && (done.is_multiple_of(settings.every.get()) || done == all)
            {
                self.evaluate(tell)?;
            }
            if done.is_multiple_of(self.config.checkpoints.every.get()) && done < last {
                self.keep(tell)?;
            }
        }
        self.keep(tell)?;
        Ok(self.state.step == all)
    }

    /// One step: done, or skipped and counted.
    ///
    /// # Errors
    /// [`TrainError::Stopped`] after as many skipped steps in a row as the configuration allows.
    pub fn step(&mut self, tell: &mut dyn FnMut(&Event<'_>)) -> Result<(), TrainError> {
        let start = Instant::now();
        let step = self.state.step;
        let rate = self.config.schedule.rate(step, self.config.steps.get());
        let first = step * self.config.batch.get() as u64;
        let numbers: Vec<u64> = (first..).take(self.config.batch.get()).collect();
        let network = self.state.parameters.network(&self.like)?;
        let lesson = |number: &u64| self.lesson(*number, &network);
        let lessons: Vec<Result<Lesson, Fault>> = numbers.par_iter().map(lesson).collect();
        let mut record = StepRecord {
            step,
            terms: None,
            gradient_norm: None,
            rate,
            secs: 0.0,
            parts: Seconds::default(),
            fault: None,
        };
        let learnt: Result<Vec<Lesson>, Fault> = lessons.into_iter().collect();
        match learnt.and_then(|lessons| self.update(&lessons, rate, &mut record)) {
            Ok(()) => {
                self.state.faults_in_a_row = 0;
                self.faults.clear();
            }
            Err(fault) => {
                record.fault = Some(fault.to_string());
                self.state.faults_in_a_row += 1;
                self.faults.push(fault);
            }
        }
        self.state.step += 1;
        record.secs = start.elapsed().as_secs_f64();
        self.steps.append(&record)?;
        tell(&Event::Step(&record));
        if self.state.faults_in_a_row >= self.config.most_faults.get() {
            let faults = std::mem::take(&mut self.faults);
            let parameters = self.state.parameters.non_finite();
            return Err(TrainError::Stopped(Box::new(Diagnosis { faults, parameters })));
        }
        Ok(())
    }

    /// Each sample has a graph of its own over the same numbers: samples run beside each other.
    fn lesson(&self, number: u64, network: &Network) -> Result<Lesson, Fault> {
        let step = self.state.step;
        let fault = |sample: &str, what| Fault { step, sample: sample.to_owned(), what };
        let start = Instant::now();
        let draw = Draw { seed: self.config.seed, number, step };
        let sample = self.samples.sample(draw);
        let sample =
            sample.map_err(|error| fault(&format!("sample {number}"), FaultKind::Refused(error.to_string())))?;
        let sample_secs = start.elapsed().as_secs_f64();
        let network = network.clone().fork(&network.device());
        let lesson = self.objective.learn(&network, &sample, self.features.as_ref(), number);
        let mut lesson = lesson.map_err(|what| fault(&sample.name, what))?;
        lesson.seconds.sample = sample_secs;
        Ok(lesson)
    }

    /// Moves every parameter, and notes what moved them.
    fn update(&mut self, lessons: &[Lesson], rate: f64, record: &mut StepRecord) -> Result<(), Fault> {
        let moved = update(&mut self.state, lessons, rate, &self.config);
        let sample = || "all of the step".to_owned();
        let length = moved.map_err(|what| Fault { step: record.step, sample: sample(), what })?;
        let terms: Vec<Terms> = lessons.iter().map(|lesson| lesson.terms).collect();
        record.terms = Some(Terms::mean(&terms));
        record.gradient_norm = Some(length);
        record.parts = Seconds::sum(lessons.iter().map(|lesson| lesson.seconds));
        Ok(())
    }

    fn evaluate(&mut self, tell: &mut dyn FnMut(&Event<'_>)) -> Result<(), TrainError> {
        let Some(evaluation) = &self.evaluation else { return Ok(()) };
        match evaluation.run(&self.network()?, self.state.step) {
            Ok(record) => {
                self.evaluations.append(&record)?;
                tell(&Event::Evaluation(&record));
            }
            // A step that goes wrong in the same way is counted and stops the run; a look at it does not.
            Err(error) => tell(&Event::Notice(&format!("evaluation after step {}: {error}", self.state.step))),
        }
        Ok(())
    }

    /// Writes a checkpoint and the weights at once.
    ///
    /// # Errors
    /// As [`Checkpoints::write`].
    pub fn keep_now(&self) -> Result<(), TrainError> {
        self.keep(&mut |_| ())
    }

    fn keep(&self, tell: &mut dyn FnMut(&Event<'_>)) -> Result<(), TrainError> {
        let path = self.checkpoints.write(&self.state, &self.config)?;
        let weights = ModelWeights::new(self.model.clone(), self.provenance()?, &self.state.result().stored()?)?;
        weights.write(&self.folder.join("weights.safetensors"), Precision::Half)?;
        tell(&Event::Checkpoint(&path));
        Ok(())
    }

    /// How the weights came to be.
    fn provenance(&self) -> Result<BTreeMap<String, String>, TrainError> {
        let entries = [
            ("title", self.config.title.clone()),
            ("data", self.samples.name()),
            ("seed", self.config.seed.to_string()),
            ("steps", format!("{} of {}", self.state.step, self.config.steps)),
            ("skipped-steps", self.state.skipped().to_string()),
            ("batch", self.config.batch.to_string()),
            ("perceptual-loss", self.objective.perceptual()),
            ("pose-normalisation", self.config.pose_normalisation.name()),
            ("training-configuration", self.config.to_toml()?),
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ];
        let mut provenance: BTreeMap<String, String> = entries.map(|(key, value)| (key.to_owned(), value)).into();
        if let Some(hash) = &self.state.initial_weights {
            provenance.insert("initial-weights-sha256".to_owned(), hash.clone());
        }
        Ok(provenance)
    }
}

/// Whoever runs the weights shows them pictures at the scale of the model's resolution: that has to be the one that they learn
/// at.
fn at_the_size_of_the_model(config: &TrainConfig, model: &ModelConfig) -> Result<(), TrainError> {
    let shorter = |size: ImageSize| size.height.min(size.width);
    for data in &config.data {
        if let SourceConfig::Rooms(rooms) = &data.source
            && shorter(rooms.size) != shorter(model.resolution)
        {
            let expected = format!("the shorter side of the model's resolution, {}", model.resolution);
            return Err(TrainError::malformed(WHAT, "data.source.rooms.size", expected, rooms.size));
        }
    }
    Ok(())
}

/// To go on takes something to go on with.
fn require_begun(folder: &Path, start: &Start) -> Result<(), TrainError> {
    let is_begun = folder.join(STEPS).is_file() || folder.join("checkpoints").is_dir();
    if *start != Start::Resume || is_begun {
        return Ok(());
    }
    let expected = "a run that was begun there; one begins without `--resume`";
    Err(TrainError::malformed("output folder", folder.display().to_string(), expected, "none"))
}
