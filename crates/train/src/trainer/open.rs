//! Opens a run: the processor that computes it, its data, and what its folder contains of it.

use std::collections::BTreeSet;
use std::path::Path;

use atsplat_files::Sha256Digest;
use atsplat_model::network::{Device, MatmulPrecision, Network, Processor};
use atsplat_model::{ModelConfig, ModelError};
use atsplat_scene::Warnings;
use atsplat_splat::gpu::AdapterDescription;

use super::computed_by::{ComputedBy, with_driver};
use super::sample_check::RunLogs;
use super::start::{Opened, Run, Start};
use super::{EVALUATIONS, STEPS, Trainer, new_run};
use crate::checkpoint::{Checkpoints, State};
use crate::device_state::DeviceState;
use crate::evaluation::Evaluation;
use crate::logs::{EvaluationRecord, LogFile, StepRecord};
use crate::objective::Objective;
use crate::samples::{DataWarnings, Source};
use crate::{FeatureCache, Resolved, TrainConfig, TrainError};

impl Trainer {
    /// Opens a run whose start was checked, and which a program of this `commit`, if it is known, computes on a processor.
    pub(super) fn open(
        processor: Processor,
        commit: Option<&str>,
        config: TrainConfig,
        samples: Box<dyn Source>,
        folder: &Path,
        start: &Start,
    ) -> Result<Self, TrainError> {
        let model = config.model.config()?;
        config.check_model(&model)?;
        let environment = Environment::open(processor, &config, &model)?;
        let evaluated = evaluation_source(&config)?;
        let resolved = Resolved::new(&config, &model, &environment.objective)?;
        let resolved = resolved.with_scenes(samples.as_ref(), evaluated.as_deref());
        let checkpoints = Checkpoints::new(folder, config.checkpoints.keep.get(), resolved);
        let computed_by = ComputedBy::new(environment.adapter.clone(), commit);
        let run = Run { config: &config, model: &model, folder, checkpoints: &checkpoints, computed_by: &computed_by };
        let Opened { state, mut notices, processor_changed, moved, lock } = start.open(&run)?;
        let run_logs = RunLogs { folder, done: state.step, processor_changed, moved: &moved };
        notices.extend(run_logs.check_training(&config, samples.as_ref())?);
        let features = environment.features(&config, &model, &state)?;
        notices.extend(slow_products(&config));
        notices.extend(unreached_rate(&config));
        notices.extend(config.notices(&model));
        notices.extend(samples.notices());
        let evaluation = evaluation_of(&config, evaluated.as_deref(), &mut notices)?;
        let evaluation_warnings = evaluated.as_deref().map_or_else(DataWarnings::default, Source::data_warnings);
        notices.extend(run_logs.check_evaluation(evaluation.as_ref())?);
        let (template, device_state) = environment.networks(&state)?;
        // Not earlier: what fails before leaves no folder.
        let lock = lock.map_or_else(|| new_run::create(folder), Ok)?;
        if matches!(start, Start::Weights(_)) {
            // Before the log: with a log but no checkpoint, a run would resume from newly initialised weights.
            checkpoints.write(&state, &config)?;
        }
        let (steps, evaluations) = logs(folder, state.step, &mut notices)?;
        let Environment { device, objective, .. } = environment;
        Ok(Self {
            // Those of the check are not the run's.
            replaced_so_far: samples.replaced().count,
            config,
            model,
            samples,
            objective,
            features,
            evaluation,
            device,
            template,
            checkpoints,
            steps,
            evaluations,
            state,
            device_state,
            skipped: Vec::new(),
            notices,
            evaluation_warnings,
            reported_warnings: Warnings::new(),
            reported_replaced_scenes: BTreeSet::new(),
            reported_unstable_scenes: 0,
            zero_gradients: 0,
            folder: folder.to_owned(),
            _lock: lock,
        })
    }
}

/// What computes the steps of a run.
struct Environment {
    processor: Processor,
    device: Device,
    template: Network,
    objective: Objective,
    /// The graphics adapter; `None` for the CPU.
    adapter: Option<AdapterDescription>,
}

impl Environment {
    fn open(processor: Processor, config: &TrainConfig, model: &ModelConfig) -> Result<Self, TrainError> {
        let device = rendering_device(processor)?;
        let template = Network::new(model, &device.clone().autodiff())?;
        let objective = match processor {
            Processor::Cpu => Objective::new(config.losses.clone()),
            // Losses are part of the graph: images do not leave the adapter.
            Processor::Wgpu(_) => Objective::in_graph(config.losses.clone(), &template.device()),
        }?;
        let adapter = processor.adapter()?.map(|(_, adapter)| adapter);
        Ok(Self { processor, device, template, objective, adapter })
    }

    /// The cache of a frozen backbone's features, if the configuration has one; each adapter with each of its drivers has a separate
    /// folder.
    fn features(
        &self,
        config: &TrainConfig,
        model: &ModelConfig,
        state: &State,
    ) -> Result<Option<FeatureCache>, TrainError> {
        let Some(folder) = &config.model.feature_cache else { return Ok(None) };
        let subfolder = |adapter: &AdapterDescription| Sha256Digest::of(with_driver(adapter).as_bytes()).to_string();
        let of_adapter = self.adapter.as_ref().map(|adapter| folder.join(subfolder(adapter)));
        let folder = of_adapter.as_ref().unwrap_or(folder);
        Ok(Some(FeatureCache::open(folder, model, state.parameters.frozen(), config.matmul_precision)?))
    }

    /// The template of the steps' networks, and the state on an adapter, which has a network of its own. On the CPU, the template has
    /// the frozen weights, so that no step has to read them.
    fn networks(&self, state: &State) -> Result<(Network, Option<DeviceState>), TrainError> {
        match self.processor {
            Processor::Cpu => Ok((state.parameters.network(&self.template)?, None)),
            Processor::Wgpu(_) => Ok((self.template.clone(), Some(DeviceState::new(state, &self.template)?))),
        }
    }
}

/// The device of a processor that renders.
fn rendering_device(processor: Processor) -> Result<Device, TrainError> {
    let device = processor.open()?;
    match processor.render_error() {
        None => Ok(device),
        Some(why) => Err(ModelError::Processor { processor, why: format!("it cannot render: {why}") }.into()),
    }
}

/// The source of the evaluation's samples, if the configuration has an evaluation.
fn evaluation_source(config: &TrainConfig) -> Result<Option<Box<dyn Source>>, TrainError> {
    let Some(settings) = &config.evaluation else { return Ok(None) };
    // The source counts what is wrong with its data.
    let source = settings.source.open(&config.pose_normalisation, None, &mut Warnings::new());
    source.map(Some).map_err(|error| error.of_evaluation().below("evaluation.source.dataset"))
}

/// The evaluation on fixed samples, if the configuration has one.
fn evaluation_of(
    config: &TrainConfig,
    source: Option<&dyn Source>,
    notices: &mut Vec<String>,
) -> Result<Option<Evaluation>, TrainError> {
    let (Some(settings), Some(source)) = (&config.evaluation, source) else { return Ok(None) };
    let background = config.losses.background;
    let seed = settings.seed.unwrap_or(config.seed);
    let evaluation = Evaluation::new(source, seed, settings.samples.get(), background)?;
    let replaced = Some(source.replaced()).filter(|replaced| replaced.count > 0);
    if let Some(replaced) = &replaced {
        replaced.log_new(&BTreeSet::new());
    }
    let replaced = replaced.map(|replaced| replaced.to_string());
    let unstable = source.unstable_poses().if_any().map(|unstable| unstable.to_string());
    let of_source = source.notices().into_iter().chain(replaced).chain(unstable);
    notices.extend(of_source.map(|notice| format!("evaluation: {notice}")));
    Ok(Some(evaluation))
}

fn slow_products(config: &TrainConfig) -> Option<String> {
    let is_slow = config.matmul_precision != MatmulPrecision::F32 && !config.matmul_precision.is_fast();
    is_slow.then(|| {
        "matrix products take longer in bfloat16 than in f32 on this processor, which has no instructions for bfloat16"
            .to_owned()
    })
}

/// That the run ends before its learning rate has risen to the configuration's.
fn unreached_rate(config: &TrainConfig) -> Option<String> {
    let (warm_up, steps) = (config.schedule.warm_up_steps, config.steps.get());
    let last = config.schedule.rate(steps - 1, steps);
    (warm_up > steps).then(|| {
        format!("schedule.warm-up-steps: {warm_up} in a run of {steps}, whose last learning rate is {last:.2e}")
    })
}

/// The logs of steps and evaluations, up to the number of steps done.
fn logs(folder: &Path, done: u64, notices: &mut Vec<String>) -> Result<(LogFile, LogFile), TrainError> {
    let (steps, logged) = LogFile::open::<StepRecord>(&folder.join(STEPS), done)?;
    if (logged.len() as u64) < done {
        notices.push(format!("{STEPS}: expected the {done} steps so far, found {}", logged.len()));
    }
    let (evaluations, _) = LogFile::open::<EvaluationRecord>(&folder.join(EVALUATIONS), done)?;
    Ok((steps, evaluations))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight steps of a warm-up of a thousand end at 8/1000 of 2e-4.
    #[test]
    fn a_warm_up_that_outlasts_the_run_is_reported() {
        let mut config = TrainConfig::shortest();
        let expected = "schedule.warm-up-steps: 1000 in a run of 8, whose last learning rate is 1.60e-6";
        assert_eq!(unreached_rate(&config).as_deref(), Some(expected));
        config.schedule.warm_up_steps = 8;
        assert_eq!(unreached_rate(&config), None);
    }
}
