//! Decodes the files listed on standard input, one per line, for `benches/jpeg_parity.py`.
//!
//! For each it writes `width height`, a line break and the RGB bytes.

use std::io::{BufRead as _, Write as _};

use atsplat_pixels::{DecodeLimits, decode};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut output = std::io::stdout().lock();
    for path in std::io::stdin().lock().lines() {
        let image = decode(&std::fs::read(path?)?, &DecodeLimits::default())?;
        writeln!(output, "{} {}", image.width(), image.height())?;
        output.write_all(image.samples())?;
        output.flush()?;
    }
    Ok(())
}
