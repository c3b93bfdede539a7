//! One optimiser update of the parameters from the gradients of a batch.

use rayon::prelude::*;

use crate::TrainConfig;
use crate::checkpoint::State;
use crate::optimiser::{Update, average, clip, norm, warmed_up};
use crate::parameters::decays;
use crate::skipped_step::FailureReason;

/// Clips the mean gradient of a batch, whose sum over this many samples is `gradients`, and updates every parameter and the moving
/// averages; returns the norm of the mean before clipping. Gradients are in the order and layout of the parameters.
///
/// # Errors
/// [`FailureReason::NonFiniteGradients`] if the norm is not finite; nothing is changed.
pub(crate) fn update(
    state: &mut State,
    gradients: &[Vec<f32>],
    samples: usize,
    rate: f64,
    config: &TrainConfig,
) -> Result<f64, FailureReason> {
    let share = 1.0 / samples.max(1) as f64;
    let norm = share * norm(gradients);
    if !norm.is_finite() {
        return Err(FailureReason::NonFiniteGradients(vec!["their norm".to_owned()]));
    }
    let scale = share * clip(norm, config.clip);
    let update = Update { number: state.updates + 1, learning_rate: rate, scale };
    let decays: Vec<bool> = state.parameters.list().iter().map(decays).collect();
    let State { parameters, moments, average: means, updates, .. } = state;
    let values = parameters.values_mut().par_iter_mut().zip(moments).zip(gradients.par_iter().zip(decays));
    values.for_each(|((values, moments), (gradient, decays))| {
        config.optimiser.step(update, values, gradient, moments, decays);
    });
    if let (Some(means), Some(decay)) = (means, config.average) {
        let decay = warmed_up(decay, *updates);
        means.par_iter_mut().zip(parameters.values()).for_each(|(mean, values)| average(mean, values, decay));
    }
    *updates += 1;
    Ok(norm)
}

#[cfg(test)]
mod tests {
    use atsplat_model::parameters::Parameter;
    use atsplat_numeric::Tolerance;
    use indexmap::IndexMap;
    use serde::Deserialize;

    use super::*;
    use crate::optimiser::AdamW;
    use crate::parameters::Parameters;

    /// A few layers trained by PyTorch (`oracle/make_update.py`): for each step the gradients of each sample alone, and the
    /// parameters after `loss.mean().backward()`, `clip_grad_norm_` and `AdamW`, which decays matrices only.
    #[derive(Deserialize)]
    struct Run {
        clip: f64,
        weight_decay: f64,
        betas: [f64; 2],
        epsilon: f64,
        parameters: Vec<Start>,
        steps: Vec<Step>,
    }

    #[derive(Deserialize)]
    struct Start {
        name: String,
        shape: Vec<usize>,
        values: Vec<f32>,
    }

    #[derive(Deserialize)]
    struct Step {
        rate: f64,
        #[serde(rename = "lessons")]
        batch: Vec<IndexMap<String, Vec<f32>>>,
        norm: f64,
        after: Vec<Vec<f64>>,
    }

    fn run() -> (Run, State, TrainConfig) {
        let run: Run = serde_json::from_str(include_str!("../tests/training/fixtures/update.json")).unwrap();
        let named = |start: &Start| Parameter { name: start.name.clone(), shape: start.shape.clone(), trained: true };
        let list = run.parameters.iter().map(named).collect();
        let values = run.parameters.iter().map(|start| start.values.clone()).collect();
        let state = State::new(Parameters::of_values(list, values));
        let config = TrainConfig {
            clip: run.clip,
            optimiser: AdamW { betas: run.betas, epsilon: run.epsilon, weight_decay: run.weight_decay },
            ..TrainConfig::shortest()
        };
        (run, state, config)
    }

    /// The sum of the samples' gradients; an absent one is 0.
    fn sum(state: &State, samples: &[IndexMap<String, Vec<f32>>]) -> Vec<Vec<f32>> {
        let of_parameter = |parameter: &Parameter| {
            let mut sum = vec![0.0; parameter.elements()];
            for gradient in samples.iter().filter_map(|sample| sample.get(&parameter.name)) {
                sum.iter_mut().zip(gradient).for_each(|(sum, part)| *sum += part);
            }
            sum
        };
        state.parameters.list().iter().map(of_parameter).collect()
    }

    #[test]
    fn updates_agree_with_pytorch() {
        let (run, mut state, config) = run();
        let clipped = run.steps.iter().filter(|step| step.norm > run.clip).count();
        assert!((3..=run.steps.len() - 3).contains(&clipped), "{clipped} of {} steps are clipped", run.steps.len());
        assert!(run.parameters.iter().any(|start| start.shape.len() == 1), "vectors");
        assert!(run.parameters.iter().any(|start| start.shape.len() == 3), "more than matrices");
        for (number, step) in run.steps.iter().enumerate() {
            assert_eq!(step.batch.len(), 3);
            let gradients = sum(&state, &step.batch);
            let norm = update(&mut state, &gradients, 3, step.rate, &config).unwrap();
            Tolerance::relative(1e-6).assert([norm], [step.norm], "norm of the mean gradient");
            for ((found, expected), start) in state.parameters.values().iter().zip(&step.after).zip(&run.parameters) {
                let found = found.iter().copied().map(f64::from);
                let what = format!("{} after step {number}", start.name);
                Tolerance::absolute(3e-7).assert(found, expected.iter().copied(), &what);
            }
            assert_eq!(state.updates, number as u64 + 1);
        }
    }

    #[test]
    fn a_norm_that_is_not_finite_changes_nothing() {
        let (run, mut state, config) = run();
        let mut broken = sum(&state, &run.steps[0].batch);
        broken[0][0] = f32::NAN;
        assert!(matches!(update(&mut state, &broken, 3, 1e-2, &config), Err(FailureReason::NonFiniteGradients(_))));
        assert_eq!(state.updates, 0);
        let starts: Vec<&[f32]> = run.parameters.iter().map(|start| start.values.as_slice()).collect();
        assert_eq!(state.parameters.values(), starts);
    }
}
