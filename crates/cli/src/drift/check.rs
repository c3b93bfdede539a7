use std::path::Path;

use atsplat_eval::Results;
use atsplat_eval::drift::probe::{Outputs, Pipeline, Recipe, attribute};
use atsplat_eval::drift::{Baseline, DriftReport, Verdict, compare, same_machine};

use super::{Words, recipe};
use crate::exit::Exit;
use crate::machine::here;
use crate::output::print_report;

pub(super) fn run(words: &Words, store: &Path, baseline_path: &Path) -> anyhow::Result<Exit> {
    let asked = words.probe.as_deref().map(recipe).transpose()?;
    let baseline = Baseline::read(baseline_path)?;
    let probe = if words.no_probe { None } else { baseline.read_probe(baseline_path)? };
    anyhow::ensure!(asked.is_none() || probe.is_some(), "--probe: the baseline has none; accept one first");
    let results = Results::read(store)?;
    let report = compare(&results, &baseline);
    let report = match probe {
        None => report,
        Some((recipe, outputs)) => with_probe(report, &baseline, &asked.unwrap_or(recipe), &outputs),
    };
    words.history.draw(&baseline, &results, &report)?;
    print_report(&report, words.json)?;
    Ok(match report.verdict {
        Verdict::Same | Verdict::Within => Exit::Done,
        Verdict::Nothing => Exit::Failed,
        Verdict::Drifted => Exit::Drifted,
    })
}

/// Stages run here and now, whatever machine the results are from.
fn with_probe(report: DriftReport, baseline: &Baseline, recipe: &Recipe, outputs: &Outputs) -> DriftReport {
    let same = same_machine(&baseline.provenance, &here());
    report.with_attribution(Pipeline::of(recipe).and_then(|stages| attribute(&stages, outputs, same)))
}
