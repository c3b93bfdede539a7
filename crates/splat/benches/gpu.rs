//! The scenes of `render.rs` on a GPU: `gpu [--adapter NAME] [--rounds N] [--only WORD] [--export FOLDER]`.

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]
#![expect(clippy::print_stdout, reason = "a benchmark prints its results")]

mod scene;

use std::path::Path;
use std::time::Instant;

use atsplat_camera::ImageSize;
use atsplat_splat::files::{self, Encoding, Output};
use atsplat_splat::gpu::{
    AdapterChoice, GpuImageGradients, GpuOptions, GpuRenderer, GpuStripGradients, ImageFormat, ImageNumbers,
};
use atsplat_splat::{ImageGradients, RenderOptions, Renderer, Stage};
use scene::scene;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let option = |name: &str| {
        let at = arguments.iter().position(|argument| argument == name)?;
        arguments.get(at + 1).cloned()
    };
    let cases = [
        ("131072", 131_072, ImageSize { width: 256, height: 256 }),
        ("311040", 311_040, ImageSize { width: 960, height: 512 }),
    ];
    if let Some(folder) = option("--export") {
        for (name, count, size) in cases {
            let path = Path::new(&folder).join(format!("{name}.ply"));
            files::write(&path, &scene(count, size, 0).0, Output::Ply(Encoding::BinaryLittleEndian)).expect("a file");
        }
        return;
    }
    let rounds = option("--rounds").map_or(9, |rounds| rounds.parse().expect("a number of rounds"));
    let choice = option("--adapter").map_or(AdapterChoice::Automatic, AdapterChoice::Name);
    let mut gpu = GpuRenderer::new(&choice, GpuOptions::default()).expect("an adapter");
    println!("{}", gpu.name());
    let options = RenderOptions::default();
    for (name, count, size) in cases {
        let (gaussians, view) = scene(count, size, 0);
        let images =
            ImageGradients { rgb: vec![[1.0, 0.5, -0.5]; view.pixels()], alpha: None, depth: None, scalar: None };
        let resident = gpu.upload(&gaussians).expect("memory");
        let image = gpu.render_resident(&resident, &view, &options).expect("an image");
        let rgb = gpu.read(&image).expect("an image").rgb;
        let image = gpu.settle(&image).expect("an image").result;
        let mean = [0, 1, 2].map(|channel| {
            rgb.iter().filter_map(|rgb| rgb.get(channel)).map(|value| f64::from(*value)).sum::<f64>() / rgb.len() as f64
        });
        println!("{name} mean colour: {:.4} {:.4} {:.4}", mean[0], mean[1], mean[2]);
        // Any image will do as a gradient.
        let strips = image.strips.iter();
        let resident_images = GpuImageGradients {
            strips: strips.map(|strip| GpuStripGradients { colours: strip.colours.clone(), extras: None }).collect(),
        };
        let mut timed = |what: &str, work: &mut dyn FnMut(&mut GpuRenderer)| {
            if option("--only").is_some_and(|only| !what.contains(&only)) {
                return;
            }
            work(&mut gpu);
            let before = gpu.counts();
            work(&mut gpu);
            println!("{name} {what}: {}", gpu.counts() - before);
            let mut secs: Vec<f64> = (0..rounds)
                .map(|_| {
                    let start = Instant::now();
                    work(&mut gpu);
                    start.elapsed().as_secs_f64()
                })
                .collect();
            secs.sort_by(f64::total_cmp);
            let [least, median] = [0, secs.len() / 2].map(|at| 1e3 * secs.get(at).copied().unwrap_or(f64::NAN));
            // Passes that stay on the device have no stage timings.
            let stages = if what.contains("host") { gpu.stages() } else { Vec::new() };
            let stages: Vec<String> =
                stages.iter().map(|Stage { name, secs }| format!("{name} {:.1}", 1e3 * secs)).collect();
            let rate = 1e3 / median;
            println!(
                "{name} {what}: least {least:.1} ms, median {median:.1} ms, {rate:.1} a second; {}",
                stages.join(", ")
            );
        };
        timed("forward from the host", &mut |gpu| {
            gpu.render(&gaussians, &view, &options).expect("an image");
        });
        timed("forward on the device", &mut |gpu| {
            let rendering = gpu.render_resident(&resident, &view, &options).expect("an image");
            gpu.read(&rendering).expect("an image");
        });
        timed("forward on the device, 8 bits a colour", &mut |gpu| {
            let rendering = gpu.render_resident(&resident, &view, &options).expect("an image");
            let format = ImageFormat { numbers: ImageNumbers::U8, alpha: false };
            gpu.read_image(&rendering, format).expect("an image");
        });
        timed("backward on the device", &mut |gpu| {
            let gradients = gpu.backward_resident(&resident, &view, &options, &resident_images).expect("gradients");
            gpu.settle(&gradients).expect("gradients");
        });
        timed("backward from the host", &mut |gpu| {
            gpu.backward(&gaussians, &view, &options, &images).expect("gradients");
        });
    }
}
