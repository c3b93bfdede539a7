use std::path::PathBuf;

use anyhow::Context as _;
use atsplat_protocol::{DatasetCheck, FullLint, IndexFile, LintOptions, Preset, PresetMatch, compare, lint_file};
use atsplat_scene::Warnings;

use crate::dataset_args::ImageArgs;
use crate::objects::check_reading;
use crate::parse;
use crate::print::{print_report, warn};
use crate::warnings::print_warnings;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Evaluation index (JSON).
    index: PathBuf,

    /// Preset, by name or `.toml` path, whose index, bins and filters apply.
    #[arg(long, value_parser = parse::preset)]
    preset: Option<String>,

    /// Dataset in which the index's scenes are checked by the filters of `--preset`.
    #[arg(long, value_name = "PATH", requires = "preset")]
    data: Option<PathBuf>,

    #[command(flatten)]
    images: ImageArgs,

    /// Second index: check whether results on the two are comparable.
    #[arg(long, value_name = "INDEX")]
    against: Option<PathBuf>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let file = IndexFile::read(&args.index)?;
    let preset = args.preset.as_deref().map(Preset::resolve).transpose()?;
    let mut warnings = Warnings::new();
    let expected_size = preset.as_ref().and_then(|preset| preset.preprocessing.expected_size);
    let dataset = match &args.data {
        Some(path) => Some(args.images.open_for(path, expected_size, &mut warnings)?),
        None => None,
    };
    let mut options = LintOptions::default();
    if let Some(bins) = preset.as_ref().and_then(|preset| preset.overlap_bins.clone()) {
        options.bins = bins;
    }
    if let (Some(dataset), Some(preset)) = (&dataset, &preset) {
        options.dataset = Some(DatasetCheck::of(dataset, preset));
    }
    let lint = lint_file(&file, &options, &mut warnings);
    check_reading()?;
    let against = match &args.against {
        Some(path) => Some(compare(&file.index, &IndexFile::read(path).context("reading the second index")?.index)),
        None => None,
    };
    let preset = preset.as_ref().map(|preset| PresetMatch::new(preset, &file));
    let report = FullLint { lint, preset, against };
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    let faults = report.faults();
    if !faults.is_empty() {
        warn(&format!("unfit for an evaluation: {}", faults.join("; ")));
    }
    Ok(faults.is_empty())
}
