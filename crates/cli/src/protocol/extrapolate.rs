use std::fmt;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use atsplat_protocol::extrapolation::{Extrapolation, ExtrapolationReport, Incomplete, Placement};
use atsplat_protocol::{IndexFile, IndexLayout};
use atsplat_scene::{SceneSource as _, WarningKind, Warnings};
use clap::Args;
use indexmap::IndexMap;
use rayon::prelude::*;
use serde::Serialize;

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

    /// Frames before and after the window that become targets.
    #[arg(long, default_value = "10")]
    margin: NonZeroUsize,

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
        Some(path) => scene_lengths(path, &index.scenes.keys().cloned().collect::<Vec<_>>(), &mut warnings)?,
        None => IndexMap::new(),
    };
    let split = Extrapolation {
        margin: words.margin,
        placement: if words.keep_windows { Placement::Keep } else { Placement::Shift },
        incomplete: if words.clip { Incomplete::Clip } else { Incomplete::Drop },
    };
    let report = split.split(&index, &lengths);
    out.finish(report.index.to_json(&IndexLayout::PIXELSPLAT).as_bytes())?;
    let complete = report.too_short.is_empty() && report.invalid.is_empty();
    print_report(&Report(report), words.json)?;
    print_warnings(&warnings);
    Ok(complete)
}

/// How many frames each of `keys` has; scenes that cannot be read are warnings and stay out.
fn scene_lengths(
    path: &std::path::Path,
    keys: &[String],
    warnings: &mut Warnings,
) -> anyhow::Result<IndexMap<String, usize>> {
    let dataset = atsplat_scene::open(path, warnings)?;
    let progress = Progress::new("scenes", keys.len());
    let loaded: Vec<_> = keys
        .par_iter()
        .map(|key| {
            let mut own = Warnings::new();
            let length = dataset.load(key, &mut own).map(|scene| scene.frames.len());
            progress.step();
            (key, length, own)
        })
        .collect();
    let mut lengths = IndexMap::new();
    for (key, length, own) in loaded {
        warnings.merge(own);
        match length {
            Ok(length) => {
                lengths.insert(key.clone(), length);
            }
            Err(error) => warnings.push(WarningKind::UnreadableScene, key, error.to_string()),
        }
    }
    Ok(lengths)
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
            ("entries left out, frames outside the scene", report.invalid.len()),
            ("entries whose scene length is unknown", report.length_unknown),
        ];
        for (what, count) in rows {
            writeln!(f, "{count:>7}  {what}")?;
        }
        Ok(())
    }
}
