//! Draws every plot from made-up data, as SVG and PNG, into the folder that is given.

use std::path::PathBuf;

use anyhow::Context as _;
use atsplat_report::gallery::gallery;
use atsplat_report::plot::PlotFormat;

fn main() -> anyhow::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).context("expected a folder to write to")?);
    std::fs::create_dir_all(&folder)?;
    for (name, drawing) in gallery() {
        for format in [PlotFormat::Svg, PlotFormat::Png] {
            let path = folder.join(name).with_extension(format.extension());
            std::fs::write(&path, drawing.encode(format)?).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}
