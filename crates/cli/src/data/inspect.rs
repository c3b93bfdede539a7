use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::ensure;
use atsplat_scene::inspect::{InspectOptions, Inspection, SizeSampling, inspect};
use atsplat_scene::{SceneSource as _, Warnings};
use serde::Serialize;

use super::geometry::{self, GeometryReport};
use super::simulate::PLAN;
use crate::dataset_args::DatasetArgs;
use crate::objects::check_reading;
use crate::print::{print_report, warn};
use crate::progress::Progress;
use crate::warnings::print_warnings;

#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub(crate) struct Args {
    #[command(flatten)]
    dataset: DatasetArgs,

    /// Read every image header, and look for every image's end, instead of three per scene. Empty files are always found.
    #[arg(long)]
    all_sizes: bool,

    /// List every scene.
    #[arg(long)]
    scenes: bool,

    /// Match features between frames and check whether the cameras explain them, and if not, which mistake
    /// would (feature `opencv`).
    #[arg(long)]
    check_geometry: bool,

    /// Scenes whose geometry is checked, evenly spread over the dataset.
    #[arg(long, value_name = "N", default_value_t = 4, requires = "check_geometry", value_parser = clap::value_parser!(u16).range(1..))]
    check_scenes: u16,

    /// Frame pairs to compare in each of them, for example `9:126,0:40`; by default pairs spread over the scene.
    #[arg(long, value_name = "A:B,…", value_delimiter = ',', value_parser = frame_pair, requires = "check_geometry")]
    pairs: Vec<(usize, usize)>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    #[serde(flatten)]
    inspection: Inspection,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    geometry: Vec<GeometryReport>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    #[cfg(not(feature = "opencv"))]
    if args.check_geometry {
        return Err(super::needs_opencv("--check-geometry"));
    }
    let mut warnings = Warnings::new();
    let dataset = args.dataset.open(&mut warnings)?;
    let options = InspectOptions {
        sizes: if args.all_sizes { SizeSampling::All } else { InspectOptions::default().sizes },
        per_scene: args.scenes,
    };
    let progress = Progress::new("scenes", dataset.keys().len());
    let inspection = inspect(&dataset, dataset.format, &options, &mut warnings, &|| progress.step());
    drop(progress);
    let mut geometry_warnings = Warnings::new();
    let geometry = if args.check_geometry {
        geometry::check(&dataset, args.check_scenes.into(), &args.pairs, &mut geometry_warnings)?
    } else {
        Vec::new()
    };
    check_reading()?;
    let (complete, read) = (inspection.is_complete(), inspection.scenes.read);
    print_report(&Report { inspection, geometry }, args.json)?;
    print_warnings(&geometry_warnings);
    ensure!(read > 0, "no scene of {} can be read", args.dataset.data.display());
    let unfinished = unfinished_simulation(&dataset.path);
    if let Some(plan) = &unfinished {
        warn(&format!("the simulation into this folder has not ended: {} lists all its scenes", plan.display()));
    }
    Ok(complete && unfinished.is_none())
}

/// The plan of a simulation that has not ended, in the folder of its scenes or in that of all splits; of a dataset at a URL, only in
/// the former, whose objects are listed.
fn unfinished_simulation(data: &Path) -> Option<PathBuf> {
    [Some(data), data.parent()].into_iter().flatten().map(|folder| folder.join(PLAN)).find(|plan| plan.is_file())
}

fn frame_pair(text: &str) -> Result<(usize, usize), String> {
    let pair = text.split_once(':').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    pair.ok_or_else(|| "expected two frame numbers, such as 9:126".to_owned())
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.inspection)?;
        for geometry in &self.geometry {
            writeln!(f, "\n{geometry}")?;
        }
        Ok(())
    }
}
