//! A step of the trainer is `AdamW` on the clipped mean of its samples' gradients, at the schedule's rate. The update itself
//! is compared with PyTorch's in `src/update.rs`.

use crate::common::{Noise, SIZE, config, sample, trainer};
use atsplat_model::network::{Device, Network};
use atsplat_numeric::Tolerance;
use atsplat_train::logs::{self, StepRecord};
use atsplat_train::{Event, GroupGradients, GroupInput, Limits, Objective, Parameters, Start, TrainConfig};
use tempfile::tempdir;

/// The gradients of a step's samples, through the public interface.
fn batch(config: &TrainConfig, parameters: &Parameters, step: u64) -> Vec<GroupGradients> {
    let model = config.model.config().unwrap();
    let network = parameters.network(&Network::new(&model, &Device::flex().autodiff()).unwrap()).unwrap();
    let objective = Objective::new(config.losses.clone()).unwrap();
    let size = config.batch.get() as u64;
    let numbers = step * size..(step + 1) * size;
    let gradients = |call_seed| {
        let samples = [sample(call_seed)];
        objective.gradients(&network, &GroupInput { call_seed, ..GroupInput::new(&samples) }).unwrap()
    };
    numbers.map(gradients).collect()
}

/// Every weight follows the formulas of Kingma and Ba (2015) and of Loshchilov and Hutter (2019), in f64.
#[test]
fn a_step_updates_every_weight_by_the_clipped_mean_gradient() {
    let config = TrainConfig { clip: 0.05, batch: 3.try_into().unwrap(), ..config("") };
    let folder = tempdir().unwrap();
    let mut trained = trainer(config.clone(), folder.path(), &Start::Fresh, Noise::CLEAN);
    let count = trained.state().parameters.count();
    let (mut first, mut second) = (vec![0.0; count], vec![0.0; count]);
    for (at_step, step) in (0..4u64).enumerate() {
        let before = trained.state().parameters.clone();
        let batch = batch(&config, &before, step);
        trained.step(&mut |_| ()).unwrap();
        let mean = |name: &str, at: usize| {
            let parts = batch.iter().filter_map(|sample| sample.gradients.get(name));
            f64::from(parts.map(|part| part[at]).sum::<f32>()) / batch.len() as f64
        };
        let numbers = || {
            let list = before.list().iter().zip(before.values());
            list.flat_map(|(parameter, values)| {
                values.iter().enumerate().map(move |(at, value)| (parameter, at, *value))
            })
        };
        let length = numbers().map(|(parameter, at, _)| mean(&parameter.name, at).powi(2)).sum::<f64>().sqrt();
        assert!(length > 2.0 * config.clip, "step {step} is clipped: {length}");
        let records: Vec<StepRecord> = logs::read(&folder.path().join("steps.jsonl")).unwrap();
        Tolerance::relative(1e-5).assert(records[at_step].gradient_norm, [length], "norm of the mean gradient");
        for (at, (name, found)) in records[at_step].terms.unwrap().named().into_iter().enumerate() {
            let sum: f64 = batch.iter().map(|sample| sample.terms[0].named()[at].1).sum();
            Tolerance::relative(1e-6).assert([found], [sum / batch.len() as f64], name);
        }
        // Warm-up over three steps.
        let rate = 1e-3 * [1.0 / 3.0, 2.0 / 3.0, 1.0, 1.0][at_step];
        Tolerance::relative(1e-12).assert([records[at_step].rate], [rate], "rate");
        let after: Vec<f64> = trained.state().parameters.values().iter().flatten().copied().map(f64::from).collect();
        for (place, (parameter, at, value)) in numbers().enumerate() {
            let gradient = mean(&parameter.name, at) * config.clip / (length + 1e-6);
            first[place] = 0.9 * first[place] + 0.1 * gradient;
            second[place] = 0.95 * second[place] + 0.05 * gradient * gradient;
            let done = i32::try_from(step).unwrap() + 1;
            let [mean, square] = [first[place] / (1.0 - 0.9f64.powi(done)), second[place] / (1.0 - 0.95f64.powi(done))];
            let kept = if parameter.shape.len() > 1 { 1.0 - rate * 0.05 } else { 1.0 };
            let expected = f64::from(value) * kept - rate * mean / (square.sqrt() + 1e-8);
            let close = Tolerance { absolute: 1e-6, relative: 1e-6 };
            assert!(
                close.accepts(after[place], expected),
                "step {step}, {} at {at}: {} for {expected}",
                parameter.name,
                after[place]
            );
        }
    }
}

/// Every second sample has one context image less, so that no two of a micro-batch's three samples form one batch; without that,
/// two do, and the third is alone.
#[test]
fn a_step_sees_the_same_samples_at_any_size_of_the_micro_batch() {
    let mixed = Noise {
        corrupt: |number, sample| {
            if number % 2 == 1 {
                sample.context.cameras.pop();
                sample.context.images.truncate(sample.context.cameras.len() * SIZE.height * SIZE.width * 3);
            }
        },
    };
    for source in [Noise::CLEAN, mixed] {
        let first = [1, 2, 3, 8].map(|micro_batch| {
            let config = TrainConfig {
                batch: 3.try_into().unwrap(),
                micro_batch: micro_batch.try_into().unwrap(),
                ..config("")
            };
            let folder = tempdir().unwrap();
            trainer(config, folder.path(), &Start::Fresh, source).step(&mut |_| ()).unwrap();
            logs::read::<StepRecord>(&folder.path().join("steps.jsonl")).unwrap().remove(0)
        });
        for record in &first[1..] {
            assert_eq!((record.terms, &record.skip_reason), (first[0].terms, &None));
            Tolerance::relative(1e-5).assert(record.gradient_norm, first[0].gradient_norm, "norm of the mean gradient");
        }
    }
}

/// Gaussians without opacity are not drawn, so that no loss depends on them.
#[test]
fn steps_that_train_nothing_are_reported() {
    let notices = |shift: &str| {
        let mut config = config("");
        let opacity = toml::Value::Table(format!("kind = 'sigmoid'\nshift = {shift}").parse().unwrap());
        let head = config.model.changes.get_mut("head").and_then(toml::Value::as_table_mut).unwrap();
        head.insert("opacity".to_owned(), opacity);
        let (folder, mut notices) = (tempdir().unwrap(), Vec::new());
        let mut on_event = |event: &Event<'_>| {
            if let Event::Notice(text) = event
                && text.contains("trained nothing")
            {
                notices.push((*text).to_owned());
            }
        };
        let mut trainer = trainer(config, folder.path(), &Start::Fresh, Noise::CLEAN);
        trainer.run(Limits { steps: Some(3), time: None }, &mut on_event).unwrap();
        notices
    };
    assert_eq!(notices("0.0"), [""; 0]);
    let first = "step 0 trained nothing: its gradient is 0, as where no target shows a Gaussian";
    assert_eq!(notices("-100.0"), [first, "3 steps trained nothing, as their gradients are 0"]);
}
