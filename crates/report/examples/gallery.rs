//! Draws every plot from synthetic data, as SVG and PNG, into a folder, and says what is wrong with it: `cargo run --example gallery FOLDER`.

use std::path::PathBuf;

use anyhow::Context as _;
use atsplat_report::plot::{self, PlotFormat};

#[path = "../src/gallery/mod.rs"]
#[expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "test support, shared with the unit tests")]
mod gallery;

#[expect(clippy::print_stderr, reason = "an example prints what it finds")]
fn main() -> anyhow::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).context("expected a folder to write to")?);
    std::fs::create_dir_all(&folder)?;
    for (name, drawing) in gallery::gallery().into_iter().chain(gallery::odd_gallery()) {
        for fault in drawing.faults() {
            eprintln!("{name}: {fault}");
        }
        for format in [PlotFormat::Svg, PlotFormat::Png] {
            let path = folder.join(name.replace(' ', "-")).with_extension(format.extension());
            std::fs::write(&path, drawing.encode(format)?).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}
