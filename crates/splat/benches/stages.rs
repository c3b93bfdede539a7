//! Where the time goes: medians of the stages, without criterion's patience.
#![expect(clippy::expect_used, clippy::print_stdout, reason = "a benchmark stops at the first error and prints")]
mod scene;
use atsplat_camera::ImageSize;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{ImageGradients, RenderOptions};
fn main() {
    let cases = [
        ("131072 to 256x256, degree 0", 131_072, ImageSize { width: 256, height: 256 }, 0),
        ("311040 to 960x512, degree 0", 311_040, ImageSize { width: 960, height: 512 }, 0),
        ("311040 to 960x512, degree 3", 311_040, ImageSize { width: 960, height: 512 }, 3),
    ];
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        (1e3 * values[0], 1e3 * values[values.len() / 2])
    };
    // Of this thread, so that other work on the machine counts less.
    let now = || {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").expect("Linux");
        text.split(' ').next().and_then(|nanos| nanos.parse::<f64>().ok()).expect("nanoseconds") * 1e-9
    };
    let only = std::env::args().nth(1).unwrap_or_default();
    for (name, count, size, degree) in cases {
        if !name.contains(only.trim_start_matches("--bench")) {
            continue;
        }
        let (gaussians, view) = scene::scene(count, size, degree);
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut renderer = CpuRenderer::default();
            let options = RenderOptions::default();
            let images =
                ImageGradients { rgb: vec![[1.0, 0.5, -0.5]; view.pixels()], alpha: None, depth: None, scalar: None };
            let mut times: [Vec<f64>; 6] = Default::default();
            for _ in 0..25 {
                let all = pool.install(|| {
                    let start = now();
                    renderer.render(&gaussians, &view, &options).expect("a picture");
                    now() - start
                });
                let t = renderer.timings();
                let mut recording = renderer.record(&gaussians, &view, &options).expect("a recording");
                let back = pool.install(|| {
                    let start = now();
                    recording.backward(&images).expect("derivatives");
                    now() - start
                });
                renderer.reuse(recording);
                for (times, t) in
                    times.iter_mut().zip([all, t.project_secs, t.bin_secs, t.raster_secs, t.write_secs, back])
                {
                    times.push(t);
                }
            }
            let [all, project, bin, raster, write, back] = times.each_mut().map(median);
            println!(
                "{name} {threads} threads: all {all:.2?} project {project:.2?} bin {bin:.2?} raster {raster:.2?} write {write:.2?} backward {back:.2?} ratio {:.2} {:.2}",
                back.0 / all.0,
                back.1 / all.1
            );
        }
    }
}
