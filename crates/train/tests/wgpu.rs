//! A run on a graphics adapter against the same run on the CPU.
//!
//! Without an adapter these tests print a message and pass; with `ATSPLAT_REQUIRE_GPU=1` they fail.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use atsplat_model::network::Processor;
use atsplat_numeric::Tolerance;
use atsplat_tests::skip_without_graphics;
use atsplat_train::logs::StepRecord;
use atsplat_train::{Event, Limits, Start, TrainConfig, Trainer};

/// Losses of the first steps; later, selections and orders of equal depths may differ.
const LOSSES: Tolerance = Tolerance::relative(5e-3);
/// What four steps at a rate of at most 1e-3 may make of weights that differ in the last digits: Adam divides gradients by their
/// size, so a gradient around 0 moves a weight by as much as any other.
const WEIGHTS: Tolerance = Tolerance::absolute(8e-3);

const TINY: &str = r#"
title = "tiny"
seed = 3
steps = 4
batch = 4
micro-batch = 2
average = 0.9

[model]
base = "nano"

[model.changes]
resolution = [32, 32]
transformer = { dim = 32, head-dim = 16 }
coarse.layers = 1
fine.layers = 1
head.scale = { kind = "exp-clamped", shift = -2.0, max = 0.5 }

[[data]]
[data.source.rooms]
scenes-of = "rooms"
scenes = 2
size = [32, 32]
samples = 1
stride = 10
cache-mib = 4
views = { context = [2, 2], targets = 2, gaps = { min = 3, max = 4 } }

[losses]
distance-weight = 0.2
intermediate-targets = 1

[schedule]
learning-rate = 1e-3
warm-up-steps = 3

[checkpoints]
every = 2
keep = 2
"#;

/// A process has one adapter, whose launches are counted.
static ADAPTER: Mutex<()> = Mutex::new(());

fn train(folder: &Path, processor: Processor, start: &Start, limit: u64) -> (Trainer, Vec<StepRecord>) {
    let mut trainer = Trainer::on(processor, None, TrainConfig::from_toml(TINY).unwrap(), folder, start).unwrap();
    let mut records = Vec::new();
    let limits = Limits { steps: Some(limit), ..Limits::default() };
    trainer
        .run(limits, &mut |event| {
            if let Event::Step(record) = event {
                records.push((*record).clone());
            }
        })
        .unwrap();
    (trainer, records)
}

fn weights(trainer: &Trainer) -> (Vec<f32>, Vec<f32>) {
    let state = trainer.current_state();
    (state.parameters.values().concat(), state.average.as_ref().unwrap().concat())
}

/// Every term, the norm and the weights; a run that was stopped and resumed ends as one that was not.
#[test]
fn steps_on_an_adapter_are_those_of_the_cpu_and_resume() {
    if let Err(error) = Processor::Wgpu(None).open() {
        return skip_without_graphics("train wgpu", error);
    }
    let _alone = ADAPTER.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (cpu, of_cpu) = train(&at("cpu"), Processor::Cpu, &Start::Fresh, 4);
    let (card, of_card) = train(&at("card"), Processor::Wgpu(None), &Start::Fresh, 4);
    assert_eq!((of_cpu.len(), of_card.len()), (4, 4));
    for (record, expected) in of_card.iter().zip(&of_cpu) {
        assert_eq!((&record.skip_reason, &expected.skip_reason), (&None, &None));
        let norms = [record, expected].map(|record| record.gradient_norm.unwrap());
        Tolerance::relative(2e-2).assert([norms[0]], [norms[1]], "norm");
        let terms = [record, expected].map(|record| record.terms.unwrap());
        for ((name, found), (_, expected)) in terms[0].named().into_iter().zip(terms[1].named()) {
            // Exact distances have faded out after 60 % of the run.
            assert!(expected > 0.0 || (name == "distance" && record.step > 2), "{name}");
            LOSSES.assert([found], [expected], name);
        }
    }
    let numbers = |values: Vec<f32>| values.into_iter().map(f64::from).collect::<Vec<f64>>();
    let (found, expected) = (weights(&card), weights(&cpu));
    WEIGHTS.assert(numbers(found.0.clone()), numbers(expected.0.clone()), "weights");
    WEIGHTS.assert(numbers(found.1), numbers(expected.1), "averages");
    let fresh =
        Trainer::on(Processor::Cpu, None, TrainConfig::from_toml(TINY).unwrap(), &at("fresh"), &Start::Fresh).unwrap();
    let mut moved = fresh.state().parameters.values().concat().into_iter().zip(&found.0).map(|(a, b)| (a - b).abs());
    assert!(moved.any(|by| by > 1e-3), "weights move");

    train(&at("resumed"), Processor::Wgpu(None), &Start::Fresh, 2);
    let (resumed, rest) = train(&at("resumed"), Processor::Wgpu(None), &Start::Resume, 4);
    assert_eq!(rest.len(), 2);
    assert_eq!(weights(&resumed), weights(&card), "to the bit");
}

/// A step renders its samples at once: with four times as many, levels of sums and passes of sorts are all that is launched more often.
#[test]
fn launches_of_a_step_on_an_adapter_do_not_grow_with_the_batch() {
    let processor = Processor::Wgpu(None);
    if let Err(error) = processor.open() {
        return skip_without_graphics("train wgpu", error);
    }
    let _alone = ADAPTER.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let mut launches = |batch: usize| {
        let mut config = TrainConfig::from_toml(TINY).unwrap();
        config.batch = NonZeroUsize::new(batch).unwrap();
        config.micro_batch = config.batch;
        let at = folder.path().join(batch.to_string());
        let mut trainer = Trainer::on(processor, None, config, &at, &Start::Fresh).unwrap();
        // Lists of tiles have learnt their lengths.
        trainer.run(Limits { steps: Some(2), ..Limits::default() }, &mut |_| ()).unwrap();
        let before = processor.rendering_counts().unwrap();
        trainer.run(Limits { steps: Some(3), ..Limits::default() }, &mut |_| ()).unwrap();
        processor.rendering_counts().unwrap() - before
    };
    let [two, four, eight] = [2, 4, 8].map(&mut launches);
    // Three sets of Gaussians, forward and backward.
    assert!(two.dispatches > 6 * 30, "{two:?}");
    assert_eq!((two.submissions, two.waits), (four.submissions, four.waits), "{two:?} {four:?}");
    assert_eq!(two.submissions, eight.submissions, "{two:?} {eight:?}");
    assert!(eight.dispatches < two.dispatches + two.dispatches / 2, "{two:?} {eight:?}");
    assert!(four.dispatches <= eight.dispatches, "{four:?} {eight:?}");
}
