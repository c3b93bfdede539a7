use std::ffi::OsStr;
use std::path::PathBuf;

use atsplat_report::plot::PlotFormat;
use clap::builder::{PathBufValueParser, TypedValueParser};

/// Where a plot goes, and as what.
#[derive(Clone, Debug)]
pub(crate) struct PlotFile {
    /// The path as given.
    pub(crate) path: PathBuf,
    /// By the path's extension.
    pub(crate) format: PlotFormat,
}

impl PlotFile {
    /// Parses the word on the command line.
    pub(crate) fn parser() -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new().try_map(Self::of)
    }

    fn of(path: PathBuf) -> Result<Self, String> {
        match path.extension().and_then(OsStr::to_str) {
            Some("svg") => Ok(Self { path, format: PlotFormat::Svg }),
            Some("png") => Ok(Self { path, format: PlotFormat::Png }),
            _ => Err(format!("a plot is written as .svg or .png, found {}", path.display())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_tells_the_format() {
        assert_eq!(PlotFile::of("a/b.svg".into()).unwrap().format, PlotFormat::Svg);
        assert_eq!(PlotFile::of("b.png".into()).unwrap().format, PlotFormat::Png);
        for other in ["plot.jpg", "plot", "svg", ".png"] {
            assert!(PlotFile::of(other.into()).is_err(), "{other}");
        }
    }
}
