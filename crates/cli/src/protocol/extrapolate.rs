use std::fmt;
use std::path::PathBuf;

use atsplat_protocol::extrapolation::{
    Extrapolation, ExtrapolationReport, Incomplete, Margin, Placement, scene_lengths,
};
use atsplat_protocol::{IndexFile, IndexLayout};
use atsplat_scene::Warnings;
use clap::Args;
use indexmap::IndexMap;
use serde::Serialize;

use crate::dataset_words::PictureWords;
use crate::output::{PendingFile, print_report, print_warnings};
use crate::progress::Progress;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Evaluation index whose context windows are kept (JSON).
    index: PathBuf,

    /// Where the new index goes.
    #[arg(long, short, value_name = "INDEX")]
    out: PathBuf,

    /// Dataset that tells how long each scene is. Without it every scene counts as long enough.
    #[arg(long, value_name = "PATH")]
    data: Option<PathBuf>,

    #[command(flatten)]
    pictures: PictureWords,

    /// Frames before and after the window that become targets, 1 to 1000.
    #[arg(long, value_name = "FRAMES", default_value_t = Margin::TEN)]
    margin: Margin,

    /// Leave windows where they are instead of shifting those that start or end too close to the scene's ends.
    #[arg(long)]
    keep_windows: bool,

    /// Keep entries with fewer targets than asked for.
    #[arg(long)]
    clip: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
#[serde(transparent)]
struct Report(ExtrapolationReport);

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let index = IndexFile::read(&words.index)?.into_unambiguous()?;
    let out = PendingFile::open(&words.out)?;
    let mut warnings = Warnings::new();
    let lengths = match &words.data {
        Some(path) => {
            let dataset = words.pictures.open(path, &mut warnings)?;
            let progress = Progress::new("scenes", index.scene_count());
            scene_lengths(&index, &dataset, &|| progress.step(), &mut warnings)
        }
        None => IndexMap::new(),
    };
    let split = Extrapolation {
        margin: words.margin,
        placement: if words.keep_windows { Placement::Keep } else { Placement::Shift },
        incomplete: if words.clip { Incomplete::Clip } else { Incomplete::Drop },
    };
    let report = split.split(&index, &lengths);
    out.finish(report.index.to_json(&IndexLayout::PIXELSPLAT).as_bytes())?;
    // Without data nobody expects lengths to be known; with data, a scene that it lacks was not looked at.
    let looked_at = words.data.is_none() || report.length_unknown == 0;
    let complete = looked_at && report.left_out() == 0;
    print_report(&Report(report), words.json)?;
    print_warnings(&warnings);
    Ok(complete)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let report = &self.0;
        let rows = [
            ("null scenes", report.null_scenes),
            ("windows that start at frame 0", report.started_at_zero),
            ("windows shifted later", report.shifted_later),
            ("windows shifted earlier", report.shifted_earlier),
            ("entries with every target", report.complete),
            ("entries clipped", report.clipped.len()),
            ("entries left out, scene too short", report.too_short.len()),
            ("entries left out, no room before the window", report.no_room_before.len()),
            ("entries left out, no room after the window", report.no_room_after.len()),
            ("entries left out, frames outside the scene", report.invalid.len()),
            ("entries whose scene length is unknown", report.length_unknown),
        ];
        for (what, count) in rows {
            writeln!(f, "{count:>7}  {what}")?;
        }
        writeln!(f, "targets by distance: {}", report.targets_by_distance)
    }
}
