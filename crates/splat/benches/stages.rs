//! Time per stage: `cargo bench -p atsplat-splat --bench stages [-- part of a scene's name]`.

#![expect(clippy::expect_used, clippy::print_stdout, reason = "a benchmark stops at the first error, and prints")]

mod scene;

use std::hint::black_box;
use std::time::Instant;

use atsplat_camera::ImageSize;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Gaussians, ImageGradients, RenderOptions, View};
use scene::scene;

const ROUNDS: usize = 25;

fn main() {
    let wanted = std::env::args().skip(1).find(|argument| !argument.starts_with("--")).unwrap_or_default();
    let (small, wide) = (ImageSize { width: 256, height: 256 }, ImageSize { width: 960, height: 512 });
    let cases = [
        ("131072 to 256x256, degree 0", 131_072, small, 0, false),
        ("311040 to 960x512, degree 0", 311_040, wide, 0, false),
        ("311040 to 960x512, degree 3", 311_040, wide, 3, false),
        ("311040 to 960x512, degree 0, in the order of patches", 311_040, wide, 0, true),
        ("311040 to 960x512, degree 3, in the order of patches", 311_040, wide, 3, true),
    ];
    for (name, count, size, degree, in_order) in cases.into_iter().filter(|(name, ..)| name.contains(&wanted)) {
        let (mut gaussians, view) = scene(count, size, degree);
        if in_order {
            gaussians = by_patch(&gaussians, &view);
        }
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            println!("{name}, {threads} threads: least and median of {ROUNDS} rounds in milliseconds");
            pool.install(|| rounds(&gaussians, &view));
        }
    }
}

/// The same Gaussians in the order of network outputs: patch by patch of 8×8 pixels.
fn by_patch(gaussians: &Gaussians, view: &View) -> Gaussians {
    const PATCH: f32 = 8.0;
    let focal = 0.9 * view.size.width as f32;
    let patch = |position: &usize| {
        let [x, y, depth] = gaussians.parts().means[*position];
        let pixel = |slope: f32, side: u32| focal * slope + 0.5 * side as f32;
        let (column, row) = (pixel(x / depth, view.size.width), pixel(y / depth, view.size.height));
        [(row / PATCH).floor(), (column / PATCH).floor()]
    };
    let mut order: Vec<usize> = (0..gaussians.len()).collect();
    order.sort_by(|a, b| patch(a).partial_cmp(&patch(b)).expect("numbers"));
    gaussians.select(&order).expect("positions")
}

fn rounds(gaussians: &Gaussians, view: &View) {
    let mut renderer = CpuRenderer::default();
    let options = RenderOptions::default();
    let images = ImageGradients { rgb: vec![[1.0, 0.5, -0.5]; view.pixels()], alpha: None, depth: None, scalar: None };
    let mut rendering = renderer.render(gaussians, view, &options).expect("an image");
    let mut gradients = renderer.backward(gaussians, view, &options, &images).expect("gradients");
    let views = [*view; 4];
    let mut times: [Vec<f64>; 9] = Default::default();
    for _ in 0..ROUNDS {
        let cpu = thread_secs();
        let clock = Instant::now();
        renderer.render_into(black_box(gaussians), view, &options, &mut rendering).expect("an image");
        let forward = clock.elapsed().as_secs_f64();
        let cpu = thread_secs() - cpu;
        let timings = renderer.timings();
        let mut recording = renderer.record(gaussians, view, &options).expect("a recording");
        let clock = Instant::now();
        recording.backward_into(&images, &mut gradients).expect("gradients");
        let backward = clock.elapsed().as_secs_f64();
        black_box(&gradients);
        renderer.reuse(recording);
        let clock = Instant::now();
        drop(black_box(renderer.render_many(gaussians, &views, &options).expect("images")));
        let each_of_many = clock.elapsed().as_secs_f64() / views.len() as f64;
        let round = [
            forward,
            cpu,
            timings.project_secs,
            timings.bin_secs,
            timings.raster_secs,
            timings.write_secs,
            backward,
            backward / forward * 1e-3,
            each_of_many,
        ];
        times.iter_mut().zip(round).for_each(|(times, time)| times.push(1e3 * time));
    }
    let names = [
        "everything",
        "of this thread alone",
        "project",
        "bin",
        "sort and raster",
        "write",
        "backward",
        "backward / forward, a ratio",
        "each of four views together",
    ];
    for (name, times) in names.into_iter().zip(&mut times) {
        times.sort_by(f64::total_cmp);
        println!("  {name:30} {:8.2} {:8.2}", times.first().expect("rounds"), times.get(ROUNDS / 2).expect("rounds"));
    }
}

/// CPU seconds of this thread on Linux, which are less affected by other load.
fn thread_secs() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|nanos| nanos.parse::<f64>().ok());
    nanos.map_or(f64::NAN, |nanos| 1e-9 * nanos)
}
