//! PSNR and SSIM of the images in one folder against those of the same names in another: `score_folders RENDERS TRUTH`.

#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::path::Path;

use anyhow::ensure;
use atsplat_metrics::{Pair, Ssim, Values, psnr, ssim};
use atsplat_pixels::{DecodeLimits, Image, decode};

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [renders, truths] = arguments.as_slice() else { anyhow::bail!("usage: score_folders RENDERS TRUTH") };
    let mut names: Vec<_> =
        std::fs::read_dir(truths)?.map(|entry| Ok(entry?.file_name())).collect::<std::io::Result<_>>()?;
    names.sort();
    ensure!(!names.is_empty(), "{truths} is empty");
    let mut sums = [0.0; 2];
    for name in &names {
        let (render, truth) = (read(&Path::new(renders).join(name))?, read(&Path::new(truths).join(name))?);
        let pair = Pair::new(&render, &truth)?;
        let scores = [
            psnr(&pair, Values::Clipped).capped(100.0).unwrap_or(f64::NAN),
            ssim(&pair, Values::Clipped, Ssim::SKIMAGE_GAUSSIAN)?,
        ];
        println!("{}: {:.2} dB, {:.4}", name.display(), scores[0], scores[1]);
        for (sum, score) in sums.iter_mut().zip(scores) {
            *sum += score;
        }
    }
    let [psnr, ssim] = sums.map(|sum| sum / names.len() as f64);
    println!("mean of {}: {psnr:.2} dB, {ssim:.4}", names.len());
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<Image> {
    Ok(Image::from_u8(&decode(&std::fs::read(path)?, &DecodeLimits::default())?))
}
