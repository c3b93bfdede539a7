//! `atsplat train`: trains a network from a configuration.

mod freed_memory;
mod report;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::bail;
use atsplat_numeric::{counted, noun};
use atsplat_report::plot::{ContactRow, ContactSheet, LearningCurve, PlotFormat};
use atsplat_results::store::PROVENANCE;
use atsplat_train::{Limits, SheetRow, Start, Terms, TrainConfig, Trainer, WEIGHTS, contact_sheet, logs};

use crate::COMMIT;
use crate::device::DeviceArgs;
use crate::embedded;
use crate::paths::PendingFile;
use crate::print::{note, print_text};
use report::Live;

/// What `--init` expects.
const INITIAL: &str = "a weights file of this toolkit, which `atsplat weights import` makes from a PyTorch checkpoint";
/// Rows of the contact sheet, and targets of each.
const SHEET: (usize, usize) = (8, 3);

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The run's configuration: data, losses, schedule, sizes, seeds.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,

    /// Folder of the run: checkpoints, weights (as f16), logs, learning curve, contact sheet.
    #[arg(long, short, value_name = "DIR")]
    out: PathBuf,

    /// Resume the run in DIR, on the device where it began.
    #[arg(long)]
    resume: bool,

    /// Start with the weights in this file, or with embedded ones by their name.
    #[arg(long, value_name = "WEIGHTS", conflicts_with = "resume")]
    init: Option<PathBuf>,

    /// Stop at this step; the schedule stays that of the configuration.
    #[arg(long, value_name = "N")]
    steps: Option<u64>,

    #[command(flatten)]
    device: DeviceArgs,

    /// Stop after this many hours.
    #[arg(long, value_name = "H", value_parser = hours)]
    hours: Option<Duration>,
}

fn hours(text: &str) -> Result<Duration, String> {
    let expected = || format!("expected a positive number of hours, found {text:?}");
    let hours: f64 = text.parse().map_err(|_not_a_number: std::num::ParseFloatError| expected())?;
    Duration::try_from_secs_f64(hours * 3600.0).ok().filter(|time| !time.is_zero()).ok_or_else(expected)
}

/// Trains until the last step or a limit.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    freed_memory::keep();
    args.device.check_networks()?;
    let config = TrainConfig::read(&args.config)?;
    let start = match (&args.init, args.resume) {
        (Some(weights), _) => Start::Weights(embedded::find(weights, || INITIAL.to_owned())?),
        (None, true) => Start::Resume,
        (None, false) => Start::Fresh,
    };
    if !args.resume && args.out.join(PROVENANCE).exists() {
        bail!("--out {}: expected a folder for this run only, found results of evaluations", args.out.display());
    }
    let steps = config.steps.get();
    let trainer = Trainer::on(args.device.processor, COMMIT, config, &args.out, &start);
    let mut trainer = trainer.map_err(|error| error.in_configuration(&args.config))?;
    let last = args.steps.map_or(steps, |most| most.min(steps));
    if let Some(most) = args.steps.filter(|most| *most > steps) {
        note(&format!("--steps {most} has no effect: the configuration ends at step {steps}"));
    }
    let held_out = trainer.config().is_evaluation_held_out(trainer.state().initial_weights.as_ref());
    let mut live = Live::new(last, trainer.state().step, held_out);
    let outcome = trainer.run(Limits { steps: args.steps, time: args.hours }, &mut |event| live.show(event));
    drop(live);
    // Logs and plots are written even if the run failed.
    let logged = write_logs(args, &trainer);
    let complete = outcome?;
    logged?;
    let done = trainer.state().step;
    let end = if complete { "" } else { "; `--resume` continues" };
    let weights = args.out.join(WEIGHTS);
    print_text(&format!("{done} of {steps} steps, {} skipped{end}\n{}\n", trainer.state().skipped(), weights.display()))
}

/// The steps that a learning curve shows, and the number of samples whose PSNR it shows, if any.
fn described(steps: &[logs::StepRecord], evaluated: Option<usize>) -> String {
    let skipped = match steps.iter().filter(|record| record.skip_reason.is_some()).count() {
        0 => String::new(),
        count => format!(", {count} of them skipped"),
    };
    let psnr =
        evaluated.map_or_else(String::new, |samples| format!("; PSNR of {}", counted(samples as u64, "fixed sample")));
    format!("{}{skipped}{psnr}", counted(steps.len() as u64, "step"))
}

/// The label of a sample in the contact sheet: its number and score, and the targets that the score leaves out, by their numbers if they are
/// shown.
fn label(number: usize, row: &SheetRow) -> String {
    let score = row.psnr.map_or_else(|| "no score".to_owned(), |psnr| format!("{psnr:.2} dB"));
    let is_shown = |target: &usize| *target <= row.targets.len();
    let (shown, others): (Vec<usize>, Vec<usize>) = row.left_out.iter().copied().partition(is_shown);
    let names = shown.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    let shown = (!shown.is_empty()).then(|| format!("{} {names}", noun(shown.len() as u64, "target")));
    let others = (!others.is_empty()).then(|| format!("{} not shown", counted(others.len() as u64, "target")));
    let left_out: Vec<String> = shown.into_iter().chain(others).collect();
    if left_out.is_empty() {
        return format!("sample {number}, {score}");
    }
    format!("sample {number}, {score} without {}, equal to a context view or render", left_out.join(" and "))
}

/// Writes the logs as Parquet, the learning curve, and the contact sheet.
fn write_logs(args: &Args, trainer: &Trainer) -> anyhow::Result<()> {
    let steps: Vec<logs::StepRecord> = logs::read(&args.out.join("steps.jsonl"))?;
    let evaluations: Vec<logs::EvaluationRecord> = logs::read(&args.out.join("evaluations.jsonl"))?;
    logs::write_steps(&args.out.join("steps.parquet"), &steps)?;
    logs::write_evaluations(&args.out.join("evaluations.parquet"), &evaluations)?;
    let terms = Terms::default().named().map(|(name, _)| name);
    let values = |term: usize| steps.iter().map(move |record| Some(record.terms?.named().get(term)?.1));
    let losses: Vec<_> = terms.into_iter().enumerate().map(|(term, name)| (name, values(term).collect())).collect();
    let name = args.config.file_stem().unwrap_or(args.config.as_os_str()).to_string_lossy();
    let evaluated = trainer.evaluation().map(|evaluation| evaluation.samples().len());
    let curve = LearningCurve {
        title: &trainer.config().title,
        subtitle: &format!("{name}; {}", described(&steps, evaluated)),
        steps: &steps.iter().map(|record| record.step).collect::<Vec<_>>(),
        losses: &losses,
        evaluations: &evaluations
            .iter()
            .map(|record| (record.step, record.psnr, Some(record.nearest_view_psnr)))
            .collect::<Vec<_>>(),
    };
    PendingFile::open(&args.out.join("learning-curve.png"))?.finish(&curve.draw().encode(PlotFormat::Png)?)?;
    if let Some(evaluation) = trainer.evaluation() {
        let rows = contact_sheet(evaluation, &trainer.network()?, SHEET.0, SHEET.1)?;
        let row = |(at, row): (usize, SheetRow)| ContactRow {
            label: label(at + 1, &row),
            context: row.context,
            targets: row.targets,
        };
        let sheet = ContactSheet {
            title: format!("{}: fixed samples", trainer.config().title),
            subtitle: format!(
                "{name}; {} of {} samples after {} steps",
                rows.len(),
                evaluation.samples().len(),
                trainer.state().step
            ),
            rows: rows.into_iter().enumerate().map(row).collect(),
        };
        PendingFile::open(&args.out.join("contact-sheet.png"))?.finish(&sheet.draw().encode(PlotFormat::Png)?)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use atsplat_pixels::ImageU8;

    use super::*;

    #[test]
    fn a_label_says_which_targets_the_score_leaves_out() {
        let image = || ImageU8::new(1, 1, vec![7; 3]).unwrap();
        let targets = vec![[image(), image()], [image(), image()]];
        let labelled = |psnr, left_out: &[usize]| {
            label(3, &SheetRow { context: Vec::new(), targets: targets.clone(), psnr, left_out: left_out.to_vec() })
        };
        assert_eq!(labelled(Some(21.346), &[]), "sample 3, 21.35 dB");
        let of_one = "sample 3, 21.35 dB without target 2, equal to a context view or render";
        assert_eq!(labelled(Some(21.346), &[2]), of_one);
        let of_none = "sample 3, no score without targets 1, 2, equal to a context view or render";
        assert_eq!(labelled(None, &[1, 2]), of_none);
        let of_others = "sample 3, 9.00 dB without target 2 and 3 targets not shown, equal to a context view or render";
        assert_eq!(labelled(Some(9.0), &[2, 3, 5, 6]), of_others);
        let of_another = "sample 3, 9.00 dB without 1 target not shown, equal to a context view or render";
        assert_eq!(labelled(Some(9.0), &[4]), of_another);
    }

    #[test]
    fn a_learning_curve_says_how_many_steps_were_skipped() {
        let step = |fault: &str| -> logs::StepRecord {
            let parts = r#"{"sample":1.0,"forward":1.0,"splat":1.0,"losses":1.0,"backward":1.0}"#;
            let text = format!(
                r#"{{"step":0,"terms":null,"gradient-norm":null,"rate":1e-3,"secs":5.0,"parts":{parts},"fault":{fault}}}"#
            );
            serde_json::from_str(&text).unwrap()
        };
        let [done, skipped] = ["null", "\"no sample\""].map(step);
        assert_eq!(described(&[done.clone(), done.clone()], None), "2 steps");
        let some = [done.clone(), skipped, done];
        assert_eq!(described(&some, Some(4)), "3 steps, 1 of them skipped; PSNR of 4 fixed samples");
    }
}
