//! Where the time goes: medians of the stages, without criterion's patience.
#![expect(clippy::expect_used, clippy::print_stdout, reason = "a benchmark stops at the first error and prints")]
mod scene;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{ImageGradients, RenderOptions};
use atsplat_camera::ImageSize;
fn main() {
    let cases = [
        ("131072 to 256x256, degree 0", 131_072, ImageSize { width: 256, height: 256 }, 0),
        ("311040 to 960x512, degree 0", 311_040, ImageSize { width: 960, height: 512 }, 0),
        ("311040 to 960x512, degree 3", 311_040, ImageSize { width: 960, height: 512 }, 3),
    ];
    let median = |values: &mut Vec<f64>| { values.sort_by(f64::total_cmp); (1e3 * values[0], 1e3 * values[values.len() / 2]) };
    let only = std::env::args().nth(1).unwrap_or_default();
    for (name, count, size, degree) in cases {
        if !name.contains(only.trim_start_matches("--bench")) { continue; }
        let (gaussians, view) = scene::scene(count, size, degree);
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut renderer = CpuRenderer::default();
            let options = RenderOptions::default();
            let images = ImageGradients { rgb: vec![[1.0, 0.5, -0.5]; view.pixels()], alpha: None, depth: None, scalar: None };
            let mut times: [Vec<f64>; 6] = Default::default();
            for _ in 0..25 {
                let start = std::time::Instant::now();
                pool.install(|| renderer.render(&gaussians, &view, &options)).expect("a picture");
                let t = renderer.timings();
                let all = start.elapsed().as_secs_f64();
                let mut recording = renderer.record(&gaussians, &view, &options).expect("a recording");
                let start = std::time::Instant::now();
                pool.install(|| recording.backward(&images)).expect("derivatives");
                let back = start.elapsed().as_secs_f64();
                renderer.reuse(recording);
                for (times, t) in times.iter_mut().zip([all, t.project_secs, t.bin_secs, t.raster_secs, t.write_secs, back]) { times.push(t); }
            }
            let [all, project, bin, raster, write, back] = times.each_mut().map(median);
            println!("{name} {threads} threads: all {all:.2?} project {project:.2?} bin {bin:.2?} raster {raster:.2?} write {write:.2?} backward {back:.2?} ratio {:.2} {:.2}", back.0 / all.0, back.1 / all.1);
        }
    }
}
