use std::path::Path;

use anyhow::Context as _;
use atsplat_drift::probe::{Outputs, Pipeline, attribute};
use atsplat_drift::{Baseline, DriftReport, DriftVerdict, compare};
use atsplat_results::Results;

use super::{Args, github, recipe};
use crate::exit::Exit;
use crate::print::{print_report, warn};
use crate::provenance;

pub(super) fn run(args: &Args, store: &Path, baseline_path: &Path) -> anyhow::Result<Exit> {
    let (file, of) = (baseline_path.display(), store.display());
    anyhow::ensure!(
        baseline_path.exists(),
        "--baseline: expected a baseline, found no file; `atsplat drift accept {of} --baseline {file} --why REASON` makes one"
    );
    anyhow::ensure!(
        !baseline_path.is_dir(),
        "--baseline: expected a file, found the folder {file}; the folder of results is the argument without an option"
    );
    let baseline = Baseline::read(baseline_path)?;
    let probe = Probe::read(args, &baseline, baseline_path)?;
    let plot = args.history.open()?;
    let results = Results::read(&args.cache.store(store)?)?;
    let report = compare(&results, &baseline);
    let report = match probe {
        None => report,
        Some(probe) => probe.run(report, &baseline)?,
    };
    print_report(&report, args.json)?;
    if args.github {
        github::tell(&report, baseline_path);
    }
    let drawn = plot.map_or(Ok(()), |plot| args.history.draw(plot, &baseline, &report));
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

/// The baseline's probe, with the stages of its recipe or of another one.
struct Probe<'a> {
    stages: Pipeline,
    outputs: Outputs,
    /// The file of the recipe, if it is not the baseline's.
    requested: Option<&'a Path>,
}

impl<'a> Probe<'a> {
    /// The probe of a baseline, if it has one and it is to be run. A recipe whose stages cannot be made is an error, and no drift.
    fn read(args: &'a Args, baseline: &Baseline, path: &Path) -> anyhow::Result<Option<Self>> {
        let requested = args.probe.as_deref();
        let given = requested.map(recipe).transpose()?;
        let of_baseline =
            || "the baseline's probe, a file to be committed with it (--no-probe compares rows alone)".to_owned();
        let recorded = if args.no_probe { None } else { baseline.read_probe(path).with_context(of_baseline)? };
        let Some((recorded, outputs)) = recorded else {
            anyhow::ensure!(given.is_none(), "--probe: the baseline has no probe; accept one first");
            return Ok(None);
        };
        let stages = Pipeline::of(&given.unwrap_or(recorded)).with_context(|| origin(requested))?;
        Ok(Some(Self { stages, outputs, requested }))
    }

    /// Runs the stages on this machine, regardless of the machine of the results.
    fn run(&self, report: DriftReport, baseline: &Baseline) -> anyhow::Result<DriftReport> {
        let Self { stages, outputs, requested } = self;
        let same = baseline.was_probed_on(&provenance());
        if requested.is_none() {
            return Ok(report.with_probe(stages, outputs, same));
        }
        // Nobody knows whether these stages ran when the baseline was accepted: a failure is no drift.
        let attribution = attribute(stages, outputs, same).with_context(|| origin(*requested))?;
        Ok(report.with_attribution(attribution))
    }
}

/// Where a recipe is from.
fn origin(requested: Option<&Path>) -> String {
    let of_baseline = || "the baseline's probe (--no-probe compares rows alone)".to_owned();
    requested.map_or_else(of_baseline, |path| format!("--probe {}", path.display()))
}
