//! One update: what a batch of lessons does to the parameters.

use rayon::prelude::*;

use crate::TrainConfig;
use crate::checkpoint::State;
use crate::fault::FaultKind;
use crate::objective::Lesson;
use crate::optimiser::{Update, average, clip, kept, norm};
use crate::parameters::decays;

/// Averages the gradients in the order of the samples, clips the mean, and moves every parameter and the moving averages; gives the mean's length
/// before it was clipped. A parameter that a lesson says nothing of has a gradient of zero there.
///
/// # Errors
/// [`FaultKind::Gradients`] where the length is no number; nothing was changed.
pub(crate) fn update(state: &mut State, lessons: &[Lesson], rate: f64, config: &TrainConfig) -> Result<f64, FaultKind> {
    let share = 1.0 / lessons.len().max(1) as f64;
    let list = state.parameters.list();
    let gradients: Vec<Vec<f32>> = list
        .par_iter()
        .map(|parameter| {
            let mut sum = vec![0.0f32; parameter.elements()];
            for gradient in lessons.iter().filter_map(|lesson| lesson.gradients.get(&parameter.name)) {
                sum.iter_mut().zip(gradient).for_each(|(sum, part)| *sum += part);
            }
            sum
        })
        .collect();
    let length = share * norm(gradients.iter().map(Vec::as_slice));
    if !length.is_finite() {
        return Err(FaultKind::Gradients(vec!["their norm".to_owned()]));
    }
    let scale = share * clip(length, config.clip);
    let update = Update { number: state.updates + 1, learning_rate: rate, scale };
    let decays: Vec<bool> = list.iter().map(decays).collect();
    let State { parameters, moments, average: means, updates, .. } = state;
    let values = parameters.values_mut().par_iter_mut().zip(moments).zip(gradients.par_iter().zip(decays));
    values.for_each(|((values, moments), (gradient, decays))| {
        config.optimiser.step(update, values, gradient, moments, decays);
    });
    if let (Some(means), Some(decay)) = (means, config.average) {
        let kept = kept(decay, *updates);
        means.par_iter_mut().zip(parameters.values()).for_each(|(mean, values)| average(mean, values, kept));
    }
    *updates += 1;
    Ok(length)
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

    /// A few layers that PyTorch trained (`oracle/make_update.py`): every step as it gave the gradients of each sample alone,
    /// and the parameters after `loss.mean().backward()`, `clip_grad_norm_` and `AdamW`, whose decay is for matrices.
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
        lessons: Vec<IndexMap<String, Vec<f32>>>,
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
            ..TrainConfig::from_toml(CONFIG).unwrap()
        };
        (run, state, config)
    }

    const CONFIG: &str = r#"
        title = "as PyTorch"
        seed = 1
        steps = 8
        batch = 3
        model = { base = "nano" }

        [[data]]
        [data.source.rooms]
        scenes-of = "rooms"
        scenes = 1
        size = [32, 32]
        views = { context = [2, 2], targets = 1, gaps = { min = 1, max = 2 } }
    "#;

    fn lessons(step: &Step) -> Vec<Lesson> {
        let lesson = |gradients: &IndexMap<_, _>| Lesson { gradients: gradients.clone(), ..Lesson::default() };
        step.lessons.iter().map(lesson).collect()
    }

    #[test]
    fn updates_are_pytorchs() {
        let (run, mut state, config) = run();
        let clipped = run.steps.iter().filter(|step| step.norm > run.clip).count();
        assert!((3..=run.steps.len() - 3).contains(&clipped), "{clipped} of {} steps are clipped", run.steps.len());
        assert!(run.parameters.iter().any(|start| start.shape.len() == 1), "vectors");
        assert!(run.parameters.iter().any(|start| start.shape.len() == 3), "more than matrices");
        for (number, step) in run.steps.iter().enumerate() {
            let lessons = lessons(step);
            assert_eq!(lessons.len(), 3, "a batch");
            let length = update(&mut state, &lessons, step.rate, &config).unwrap();
            Tolerance::relative(1e-6).assert([length], [step.norm], "the mean gradient's length");
            for ((found, expected), start) in state.parameters.values().iter().zip(&step.after).zip(&run.parameters) {
                let found = found.iter().copied().map(f64::from);
                let what = format!("{} after step {number}", start.name);
                Tolerance::absolute(3e-7).assert(found, expected.iter().copied(), &what);
            }
            assert_eq!(state.updates, number as u64 + 1);
        }
    }

    #[test]
    fn a_length_that_is_no_number_changes_nothing() {
        let (run, mut state, config) = run();
        let mut broken = lessons(&run.steps[0]);
        broken[1].gradients[0][0] = f32::NAN;
        assert!(matches!(update(&mut state, &broken, 1e-2, &config), Err(FaultKind::Gradients(_))));
        assert_eq!(state.updates, 0);
        let starts: Vec<&[f32]> = run.parameters.iter().map(|start| start.values.as_slice()).collect();
        assert_eq!(state.parameters.values(), starts);
    }
}
