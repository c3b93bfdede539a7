//! Minimum and median milliseconds of each metric on two raw f32 RGB images, on one thread:
//! `time_metrics WIDTH HEIGHT RENDER TRUTH TURNS`. For `benches/against_skimage.py`.

#![expect(clippy::print_stdout, reason = "an example that prints")]

use std::error::Error;
use std::time::Instant;

use atsplat_metrics::{Pair, Score, Ssim, Values, psnr, ssim};
use atsplat_pixels::Image;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [width, height, render, truth, turns] = args.as_slice() else {
        return Err("expected WIDTH HEIGHT RENDER TRUTH TURNS".into());
    };
    let (width, height, turns) = (width.parse()?, height.parse()?, turns.parse::<usize>()?);
    let read = |path: &String| -> Result<Image, Box<dyn Error>> {
        let bytes = std::fs::read(path)?;
        let samples = bytes.as_chunks::<4>().0.iter().map(|sample| f32::from_le_bytes(*sample)).collect();
        Ok(Image::new(width, height, samples)?)
    };
    let (render, truth) = (read(render)?, read(truth)?);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let pair = Pair::new(&render, &truth)?;
    let time = |name: &str, work: &(dyn Fn() -> Score + Sync)| {
        let mut times = Vec::with_capacity(turns);
        let mut value = None;
        for _ in 0..turns {
            let start = Instant::now();
            value = pool.install(work).value();
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        let least = times.first().copied().unwrap_or(f64::NAN);
        let median = times.get(turns / 2).copied().unwrap_or(f64::NAN);
        println!("{name} {least} {median} {}", value.unwrap_or(f64::NAN));
    };
    time("psnr", &|| psnr(&pair, Values::Clipped));
    time("ssim", &|| ssim(&pair, Values::AsRendered, Ssim::SKIMAGE_GAUSSIAN).into());
    time("ssim-inria", &|| ssim(&pair, Values::AsRendered, Ssim::INRIA).into());
    time("ssim-uniform-7x7", &|| ssim(&pair, Values::AsRendered, Ssim::SKIMAGE_UNIFORM).into());
    Ok(())
}
