//! `atsplat protocol estimators`: compares overlap estimators with true co-visibility on simulated scenes.

use atsplat_numeric::SplitMix64;
use std::fmt;

use anyhow::Context as _;
use atsplat_camera::ImageSize;
use atsplat_numeric::rank_correlation;
use atsplat_pixels::{ImageU8, Rounding};
use atsplat_protocol::overlap::{DepthMap, OverlapEstimator, OverlapView};
use atsplat_protocol::{BinRule, OverlapBins};
use atsplat_report::plot::{EstimatePoint, EstimatorPanel, EstimatorScatter};
use atsplat_rooms::{Geometry, Request, SceneKind, SceneSeed, Simulation, Split};
use serde::Serialize;

use crate::output::print_report;
use crate::parse;
use crate::plot::PlotFile;
use crate::progress::Progress;

/// Evaluated separately: what holds indoors need not hold outdoors.
const KINDS: [SceneKind; 2] = [SceneKind::Rooms, SceneKind::Yards];
/// Minimum distance of the two frames: neighbours see the same.
const MIN_GAP: usize = 5;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Number of simulated rooms, and of simulated yards.
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    scenes: u32,

    /// Pairs of views per scene.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pairs: u32,

    /// Size of images and depth maps.
    #[arg(long, value_name = "WxH", default_value = "160x90", value_parser = parse::size)]
    size: ImageSize,

    /// Seed of the choice of pairs.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Plot every estimate against the truth, .svg or .png.
    #[arg(long, value_name = "PICTURE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON, every pair with its numbers.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    scenes: usize,
    size: ImageSize,
    pairs: Vec<Pair>,
    estimators: Vec<Row>,
}

/// Two views, their true overlap, and the estimates.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Pair {
    kind: SceneKind,
    scene: String,
    frames: [usize; 2],
    truth: f64,
    /// In the order of the report's estimators; `null` if an estimator fails.
    estimates: Vec<Option<f64>>,
}

/// Accuracy of one estimator on one kind of scenes.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    kind: SceneKind,
    estimator: &'static str,
    measured: usize,
    /// Spearman's correlation of estimates and truth.
    rank_correlation: Option<f64>,
    /// Mean of estimate minus truth.
    bias: Option<f64>,
    /// Mean of the absolute difference.
    error: Option<f64>,
    /// Share of pairs whose estimate is in the same bin of `NoPoSplat` as the truth.
    same_bin: Option<f64>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let estimators = estimators()?;
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let progress = Progress::new("scenes", KINDS.len() * args.scenes as usize);
    let mut pairs = Vec::new();
    for kind in KINDS {
        for number in 0..args.scenes {
            let seed = SceneSeed { split: Split::Test, number };
            let simulation = Simulation::new(Request { size: args.size, ..Request::new(kind, seed) })?;
            for frames in args.draw_pairs(&simulation) {
                pairs.push(measure(&simulation, frames, &estimators)?);
            }
            progress.step();
        }
    }
    drop(progress);
    let rows = KINDS.into_iter().flat_map(|kind| {
        let of_kind: Vec<&Pair> = pairs.iter().filter(|pair| pair.kind == kind).collect();
        let rows = estimators.iter().enumerate().map(move |(at, estimator)| row(kind, estimator.name(), at, &of_kind));
        rows.collect::<Vec<_>>()
    });
    let rows = rows.collect();
    let scenes = KINDS.len() * args.scenes as usize;
    let report = Report { scenes, size: args.size, pairs, estimators: rows };
    if let Some(plot) = plot {
        plot.finish(|format| scatter(&report, &estimators).draw().encode(format))?;
    }
    print_report(&report, args.json)?;
    Ok(true)
}

impl Args {
    /// Draws pairs of frames with uniformly distributed gaps.
    fn draw_pairs(&self, simulation: &Simulation) -> Vec<[usize; 2]> {
        let last = simulation.shots().len() - 1;
        let mut random = SplitMix64::for_scene(self.seed, &simulation.key());
        let mut pair = || {
            let gap = random.within(MIN_GAP..=last)?;
            let first = random.within(0..=last - gap)?;
            Some([first, first + gap])
        };
        (0..self.pairs).filter_map(|_| pair()).collect()
    }
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

fn measure(simulation: &Simulation, frames: [usize; 2], estimators: &[OverlapEstimator]) -> anyhow::Result<Pair> {
    let [first, second] = frames;
    let truth = simulation.covisibility(first, second)?.overlap();
    let needs_pictures = estimators.iter().any(OverlapEstimator::needs_pictures);
    let (a, b) =
        (SimulatedView::of(simulation, first, needs_pictures)?, SimulatedView::of(simulation, second, needs_pictures)?);
    let (view_a, view_b) = (a.view()?, b.view()?);
    // A failed estimate, for example of two images without common features, is a result.
    let estimates = estimators.iter().map(|estimator| estimator.estimate(&view_a, &view_b).ok()).collect();
    Ok(Pair { kind: simulation.request().kind, scene: simulation.key(), frames, truth, estimates })
}

/// A view with all inputs of an estimator.
struct SimulatedView {
    camera: atsplat_camera::Camera,
    geometry: Geometry,
    picture: Option<ImageU8>,
}

impl SimulatedView {
    fn of(simulation: &Simulation, frame: usize, with_picture: bool) -> anyhow::Result<Self> {
        let picture = || Ok::<_, anyhow::Error>(simulation.picture(frame)?.to_u8(Rounding::Nearest)?);
        Ok(Self {
            camera: simulation.camera(frame)?,
            geometry: simulation.geometry(frame)?,
            picture: with_picture.then(picture).transpose()?,
        })
    }

    fn view(&self) -> anyhow::Result<OverlapView<'_>> {
        let depth = DepthMap::new(self.geometry.size, &self.geometry.depth).context("a simulated depth map")?;
        Ok(OverlapView { camera: &self.camera, picture: self.picture.as_ref(), depth: Some(depth) })
    }
}

fn row(kind: SceneKind, estimator: &'static str, at: usize, pairs: &[&Pair]) -> Row {
    let both = |pair: &&Pair| Some((pair.truth, pair.estimates.get(at).copied().flatten()?));
    let (truths, estimates): (Vec<f64>, Vec<f64>) = pairs.iter().filter_map(both).unzip();
    let mean = |value: &dyn Fn(f64, f64) -> f64| {
        let sum: f64 = truths.iter().zip(&estimates).map(|(truth, estimate)| value(*truth, *estimate)).sum();
        (!truths.is_empty()).then(|| sum / truths.len() as f64)
    };
    let bins = OverlapBins::noposplat(BinRule::Strict);
    Row {
        kind,
        estimator,
        measured: truths.len(),
        rank_correlation: rank_correlation(&truths, &estimates),
        bias: mean(&|truth, estimate| estimate - truth),
        error: mean(&|truth, estimate| (estimate - truth).abs()),
        same_bin: mean(&|truth, estimate| f64::from(bins.place(truth) == bins.place(estimate))),
    }
}

fn scatter(report: &Report, estimators: &[OverlapEstimator]) -> EstimatorScatter {
    let bins = OverlapBins::noposplat(BinRule::Strict);
    let point = |pair: &Pair, at: usize| {
        let kind = KINDS.iter().position(|kind| *kind == pair.kind)?;
        let estimate = pair.estimates.get(at).copied().flatten()?;
        Some(EstimatePoint { kind, truth: pair.truth, estimate })
    };
    let panel = |(at, estimator): (usize, &OverlapEstimator)| {
        let rank = |kind: SceneKind| {
            let mut rows = report.estimators.iter();
            rows.find(|row| row.kind == kind && row.estimator == estimator.name())?.rank_correlation
        };
        EstimatorPanel {
            estimator: estimator.name().to_owned(),
            points: report.pairs.iter().filter_map(|pair| point(pair, at)).collect(),
            rank_correlations: KINDS.map(rank).to_vec(),
        }
    };
    EstimatorScatter {
        title: "Estimated overlap against true co-visibility".to_owned(),
        subtitle: format!(
            "{} pairs of views of {} simulated scenes, {}; tinted squares: both in the same of NoPoSplat's bins",
            report.pairs.len(),
            report.scenes,
            report.size
        ),
        kinds: KINDS.map(|kind| kind.to_string()).to_vec(),
        bins: bins.names().to_vec(),
        edges: bins.edges().to_vec(),
        panels: estimators.iter().enumerate().map(panel).collect(),
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} pairs of views of {} simulated scenes, {}", self.pairs.len(), self.scenes, self.size)?;
        let [kind, estimator, measured, rank, bias, error, same] =
            ["scenes", "estimator", "measured", "rank corr.", "bias", "error", "same bin"];
        writeln!(f, "{kind:<7} {estimator:<20} {measured:>8} {rank:>10} {bias:>7} {error:>7} {same:>8}")?;
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
        for row in &self.estimators {
            let share = row.same_bin.map_or("-".to_owned(), |share| format!("{:.0} %", share * 100.0));
            writeln!(
                f,
                "{:<7} {:<20} {:>8} {:>10} {:>7} {:>7} {:>8}",
                row.kind.to_string(),
                row.estimator,
                row.measured,
                number(row.rank_correlation),
                number(row.bias),
                number(row.error),
                share
            )?;
        }
        Ok(())
    }
}
