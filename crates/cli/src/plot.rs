//! Plot files named on the command line.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use atsplat_report::plot::{Drawing, PlotFormat};
use clap::builder::{PathBufValueParser, TypedValueParser};

use crate::paths::PendingFile;

/// Path and format of a plot.
#[derive(Clone, Debug)]
pub(crate) struct PlotFile {
    path: PathBuf,
    /// From the extension of the path.
    format: PlotFormat,
}

impl PlotFile {
    /// Parses a path that ends in .svg or .png.
    pub(crate) fn parser() -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new().try_map(Self::of)
    }

    /// Opens the file before long work starts.
    pub(crate) fn open(&self) -> anyhow::Result<PendingPlot> {
        Ok(PendingPlot { file: PendingFile::open(&self.path)?, format: self.format })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    fn of(path: PathBuf) -> Result<Self, String> {
        match path.extension().and_then(OsStr::to_str) {
            Some("svg") => Ok(Self { path, format: PlotFormat::Svg }),
            Some("png") => Ok(Self { path, format: PlotFormat::Png }),
            _ => Err(format!("expected a plot file that ends in .svg or .png, found {}", path.display())),
        }
    }
}

/// A plot file, which replaces its target when it is complete.
#[derive(Debug)]
pub(crate) struct PendingPlot {
    file: PendingFile,
    format: PlotFormat,
}

impl PendingPlot {
    pub(crate) fn path(&self) -> &Path {
        self.file.target()
    }

    /// Encodes the plot in the format of the file, and writes it.
    pub(crate) fn finish(
        self,
        encode: impl FnOnce(PlotFormat) -> Result<Vec<u8>, atsplat_report::ReportError>,
    ) -> anyhow::Result<()> {
        self.file.finish(&encode(self.format)?)
    }
}

/// Writes a plot as `NAME.svg` and `NAME.png`, and returns these names.
pub(crate) fn write_both(folder: &Path, name: &str, drawing: &Drawing) -> anyhow::Result<[String; 2]> {
    let files = [PlotFormat::Svg, PlotFormat::Png].map(|format| (format!("{name}.{}", format.extension()), format));
    for (file, format) in &files {
        PendingFile::open(&folder.join(file))?.finish(&drawing.encode(*format)?)?;
    }
    Ok(files.map(|(file, _)| file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_determines_the_format() {
        assert_eq!(PlotFile::of("a/b.svg".into()).unwrap().format, PlotFormat::Svg);
        assert_eq!(PlotFile::of("b.png".into()).unwrap().format, PlotFormat::Png);
        for other in ["plot.jpg", "plot", "svg", ".png"] {
            assert!(PlotFile::of(other.into()).is_err(), "{other}");
        }
    }
}
