use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use anyhow::ensure;
use atsplat_protocol::{BuiltIndex, IndexLayout, SamplingRule};
use atsplat_scene::inspect::left_out;
use atsplat_scene::{SceneSource as _, WarningKind, Warnings};
use serde::Serialize;

use crate::dataset_args::ImageArgs;
use crate::objects::check_reading;
use crate::output_lock::OutputFiles;
use crate::overwrite::{Input, check_output};
use crate::parse;
use crate::paths::PendingFile;
use crate::print::print_report;
use crate::progress::Progress;
use crate::warnings::print_warnings;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Dataset, in any supported format.
    data: PathBuf,

    /// Index file to write.
    #[arg(long, short, value_name = "INDEX")]
    out: PathBuf,

    /// Sampling rule: the name of a rule in `eval/samplers/` (e.g. re10k-2v, dl3dv-6v), or a path that
    /// ends in `.toml`.
    #[arg(long, value_name = "RULE", value_parser = parse::sampler)]
    sampler: String,

    #[command(flatten)]
    images: ImageArgs,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report<'a> {
    sampler: &'a str,
    rule: &'a SamplingRule,
    scenes: usize,
    /// Scenes of the data that the rule was not given.
    left_out: u64,
    entries: usize,
    #[serde(rename = "refused-entries")]
    rejected_entries: usize,
    missing_images: usize,
    repeated_images: usize,
    #[serde(rename = "nulls")]
    scenes_without_entry: &'a BTreeMap<&'static str, usize>,
    /// The first scene without an entry for each reason, with its numbers.
    #[serde(rename = "first-nulls")]
    first_without_entry: &'a BTreeMap<&'static str, String>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let inputs = [Input::Toml("sampling rule", &args.sampler), Input::Dataset(&args.data)];
    check_output("--out", &args.out, &inputs)?;
    let rule = parse::rule(&args.sampler)?;
    let _outputs = OutputFiles::of([args.out.as_path()])?;
    let out = PendingFile::open(&args.out)?;
    let mut warnings = Warnings::new();
    let dataset = args.images.open(&args.data, &mut warnings)?;
    let opening = warnings.clone();
    let progress = Progress::new("scenes", dataset.keys().len());
    let built = rule.build(&dataset, &|| progress.step(), &mut warnings);
    drop(progress);
    check_reading()?;
    if built.entries > 0 {
        out.finish(built.index.to_json(&IndexLayout::PIXELSPLAT).as_bytes())?;
    }
    let BuiltIndex { scenes, entries, nulls, first_nulls, rejected_entries, missing_images, repeated_images, index: _ } =
        &built;
    let left_out = left_out(&opening, &warnings);
    let report = Report {
        sampler: &args.sampler,
        rule: &rule,
        scenes: *scenes,
        left_out,
        entries: *entries,
        rejected_entries: *rejected_entries,
        missing_images: *missing_images,
        repeated_images: *repeated_images,
        scenes_without_entry: nulls,
        first_without_entry: first_nulls,
    };
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    ensure!(*entries > 0, "no scene of {} has an entry; {} is not written", args.data.display(), args.out.display());
    let unusable_images = *missing_images as u64 + warnings.count(WarningKind::UnreadableImage);
    Ok(nulls.is_empty() && left_out == 0 && unusable_images == 0)
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sampler, scenes, entries, .. } = self;
        let rule = self.rule.sampler.name();
        let scene = if *scenes == 1 { "scene" } else { "scenes" };
        let entry = if *entries == 1 { "entry" } else { "entries" };
        writeln!(f, "sampling rule {sampler} ({rule}): {scenes} {scene}, {entries} {entry}")?;
        if self.rejected_entries > 0 {
            writeln!(f, "{:>7}  entries rejected for their overlap", self.rejected_entries)?;
        }
        if self.missing_images > 0 {
            writeln!(
                f,
                "{:>7}  frames skipped: no image or no usable pose; windows and distances count the others",
                self.missing_images
            )?;
        }
        if self.repeated_images > 0 {
            writeln!(f, "{:>7}  frames skipped: they repeat the image file of an earlier frame", self.repeated_images)?;
        }
        if self.left_out > 0 {
            writeln!(f, "{:>7}  scenes skipped: could not be read", self.left_out)?;
        }
        for (reason, count) in self.scenes_without_entry {
            let first =
                self.first_without_entry.get(reason).map_or_else(String::new, |first| format!(", such as {first}"));
            writeln!(f, "{count:>7}  scenes without an entry: {reason}{first}")?;
        }
        Ok(())
    }
}
