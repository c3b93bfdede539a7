//! Decodes the files named on standard input, one a line, for `benches/jpeg_parity.py`.
//!
//! Each is answered with `width height` and a line break, then the RGB bytes.

use std::io::{BufRead as _, Write as _};

use atsplat_pixels::{DecodeLimits, decode};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut answer = std::io::stdout().lock();
    for path in std::io::stdin().lock().lines() {
        let image = decode(&std::fs::read(path?)?, &DecodeLimits::default())?;
        writeln!(answer, "{} {}", image.width(), image.height())?;
        answer.write_all(image.samples())?;
        answer.flush()?;
    }
    Ok(())
}
