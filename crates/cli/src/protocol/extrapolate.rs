use std::path::PathBuf;

use anyhow::bail;
use atsplat_protocol::extrapolation::{
    Extrapolation, ExtrapolationReport, Incomplete, Margin, Placement, scene_frames,
};
use atsplat_protocol::{IndexFile, IndexLayout};
use atsplat_scene::Warnings;
use indexmap::IndexMap;

use crate::dataset_args::ImageArgs;
use crate::objects::check_reading;
use crate::output_lock::OutputFiles;
use crate::overwrite::{Input, check_output};
use crate::paths::PendingFile;
use crate::print::print_report;
use crate::progress::Progress;
use crate::warnings::print_warnings;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Evaluation index whose context windows are kept (JSON).
    index: PathBuf,

    /// Index file to write.
    #[arg(long, short, value_name = "INDEX")]
    out: PathBuf,

    /// Dataset with the frames of each scene. Without it every scene counts as long enough, and every frame has an image.
    #[arg(long, value_name = "PATH")]
    data: Option<PathBuf>,

    #[command(flatten)]
    images: ImageArgs,

    /// Number of frames before and after the window that become targets, 1 to 1000.
    #[arg(long, value_name = "FRAMES", default_value_t = Margin::TEN)]
    margin: Margin,

    /// Keep windows in place instead of shifting those too close to the scene's ends.
    #[arg(long)]
    keep_windows: bool,

    /// Keep entries with fewer targets.
    #[arg(long)]
    clip: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let file = IndexFile::read(&args.index)?;
    let mut warnings = Warnings::new();
    file.warn_of_unknown_fields(&args.index, &mut warnings);
    let index = file.into_unambiguous().map_err(|error| error.in_file(&args.index))?;
    let data = args.data.iter().map(|data| Input::Dataset(data));
    let inputs: Vec<Input<'_>> = data.chain([Input::File("index", &args.index)]).collect();
    check_output("--out", &args.out, &inputs)?;
    let _outputs = OutputFiles::of([args.out.as_path()])?;
    let out = PendingFile::open(&args.out)?;
    let scenes = match &args.data {
        Some(path) => {
            let dataset = args.images.open(path, &mut warnings)?;
            let progress = Progress::new("scenes", index.scene_count());
            scene_frames(&index, &dataset, &|| progress.step(), &mut warnings)
        }
        None => IndexMap::new(),
    };
    check_reading()?;
    let split = Extrapolation {
        margin: args.margin,
        placement: if args.keep_windows { Placement::Keep } else { Placement::Shift },
        incomplete: if args.clip { Incomplete::Clip } else { Incomplete::Drop },
    };
    let report = split.split_among(&index, &scenes);
    if report.index.entries().next().is_none() {
        print_report(&report, args.json)?;
        print_warnings(&warnings);
        bail!(
            "no window has room for {} targets on each side: nothing was written{}",
            args.margin,
            advice(args, &report)
        );
    }
    out.finish(report.index.to_json(&IndexLayout::PIXELSPLAT).as_bytes())?;
    // With --data, a scene of unknown length is missing from it.
    let all_found = args.data.is_none() || report.length_unknown == 0;
    let complete = all_found && report.dropped() == 0 && report.missing_images == 0;
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    Ok(complete)
}

/// The options that keep more windows, if a window is in a scene at all.
fn advice(args: &Args, report: &ExtrapolationReport) -> String {
    if report.dropped() == report.invalid.len() {
        return String::new();
    }
    let options = [
        (args.margin.get() > 1, "--margin takes fewer targets on each side"),
        (!args.clip, "--clip keeps windows with those that the scene has"),
        (args.keep_windows, "without --keep-windows, windows move away from the ends of the scene"),
    ];
    let options = options.into_iter().filter(|(helps, _)| *helps);
    options.map(|(_, option)| format!("; {option}")).collect::<Vec<_>>().concat()
}
