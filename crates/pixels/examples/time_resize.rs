//! Times [`resize`] on request, so that `benches/pillow_resize.py` can alternate with Pillow.
//!
//! For each line `width height to_width to_height filter` of standard input it prints the seconds of one call and a
//! checksum of its result.
#![expect(clippy::print_stdout, reason = "the output goes to the caller's pipe")]

use std::io::{BufRead as _, Write as _};
use std::time::Instant;

use atsplat_pixels::{Filter, ImageU8, PixelError, resize};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut last: Option<ImageU8> = None;
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let mut words = line.split_whitespace();
        let mut number = || words.next().unwrap_or_default().parse::<u32>();
        let [width, height, to_width, to_height] = [number()?, number()?, number()?, number()?];
        let filter = match words.next() {
            Some("lanczos") => Filter::Lanczos,
            Some("bilinear") => Filter::Bilinear,
            Some("box") => Filter::Box,
            other => return Err(format!("expected lanczos, bilinear or box, found {other:?}").into()),
        };
        let image = match last.take() {
            Some(image) if (image.width(), image.height()) == (width, height) => image,
            _ => image(width, height)?,
        };
        let start = Instant::now();
        let resized = resize(&image, to_width, to_height, filter)?;
        let seconds = start.elapsed().as_secs_f64();
        let checksum = resized.samples().iter().fold(0u32, |sum, &v| sum.wrapping_mul(31).wrapping_add(v.into()));
        println!("{seconds:.9} {checksum}");
        std::io::stdout().flush()?;
        last = Some(image);
    }
    Ok(())
}

/// Sample `i` is the top byte of `i · 2654435761` modulo 2³².
fn image(width: u32, height: u32) -> Result<ImageU8, PixelError> {
    let samples = (0..width.saturating_mul(height).saturating_mul(3)).map(|i| i.wrapping_mul(2_654_435_761));
    ImageU8::new(width, height, samples.map(|value| value.to_be_bytes()[0]).collect())
}
