//! `atsplat protocol estimators`: compares overlap estimators with true co-visibility on simulated scenes.

use atsplat_camera::ImageSize;
use atsplat_eval::overlap_estimators::{EstimatorStudy, KINDS};
use atsplat_protocol::overlap::OverlapEstimator;
use atsplat_report::plot_data::estimator_scatter;

use crate::output_lock::OutputFiles;
use crate::parse;
use crate::plot::PlotFile;
use crate::print::print_report;
use crate::progress::Progress;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Number of simulated rooms, and of simulated yards.
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    scenes: u32,

    /// Pairs of views per scene.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pairs: u32,

    /// Size of images and depth maps.
    #[arg(long, value_name = "WxH", default_value = "160x90")]
    size: ImageSize,

    /// Seed of the choice of pairs.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Plot every estimate against the truth, .svg or .png.
    #[arg(long, value_name = "IMAGE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON, every pair with its numbers.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let estimators = estimators()?;
    let _outputs = OutputFiles::of(args.plot.as_ref().map(PlotFile::path))?;
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let study = EstimatorStudy { scenes: args.scenes, pairs: args.pairs, size: args.size, seed: args.seed };
    let progress = Progress::new("scenes", KINDS.len() * args.scenes as usize);
    let report = study.run(&estimators, &|| progress.step())?;
    drop(progress);
    if let Some(plot) = plot {
        plot.finish(|format| estimator_scatter(&report, &estimators).draw().encode(format))?;
    }
    print_report(&report, args.json)
}

/// All estimators of this build.
fn estimators() -> anyhow::Result<Vec<OverlapEstimator>> {
    let names: &[&str] = if cfg!(feature = "opencv") {
        &["epipolar-ray", "feature-coverage", "depth-covisibility"]
    } else {
        &["epipolar-ray", "depth-covisibility"]
    };
    names.iter().map(|name| parse::estimator(name)).collect()
}
