//! `atsplat stress`: runs every hard case on every renderer and tabulates the errors.

use std::fmt;

use atsplat_report::plot::{StressError, StressErrors};
use atsplat_splat::gpu::AdapterChoice;
use atsplat_splat::hard_cases::{HardCase, catalogue};
use atsplat_splat::stress::{self, RendererUnderTest, StressReport, StressRow};
use serde::Serialize;

use crate::adapter_self_test::AdapterSelfTests;
use crate::parse::{once, usage_error};
use crate::plot::PlotFile;
use crate::print::{print_report, warn};
use crate::progress::Progress;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Name of a hard case; may be given several times; all by default.
    #[arg(long, value_name = "NAME", value_parser = case_name)]
    case: Vec<String>,

    /// Renderer by its name or a part of it, such as `reference`, `cpu` or `avx2`; may be given several times; by
    /// default all that this machine supports.
    #[arg(long, value_name = "NAME")]
    renderer: Vec<String>,

    /// List the cases and their descriptions without running them.
    #[arg(long, conflicts_with_all = ["renderer", "plot"])]
    list: bool,

    /// Plot the errors by case, .svg or .png.
    #[arg(long, value_name = "IMAGE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON; an error with a null bound must only be finite.
    #[arg(long)]
    json: bool,
}

/// Runs the cases; `true` if all passed.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    for (option, values) in [("--case", &args.case), ("--renderer", &args.renderer)] {
        once(option, values).map_err(usage_error)?;
    }
    if args.list {
        print_report(&CaseList::of(&args.case), args.json)?;
        return Ok(true);
    }
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let report = StressReport::of(run_cases(&args.case, &args.renderer)?);
    if let Some(plot) = plot {
        let errors = plotted_errors(&report.rows);
        plot.finish(|format| StressErrors { errors: &errors }.draw().encode(format))?;
    }
    print_report(&report, args.json)?;
    Ok(report.failed == 0)
}

fn plotted_errors(rows: &[StressRow]) -> Vec<StressError<'_>> {
    let errors = rows.iter().flat_map(|row| row.errors.iter().map(move |error| (row, error)));
    let plotted = errors.map(|(row, error)| StressError {
        case: &row.case,
        renderer: &row.renderer,
        // Without compared values there is no error to show, but the case keeps its row.
        kind: if error.compared > 0 { error.kind.name() } else { "" },
        relative: error.relative,
        bound: error.bound,
        passes: error.passes(),
    });
    plotted.collect()
}

/// Parses `--case`.
fn case_name(name: &str) -> Result<String, String> {
    if catalogue().iter().any(|case| case.name == name) {
        Ok(name.to_owned())
    } else {
        Err("no hard case has this name; `atsplat stress --list` lists all".to_owned())
    }
}

/// Runs the selected cases and renderers, or all if none is selected.
fn run_cases(cases: &[String], names: &[String]) -> anyhow::Result<Vec<StressRow>> {
    let mut renderers = stress::cpu_under_test();
    let exists = |renderers: &[RendererUnderTest], name: &str| {
        renderers.iter().any(|tested| tested.renderer.name().contains(name))
    };
    if names.is_empty() || names.iter().any(|name| !exists(&renderers, name)) {
        let tests = AdapterSelfTests::new(false);
        let gpu = stress::gpu_under_test(&AdapterChoice::Automatic, &tests);
        tests.finish();
        match gpu {
            Ok(gpu) => renderers.push(gpu),
            Err(error) => warn(&format!("the GPU is not tested: {error}")),
        }
    }
    if let Some(name) = names.iter().find(|name| !exists(&renderers, name)) {
        let known: Vec<String> = renderers.iter().map(|tested| tested.renderer.name()).collect();
        return Err(usage_error(format!("--renderer {name}: this machine has {}", known.join("; "))).into());
    }
    renderers.retain(|tested| names.is_empty() || names.iter().any(|name| tested.renderer.name().contains(name)));
    let selected = selected(cases);
    let progress = Progress::new("hard cases", selected.len());
    let mut rows = Vec::with_capacity(selected.len() * renderers.len());
    for case in &selected {
        rows.extend(stress::rows(case, &mut renderers)?);
        progress.step();
    }
    Ok(rows)
}

/// The hard cases by name.
#[derive(Serialize)]
struct CaseList {
    cases: Vec<ListedCase>,
}

#[derive(Serialize)]
struct ListedCase {
    name: &'static str,
    description: &'static str,
}

impl CaseList {
    fn of(cases: &[String]) -> Self {
        let listed = |case: HardCase| ListedCase { name: case.name, description: case.description };
        Self { cases: selected(cases).into_iter().map(listed).collect() }
    }
}

impl fmt::Display for CaseList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.cases.iter().try_for_each(|case| writeln!(f, "{:<24} {}", case.name, case.description))
    }
}

fn selected(cases: &[String]) -> Vec<HardCase> {
    let mut all = catalogue();
    all.retain(|case| cases.is_empty() || cases.iter().any(|name| name == case.name));
    all
}
