use std::path::Path;

use atsplat_drift::probe::{Outputs, Pipeline, Recipe, attribute};
use atsplat_drift::{Baseline, DriftReport, DriftVerdict, compare};
use atsplat_results::Results;

use super::{Args, github, recipe};
use crate::exit::Exit;
use crate::print::{print_report, warn};
use crate::provenance;

pub(super) fn run(args: &Args, store: &Path, baseline_path: &Path) -> anyhow::Result<Exit> {
    let requested = args.probe.as_deref().map(recipe).transpose()?;
    let (file, of) = (baseline_path.display(), store.display());
    anyhow::ensure!(
        baseline_path.exists(),
        "--baseline: expected a baseline, found no file; `atsplat drift accept {of} --baseline {file} --why REASON` makes one"
    );
    let baseline = Baseline::read(baseline_path)?;
    let probe = if args.no_probe { None } else { baseline.read_probe(baseline_path)? };
    anyhow::ensure!(requested.is_none() || probe.is_some(), "--probe: the baseline has no probe; accept one first");
    let plot = args.history.open()?;
    let results = Results::read(&args.cache.store(store)?)?;
    let report = compare(&results, &baseline);
    let report = match probe {
        None => report,
        Some((recipe, outputs)) => with_probe(report, &baseline, &requested.unwrap_or(recipe), &outputs),
    };
    print_report(&report, args.json)?;
    if args.github {
        github::tell(&report, baseline_path);
    }
    let drawn = plot.map_or(Ok(()), |plot| args.history.draw(plot, &baseline, &results, &report));
    let exit = match report.verdict {
        DriftVerdict::Same | DriftVerdict::Within => Exit::Done,
        DriftVerdict::Nothing => Exit::Failed,
        DriftVerdict::Drifted => Exit::Drifted,
    };
    match drawn {
        // What drifted is worse than a plot that is missing.
        Err(error) if exit == Exit::Drifted => warn(&format!("{error:#}")),
        drawn => drawn?,
    }
    Ok(exit)
}

/// Runs the stages on this machine, regardless of the machine of the results.
fn with_probe(report: DriftReport, baseline: &Baseline, recipe: &Recipe, outputs: &Outputs) -> DriftReport {
    let same = baseline.was_probed_on(&provenance());
    report.with_attribution(Pipeline::of(recipe).and_then(|stages| attribute(&stages, outputs, same)))
}
