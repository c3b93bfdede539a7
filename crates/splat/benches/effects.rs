//! What `auto` saves of everything requested: renders both alternately, with one plan for the scene, as a sequence of
//! views does.
//!
//! Arguments are files of Gaussians; without any, simulated scenes. `--size N` sets the image's sides (256),
//! `--rounds N` the number of pairs (40).

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]

mod scene;

use std::io::Write as _;
use std::path::Path;
use std::time::Instant;

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::effects::{EffectPlan, EffectSelection, Scene};
use atsplat_splat::{
    Channels, Exposure, GaussianParts, Gaussians, RasterMode, RenderOptions, View, files, sh_coefficients,
};
use glam::{DMat3, DVec3};
use scene::scene;

/// A scene to render, and what is requested of it.
struct Case {
    name: String,
    gaussians: Gaussians,
    view: View,
    options: RenderOptions,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let number = |name: &str, default: u32| {
        let at = arguments.iter().position(|word| word == name);
        at.and_then(|at| arguments.get(at + 1)?.parse().ok()).unwrap_or(default)
    };
    let (side, rounds) = (number("--size", 256), number("--rounds", 40));
    let size = ImageSize { width: side, height: side };
    let files: Vec<&String> = arguments.iter().filter(|word| Path::new(word).is_file()).collect();
    let cases =
        if files.is_empty() { simulated(size) } else { files.into_iter().map(|path| file(path, size)).collect() };
    let mut out = std::io::stdout().lock();
    writeln!(out, "all ms | auto ms | saved (quartiles) | decided once, ms | scene").expect("a line");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for case in cases {
        let line = pool.install(|| compare(&case, rounds));
        writeln!(out, "{line} | {}", case.name).expect("a line");
    }
}

/// Alternates the two, so that other load affects both equally; the ratio is the median over pairs.
fn compare(Case { gaussians, view, options, .. }: &Case, rounds: u32) -> String {
    let scene = Scene::new(gaussians, usize::MAX);
    let mut renderer = CpuRenderer::default();
    let plan =
        |selection| EffectPlan::for_scene(&scene, view, options, &selection, EffectPlan::TOLERANCE).expect("a plan");
    let once = plan(EffectSelection::Auto).secs();
    let mut time = |selection: EffectSelection| {
        let (start, before) = (Instant::now(), processor_ms());
        std::hint::black_box(plan(selection).render(&mut renderer, gaussians).expect("an image"));
        before.zip(processor_ms()).map_or(1e3 * start.elapsed().as_secs_f64(), |(before, after)| after - before)
    };
    let mut pair = |round: u32| {
        if round.is_multiple_of(2) {
            return [EffectSelection::All, EffectSelection::Auto].map(&mut time);
        }
        let [auto, all] = [EffectSelection::Auto, EffectSelection::All].map(&mut time);
        [all, auto]
    };
    pair(0);
    let pairs: Vec<[f64; 2]> = (0..rounds).map(pair).collect();
    let [all, auto] = [0, 1].map(|which| quartiles(pairs.iter().map(|pair| pair[which]).collect())[1]);
    let [low, middle, high] = quartiles(pairs.iter().map(|[all, auto]| 100.0 * (1.0 - auto / all)).collect());
    format!("{all:7.2} | {auto:7.2} | {middle:5.1} % ({low:.1} to {high:.1}) | {:6.2}", 1e3 * once)
}

/// Processor time of this thread, where Linux reports it: other processes take none of it.
fn processor_ms() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(1e-6 * text.split(' ').next()?.parse::<f64>().ok()?)
}

fn quartiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [1, 2, 3].map(|quarter| values[quarter * (values.len() - 1) / 4])
}

/// A scene file seen from 2.5 times its mean radius.
fn file(path: &str, size: ImageSize) -> Case {
    let (gaussians, _) = files::read(Path::new(path)).expect("Gaussians");
    let means = || gaussians.parts().means.iter().map(|mean| DVec3::from_array(mean.map(f64::from)));
    let count = gaussians.len() as f64;
    let centre = means().fold(DVec3::ZERO, |sum, mean| sum + mean) / count;
    let radius = means().fold(0.0, |sum, mean| sum + (mean - centre).length()) / count;
    let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(0.0, 0.0, 2.5 * radius) - centre).expect("a pose");
    let intrinsics = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).expect("intrinsics");
    let view = View { camera: Camera::pinhole(pose, intrinsics), size };
    let name = format!("{path}, degree {}", gaussians.sh_degree());
    Case { name, gaussians, view, options: RenderOptions::default() }
}

/// 131 072 Gaussians per 256×256 pixels, of degree 3, whose harmonics have a magnitude by Gaussian and band.
fn simulated(size: ImageSize) -> Vec<Case> {
    let count = 2 * size.width as usize * size.height as usize;
    let (gaussians, view) = scene(count, size, 3);
    let case = |name: &str, magnitude: &dyn Fn(usize, usize) -> f32| {
        let mut parts: GaussianParts = gaussians.clone().into_parts();
        for (at, coefficients) in parts.sh.chunks_mut(sh_coefficients(3)).enumerate() {
            for (index, coefficient) in coefficients.iter_mut().enumerate().skip(1) {
                *coefficient = coefficient.map(|value| 2.0 * magnitude(at, index.isqrt()) * value);
            }
        }
        let gaussians = Gaussians::new(parts).expect("Gaussians");
        Case { name: name.to_owned(), gaussians, view, options: RenderOptions::default() }
    };
    let vain = |mut case: Case| {
        case.name.push_str(", with exposure, lens and scalars that change nothing");
        case.options.exposure = Some(Exposure::IDENTITY);
        case.options.channels = Channels { scalar: true, ..Channels::default() };
        case.view.camera.distortion = Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        case
    };
    let everything = |mut case: Case| {
        case.name.push_str(", with exposure, lens, anti-aliasing and depth");
        case.options.exposure = Some(Exposure::uniform(1.5));
        case.options.mode = RasterMode::Antialiased;
        case.options.background = [0.5; 3];
        case.options.channels = Channels { depth: true, ..Channels::default() };
        case.view.camera.distortion = Distortion::OpenCv { k1: -0.05, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        case
    };
    vec![
        case("padded: no harmonics", &|_, _| 0.0),
        vain(case("padded: no harmonics", &|_, _| 0.0)),
        case("a tenth of the Gaussians have harmonics of 0.1", &|at, _| if at % 10 == 0 { 0.1 } else { 0.0 }),
        case("harmonics of 0.1, 0.03, 0.01 by band", &|_, band| {
            0.316f32.powi(i32::try_from(band).unwrap_or(0)) * 0.316
        }),
        case("harmonics of 0.05 in every band", &|_, _| 0.05),
        case("harmonics of 0.5 in every band", &|_, _| 0.5),
        everything(case("harmonics of 40 in every band", &|_, _| 40.0)),
    ]
}
