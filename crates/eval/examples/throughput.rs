//! Measures the throughput of splatting, PSNR, SSIM and the store in trials a minute, and the time of a single trial.
//!
//! `cargo run --release -p atsplat-eval --example throughput -- ../shared/data/re10k/000c3ab189999a83 [TARGETS]`
//!
//! Every trial has two context and three target images of a real scene at 256², and 131 072 Gaussians: one for each
//! context pixel, on a wall in front of its camera, as wide as the pixel. The network's time is not included.

#![expect(clippy::print_stdout, reason = "an example prints what it measures")]

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, ensure};
use atsplat_camera::DirectionScale;
use atsplat_eval::method::{Cost, Method, MethodError, Prediction, Splatting, TrialInput};
use atsplat_eval::runner::{
    Dataset, KeepImages, Plan, PlannedIndex, Selection, current_provenance, named_metrics, run,
};
use atsplat_eval::timing::TimingPlan;
use atsplat_files::Sha256Digest;
use atsplat_metrics::{Networks, Suite};
use atsplat_protocol::trial::Prefetch;
use atsplat_protocol::{EvaluationIndex, IndexEntry, Preset};
use atsplat_results::times::times;
use atsplat_results::{MethodRecord, Store};
use atsplat_scene::{SceneSource, Warnings};
use atsplat_splat::{GaussianParts, Gaussians};

/// Trials and targets of pixelSplat's RE10K index.
const PUBLISHED: [f64; 2] = [6474.0, 19_422.0];
/// Depth of the wall in multiples of the distance between the context cameras.
const WALL: f64 = 4.0;

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let data = args.next().context("expected the folder of a scene")?;
    let targets: usize = args.next().map_or(Ok(501), |targets| targets.parse())?;
    let source: Arc<dyn SceneSource> = Arc::new(atsplat_scene::open(&data, &mut Warnings::new())?);
    let key = source.keys().first().context("the data has no scene")?.clone();
    let frames = source.load(&key, &mut Warnings::new())?.frames.len();
    ensure!(frames > 60, "expected more than 60 frames, found {frames}");
    let entries = targets.div_ceil(3);
    let entry = |at: usize| {
        let first = at % (frames - 50);
        IndexEntry { context: vec![first, first + 45], target: vec![first + 10, first + 22, first + 35], overlap: None }
    };
    let scenes = [(key, (0..entries).map(entry).collect())].into_iter().collect();
    let (description, sha256) = ("windows of 46 frames".to_owned(), Sha256Digest::of(b"throughput"));
    let index = PlannedIndex {
        index: EvaluationIndex { scenes },
        description,
        sha256,
        name: None,
        reduced_from: None,
        left_out: 0,
        notices: std::collections::BTreeMap::new(),
    };
    let mut preset = Preset::named("re10k-2v-256")?;
    preset.preprocessing.expected_size = None;
    let datasets = [Dataset { name: preset.name.clone(), preset, source, description: data, index }];
    let methods: [Arc<dyn Method>; 1] = [Arc::new(Wall::default())];
    let suite = Suite::new(named_metrics(["psnr", "ssim"])?, Networks::default(), 0);
    let plan = Plan {
        datasets: &datasets,
        methods: &methods,
        suite: &suite,
        selection: Selection::default(),
        timing: None,
        images: KeepImages::Nothing,
        prefetch: Prefetch::default(),
    };
    println!("threads  trials/min  19 422 targets in");
    let most = std::thread::available_parallelism()?.get();
    for threads in (0..).map(|power| 1 << power).take_while(|threads| *threads <= most) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let folder = tempfile::tempdir()?;
        let provenance = plan.provenance(current_provenance("0", None, Vec::new()))?;
        let start = Instant::now();
        let store = Store::create(folder.path(), provenance)?;
        let (results, _) = pool.install(|| run(&plan, store, &|_| ()))?;
        let secs = start.elapsed().as_secs_f64();
        let scored = results.targets.iter().filter(|row| row.scores.contains_key("psnr")).count();
        ensure!(scored == 3 * entries, "{scored} of {} targets scored", 3 * entries);
        let whole = secs * PUBLISHED[0] / entries as f64 / 60.0;
        println!("{threads:>7}  {:>10.0}  {whole:>13.1} min", 60.0 * entries as f64 / secs);
    }
    let timed =
        Plan { timing: Some(TimingPlan::default()), selection: Selection { limit: Some(3), shard: None }, ..plan };
    let folder = tempfile::tempdir()?;
    let store = Store::create(folder.path(), timed.provenance(current_provenance("0", None, Vec::new()))?)?;
    let (results, _) = run(&timed, store, &|_| ())?;
    let times = times(&results, &datasets[0].name, "wall").map_err(anyhow::Error::msg)?;
    for (what, spread) in [("making Gaussians", times.encode), ("rendering a view", times.render)] {
        if let Some(spread) = spread {
            println!("{what}: {:.1} ms, MAD {:.1}", 1e3 * spread.median, 1e3 * spread.mad);
        }
    }
    Ok(())
}

/// Turns context pixels into Gaussians on a wall.
#[derive(Debug, Default)]
struct Wall {
    splatting: Splatting,
}

impl Method for Wall {
    fn record(&self) -> MethodRecord {
        MethodRecord { name: "wall".to_owned(), kind: "ply".to_owned(), deterministic: true, ..MethodRecord::default() }
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        Ok(self.splatting.predict(input, gaussians(input)?, Cost::default()))
    }
}

fn gaussians(input: TrialInput<'_>) -> Result<Gaussians, MethodError> {
    let failed = |error: &dyn std::fmt::Display| MethodError::Failed(error.to_string());
    let views = input.trial.context();
    let centres: Vec<_> = views.iter().map(|view| view.camera.camera_from_world.inverse().centre()).collect();
    let baseline = centres.first().zip(centres.last()).map_or(1.0, |(a, b)| a.distance(*b));
    let depth = WALL * baseline;
    let mut parts = GaussianParts::default();
    for (view, image) in views.iter().zip(input.images) {
        let rays = view.camera.pixel_rays(view.size, DirectionScale::UnitDepth).map_err(|error| failed(&error))?;
        let pixel = depth / (view.camera.intrinsics.fx * f64::from(view.size.width));
        #[expect(clippy::cast_possible_truncation, reason = "Gaussians are f32")]
        for (ray, rgb) in rays.iter().zip(image.samples().as_chunks::<3>().0) {
            parts.means.push(ray.at(depth).to_array().map(|value| value as f32));
            parts.quaternions.push([1.0, 0.0, 0.0, 0.0]);
            parts.log_scales.push([(0.6 * pixel).ln() as f32; 3]);
            parts.opacity_logits.push(2.0);
            parts.sh.push(rgb.map(|sample| (f32::from(sample) / 255.0 - 0.5) / 0.282_094_8));
        }
    }
    Gaussians::new(parts).map_err(|error| failed(&error))
}
