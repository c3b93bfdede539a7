//! `atsplat stress`: runs every hard case on every renderer and tabulates the errors.

mod report;
mod splat;

use atsplat_report::plot::{StressError, StressErrors};
use atsplat_splat::stress::StressRow;

use crate::output::{print_report, print_text};
use crate::parse::{once, usage_error};
use crate::plot::PlotFile;
use report::Report;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Name of a hard case; may be given several times; all by default.
    #[arg(long, value_name = "NAME", value_parser = splat::case_name)]
    case: Vec<String>,

    /// Renderer path by its name or a part of it, as `reference`, `cpu` or `avx2`; may be given several times; by default all
    /// that this machine supports.
    #[arg(long, value_name = "NAME")]
    path: Vec<String>,

    /// List the cases and their descriptions without running them.
    #[arg(long, conflicts_with_all = ["path", "plot", "json"])]
    list: bool,

    /// Plot the errors by case, .svg or .png.
    #[arg(long, value_name = "PICTURE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON; an error with a null bound must only be finite.
    #[arg(long)]
    json: bool,
}

/// Runs the cases; `true` if all passed.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    for (option, values) in [("--case", &args.case), ("--path", &args.path)] {
        once(option, values).map_err(usage_error)?;
    }
    if args.list {
        print_text(&splat::list(&args.case))?;
        return Ok(true);
    }
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let report = Report::of(splat::rows(&args.case, &args.path)?);
    if let Some(plot) = plot {
        let errors = plotted_errors(&report.rows);
        plot.finish(|format| StressErrors { errors: &errors }.encode(format))?;
    }
    print_report(&report, args.json)?;
    Ok(report.failed == 0)
}

fn plotted_errors(rows: &[StressRow]) -> Vec<StressError<'_>> {
    let errors = rows.iter().flat_map(|row| row.errors.iter().map(move |error| (row, error)));
    let plotted = errors.map(|(row, error)| StressError {
        case: &row.case,
        path: &row.path,
        // Without compared values there is no error to show, but the case keeps its row.
        kind: if error.compared > 0 { error.name } else { "" },
        relative: error.relative,
        bound: error.bound,
        passes: error.passes(),
    });
    plotted.collect()
}
