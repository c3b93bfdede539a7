//! Time of a step and of its parts: `cargo bench -p atsplat-fit --bench steps [-- part of a strategy's name]`. Processor
//! time is that of this thread alone, which other work changes less than the clock.

#![expect(clippy::expect_used, clippy::print_stdout, reason = "a benchmark stops at the first error, and prints")]

use std::hint::black_box;
use std::time::Instant;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_fit::loss::PhotometricLoss;
use atsplat_fit::{Adam, Fit, FitConfig, OptimisedGaussians, Rates, Strategy, TrainingView};
use atsplat_numeric::SplitMix64;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{GaussianParts, Gaussians, Gradients, ImageGradients, RenderOptions, View, sh_coefficients};
use glam::{DMat3, DVec3};

const ROUNDS: usize = 200;
const COUNT: usize = 20_000;
const SIDE: u32 = 128;
const DEGREE: u8 = 3;
const PARTS: [&str; 6] = ["step", "forward", "loss", "backward", "Adam", "step / (forward + backward), a ratio"];

fn main() {
    let wanted = std::env::args().skip(1).find(|argument| !argument.starts_with("--")).unwrap_or_default();
    for strategy in [Strategy::Fixed, Strategy::Gaussians3d, Strategy::MipSplatting, Strategy::Mcmc] {
        for threads in [1, 2] {
            if strategy.name().contains(&wanted) {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                println!(
                    "{}, {threads} threads: least, median, mean processor time of {ROUNDS} in ms",
                    strategy.name()
                );
                pool.install(|| rounds(strategy));
            }
        }
    }
}

fn rounds(strategy: Strategy) {
    let views: Vec<TrainingView> = (0..8).map(|number| image(number, &scene(1000, 0.04))).collect();
    let start = scene(COUNT, 0.015);
    // Long enough that nothing is scheduled; the start has every degree of the harmonics.
    let config = FitConfig { max_gaussians: COUNT, ..FitConfig::new(strategy, 30_000) };
    let mut fit = Fit::new(config, views.clone(), &start).expect("an optimisation");
    let options = fit.options();
    let (mut renderer, mut loss) = (CpuRenderer::default(), PhotometricLoss::default());
    let mut images = ImageGradients { rgb: Vec::new(), alpha: None, depth: None, scalar: None };
    let (mut gradients, mut trained) = (Gradients::default(), OptimisedGaussians::new(start.clone()));
    let Rates { means, colours, opacities, scales, rotations, .. } = Rates::default();
    let adam = Adam { means, colours, opacities, scales, rotations, sh_degree: DEGREE, step: 1 };
    let (mut times, mut busy): ([Vec<f64>; PARTS.len()], _) = (Default::default(), [0.0; PARTS.len()]);
    for view in views.iter().cycle().take(ROUNDS) {
        let mut laps = [0.0; PARTS.len()];
        let mut clocks = (Instant::now(), thread_secs());
        let mut lap = |part: usize| {
            laps[part] = 1e3 * clocks.0.elapsed().as_secs_f64();
            busy[part] += 1e3 * (thread_secs() - clocks.1) / ROUNDS as f64;
            clocks = (Instant::now(), thread_secs());
        };
        black_box(fit.step().expect("a step"));
        lap(0);
        let mut recording = renderer.record(&start, &view.view, &options).expect("a recording");
        lap(1);
        loss.evaluate(&recording.rendering().rgb, &view.rgb, view.view.size, 0.2, &mut images.rgb);
        lap(2);
        recording.backward_into(&images, &mut gradients).expect("gradients");
        lap(3);
        renderer.reuse(recording);
        adam.update(&mut trained, &gradients);
        lap(4);
        laps[5] = laps[0] / (laps[1] + laps[3]);
        times.iter_mut().zip(laps).for_each(|(times, time)| times.push(time));
    }
    busy[5] = busy[0] / (busy[1] + busy[3]);
    for ((name, times), busy) in PARTS.into_iter().zip(&mut times).zip(busy) {
        times.sort_by(f64::total_cmp);
        let [least, median] = [0, ROUNDS / 2].map(|at| times[at]);
        println!("  {name:36} {least:8.2} {median:8.2} {busy:8.2}");
    }
}

/// Processor seconds of this thread on Linux.
fn thread_secs() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|nanos| nanos.parse::<f64>().ok());
    nanos.map_or(f64::NAN, |nanos| 1e-9 * nanos)
}

/// Gaussians in a ball of radius 1.
#[expect(clippy::cast_possible_truncation, reason = "parameters are f32")]
fn scene(count: usize, scale: f32) -> Gaussians {
    let mut random = SplitMix64::new(3);
    let mut uniform = move || random.unit_f32();
    let mut parts = GaussianParts { sh_degree: DEGREE, ..GaussianParts::default() };
    for _ in 0..count {
        let direction = DVec3::from([(); 3].map(|()| f64::from(uniform()) - 0.5)).normalize_or_zero();
        parts.means.push((direction * f64::from(uniform()).cbrt()).to_array().map(|value| value as f32));
        parts.quaternions.push([1.0, uniform(), uniform(), uniform()]);
        parts.log_scales.push([(); 3].map(|()| (scale * (0.5 + uniform())).ln()));
        parts.opacity_logits.push(4.0 * uniform() - 2.0);
        parts.sh.extend((0..sh_coefficients(DEGREE)).map(|_| [(); 3].map(|()| uniform() - 0.5)));
    }
    Gaussians::new(parts).expect("Gaussians")
}

/// The Gaussians from a place on a circle.
fn image(number: u32, gaussians: &Gaussians) -> TrainingView {
    let angle = 0.7 * f64::from(number);
    let centre = 3.0 * DVec3::new(angle.sin(), 0.0, -angle.cos());
    let forward = -centre.normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let pose = CameraFromWorld::new(rotation, -(rotation * centre)).expect("a pose");
    let intrinsics = NormalizedIntrinsics::new(1.2, 1.2, 0.5, 0.5).expect("intrinsics");
    let size = ImageSize { width: SIDE, height: SIDE };
    let view = View { camera: Camera::pinhole(pose, intrinsics), size };
    let rendering = CpuRenderer::default().render(gaussians, &view, &RenderOptions::default()).expect("an image");
    let rgb = rendering.rgb.into_iter().map(|rgb| rgb.map(|value| value.clamp(0.0, 1.0))).collect();
    TrainingView { name: number.to_string(), view, rgb }
}
