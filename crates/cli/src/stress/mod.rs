//! Every hard case through every path, as a table: what breaks, and by how much.

mod report;
mod splat;

use clap::error::ErrorKind;
use clap::{Args, Command};

use crate::output::{PendingFile, print_report, print_text};
use crate::plot::{PlotFile, StressErrors, draw_stress_errors};
use crate::words::once;
use report::Report;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Hard case, by name; may be given several times. Without it, all.
    #[arg(long, value_name = "NAME", value_parser = splat::case_name)]
    case: Vec<String>,

    /// Path by its name or a part of it, as `reference`, `cpu` or `avx2`; may be given several times. Without it, all
    /// that this machine has.
    #[arg(long, value_name = "NAME")]
    path: Vec<String>,

    /// Tell the cases' names and what is hard about them, and run none.
    #[arg(long, conflicts_with_all = ["path", "plot", "json"])]
    list: bool,

    /// Errors by case, .svg or .png.
    #[arg(long, value_name = "PICTURE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON; an error whose bound is null has none, and has to be finite.
    #[arg(long)]
    json: bool,
}

/// Whether everything passed.
pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    for (word, list) in [("--case", &words.case), ("--path", &words.path)] {
        once(word, list).map_err(|text| Command::new("atsplat").error(ErrorKind::ValueValidation, text))?;
    }
    if words.list {
        print_text(&splat::list(&words.case))?;
        return Ok(true);
    }
    let plot = match &words.plot {
        Some(plot) => Some((PendingFile::open(&plot.path)?, plot.format)),
        None => None,
    };
    let report = Report::of(splat::rows(&words.case, &words.path)?);
    if let Some((file, format)) = plot {
        file.finish(&draw_stress_errors(&StressErrors { rows: &report.rows }, format)?)?;
    }
    print_report(&report, words.json)?;
    Ok(report.failed == 0)
}
