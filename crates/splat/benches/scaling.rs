//! How time scales with Gaussians, pixels and threads, and how far it is from the hardware limit.
//!
//! `cargo bench -p atsplat-splat --bench scaling` prints the tables of `benches/README.md`.

#![expect(clippy::expect_used, clippy::print_stdout, reason = "a benchmark prints and stops at the first error")]

mod scene;

use std::hint::black_box;
use std::time::Instant;

use atsplat_camera::ImageSize;
use atsplat_numeric::Extremes as _;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Gaussians, RenderOptions, View, reference, sh_coefficients};
use scene::scene;

/// Minimum number of rounds, and seconds after which no further round begins.
const ROUNDS: usize = 5;
const BUDGET_SECS: f64 = 2.0;

/// Gaussian–pixel pairs per second of one core with two 8-lane FMA ports at 3 GHz: 11 cycles for the 21 operations of
/// one vector of pairs.
const LANES_PER_SEC: f64 = 2.1e9;

fn main() {
    println!("| Gaussians to 256×256, one thread | ms | ns per Gaussian | pairs | floor, ms | over it |");
    println!("|---|---|---|---|---|---|");
    let small = ImageSize { width: 256, height: 256 };
    let bandwidth = bandwidth();
    let mut points = Vec::new();
    for count in [1_000, 4_000, 16_000, 64_000, 256_000, 1_000_000, 5_000_000] {
        let (gaussians, view) = scene(count, small, 0);
        let secs = median(1, &gaussians, &view);
        report(&count.to_string(), secs, &gaussians, &view, bandwidth);
        points.push((count as f64, secs));
    }
    println!("\n{}\n", fitted("Gaussians", &points));

    println!("| pixels, 131 072 Gaussians, one thread | ms | ns per Gaussian | pairs | floor, ms | over it |");
    println!("|---|---|---|---|---|---|");
    let (gaussians, _) = scene(131_072, small, 0);
    let mut points = Vec::new();
    for (width, height) in [(64, 64), (128, 128), (256, 256), (512, 512), (1280, 720), (1920, 1080), (3840, 2160)] {
        let (_, view) = scene(0, ImageSize { width, height }, 0);
        let secs = median(1, &gaussians, &view);
        report(&format!("{width}×{height}"), secs, &gaussians, &view, bandwidth);
        points.push((view.pixels() as f64, secs));
    }
    println!("\n{}\n", fitted("pixels", &points));

    println!("| threads, 311 040 Gaussians to 960×512 | ms | faster than one |");
    println!("|---|---|---|");
    let (gaussians, view) = scene(311_040, ImageSize { width: 960, height: 512 }, 0);
    let most = std::thread::available_parallelism().map_or(1, usize::from);
    let mut one = None;
    for threads in (0..).map(|power| 1 << power).take_while(|threads| *threads <= most) {
        let secs = median(threads, &gaussians, &view);
        println!("| {threads} | {:.1} | {:.2} |", secs * 1e3, one.get_or_insert(secs).to_owned() / secs);
    }
    println!("\nOne core copies {:.1} GB/s.", bandwidth / 1e9);
}

fn report(name: &str, secs: f64, gaussians: &Gaussians, view: &View, bandwidth: f64) {
    let (pairs, floor) = floor(gaussians, view, bandwidth);
    let each = secs * 1e9 / gaussians.len() as f64;
    println!(
        "| {name} | {:.2} | {each:.0} | {:.2} M | {:.2} | {:.1} |",
        secs * 1e3,
        pairs / 1e6,
        floor * 1e3,
        secs / floor
    );
}

/// Gaussian–pixel pairs on which a Gaussian has at least `min_alpha`, and the minimum time that they and the memory
/// traffic take on one core, without the savings of early stopping.
fn floor(gaussians: &Gaussians, view: &View, bandwidth: f64) -> (f64, f64) {
    let options = RenderOptions::default();
    let splats = reference::project(gaussians, view, &options).expect("a view");
    let area = |splat: &reference::Projection| {
        let [a, b, c] = splat.conic;
        2.0 * std::f64::consts::PI * (splat.opacity / options.constants.min_alpha).ln() / (a * c - b * b).sqrt()
    };
    let pairs: f64 = splats.iter().flatten().map(area).sum();
    // Per Gaussian: 11 values and the SH coefficients read once, a 48-byte record written and read, three sorting
    // passes over 8 bytes written and read, and a 4-byte list entry written and read.
    let read = 4 * (11 + 3 * sh_coefficients(gaussians.parts().sh_degree));
    let bytes = gaussians.len() as f64 * (read + 2 * 48 + 3 * 2 * 8 + 2 * 4) as f64;
    (pairs, pairs / LANES_PER_SEC + bytes / bandwidth)
}

/// Median seconds of a rendering, from world space to pixels.
fn median(threads: usize, gaussians: &Gaussians, view: &View) -> f64 {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let (mut renderer, options) = (CpuRenderer::default(), RenderOptions::default());
    let mut once = || {
        let start = Instant::now();
        black_box(pool.install(|| renderer.render(gaussians, view, &options)).expect("an image"));
        start.elapsed().as_secs_f64()
    };
    once();
    let start = Instant::now();
    let mut samples = Vec::new();
    while samples.len() < ROUNDS || (start.elapsed().as_secs_f64() < BUDGET_SECS && samples.len() < 50) {
        samples.push(once());
    }
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}

/// Memory bandwidth of one core when copying, counting reads and writes.
fn bandwidth() -> f64 {
    const BYTES: usize = 256 << 20;
    let (from, mut to) = (vec![1u8; BYTES], vec![0u8; BYTES]);
    let copies = (0..5).map(|_| {
        let start = Instant::now();
        to.copy_from_slice(black_box(&from));
        black_box(&to);
        2.0 * BYTES as f64 / start.elapsed().as_secs_f64()
    });
    copies.fold(0.0, f64::maximum_of)
}

/// Exponents of `time ∝ n^e` by least squares on logarithms, over all points and over the last three.
fn fitted(what: &str, points: &[(f64, f64)]) -> String {
    let exponent = |points: &[(f64, f64)]| {
        let logs: Vec<(f64, f64)> = points.iter().map(|(n, secs)| (n.ln(), secs.ln())).collect();
        let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / logs.len() as f64;
        let (x, y) = (mean(|point| point.0), mean(|point| point.1));
        let covariance: f64 = logs.iter().map(|point| (point.0 - x) * (point.1 - y)).sum();
        covariance / logs.iter().map(|point| (point.0 - x).powi(2)).sum::<f64>()
    };
    let last = &points[points.len().saturating_sub(3)..];
    format!("time ∝ {what}^{:.2} over all, ^{:.2} over the last three", exponent(points), exponent(last))
}
