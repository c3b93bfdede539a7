//! `atsplat train`: a configuration into weights.

mod curves;
mod report;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use atsplat_pixels::encode_png;
use atsplat_train::{Limits, Start, TrainConfig, Trainer, contact_sheet, journal};
use clap::Args;

use crate::output::{PendingFile, print_text};
use report::Live;

/// Rows of the contact sheet, and pairs of a render and its truth in each.
const SHEET: (usize, usize) = (8, 3);

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// The run's configuration: data, losses, schedule, sizes, seeds.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,

    /// Folder of the run: checkpoints, weights, logs, learning curve, contact sheet.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// Go on where the run in DIR was stopped or killed.
    #[arg(long)]
    resume: bool,

    /// Begin with the weights in this file.
    #[arg(long, value_name = "WEIGHTS", conflicts_with = "resume")]
    init: Option<PathBuf>,

    /// Stop after so many steps in all; the schedule is the configuration's.
    #[arg(long, value_name = "N")]
    steps: Option<u64>,

    /// Stop after so many hours of this call.
    #[arg(long, value_name = "H", value_parser = hours)]
    hours: Option<Duration>,
}

fn hours(text: &str) -> Result<Duration, String> {
    let expected = || format!("expected a positive number of hours, found {text:?}");
    let hours: f64 = text.parse().map_err(|_not_a_number: std::num::ParseFloatError| expected())?;
    Duration::try_from_secs_f64(hours * 3600.0).ok().filter(|time| !time.is_zero()).ok_or_else(expected)
}

/// Trains; gives whether the last step of the configuration was done.
pub(crate) fn run(words: &Words) -> anyhow::Result<()> {
    let config = TrainConfig::read(&words.config)?;
    let start = match (&words.init, words.resume) {
        (Some(weights), _) => Start::Weights(weights.clone()),
        (None, true) => Start::Resume,
        (None, false) => Start::Fresh,
    };
    if !words.resume {
        std::fs::create_dir_all(&words.out).with_context(|| format!("making the folder {}", words.out.display()))?;
    }
    let steps = config.steps.get();
    let mut trainer = Trainer::new(config, &words.out, &start)?;
    let mut live = Live::new(words.steps.map_or(steps, |most| most.min(steps)), trainer.state().step);
    let outcome = trainer.run(Limits { steps: words.steps, time: words.hours }, &mut |event| live.hear(event));
    drop(live);
    // What was learnt until then is worth a look even where the run was stopped.
    let drawn = draw(words, &trainer);
    let whole = outcome?;
    drawn?;
    let done = trainer.state().step;
    let end = if whole { "" } else { "; `--resume` goes on" };
    print_text(&format!("{done} of {steps} steps, {} skipped{end}\n", trainer.state().skipped()))
}

/// Logs as Parquet, the learning curve, the contact sheet.
fn draw(words: &Words, trainer: &Trainer) -> anyhow::Result<()> {
    let steps: Vec<journal::StepRecord> = journal::read(&words.out.join("steps.jsonl"))?;
    let evaluations: Vec<journal::EvaluationRecord> = journal::read(&words.out.join("evaluations.jsonl"))?;
    journal::write_steps(&words.out.join("steps.parquet"), &steps)?;
    journal::write_evaluations(&words.out.join("evaluations.parquet"), &evaluations)?;
    let plot = curves::draw(&trainer.config().title, &steps, &evaluations)?;
    PendingFile::open(&words.out.join("learning-curve.png"))?.finish(&plot)?;
    if let Some(evaluation) = trainer.evaluation() {
        let sheet = contact_sheet(evaluation, &trainer.network()?, SHEET.0, SHEET.1)?;
        PendingFile::open(&words.out.join("contact-sheet.png"))?.finish(&encode_png(&sheet)?)?;
    }
    Ok(())
}
