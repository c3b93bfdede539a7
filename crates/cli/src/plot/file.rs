use std::ffi::OsStr;
use std::path::PathBuf;

use atsplat_report::plot::PlotFormat;
use clap::builder::{PathBufValueParser, TypedValueParser};

/// Path and format of a plot.
#[derive(Clone, Debug)]
pub(crate) struct PlotFile {
    pub(crate) path: PathBuf,
    /// From the extension of the path.
    pub(crate) format: PlotFormat,
}

impl PlotFile {
    /// Parses a path that ends in .svg or .png.
    pub(crate) fn parser() -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new().try_map(Self::of)
    }

    fn of(path: PathBuf) -> Result<Self, String> {
        match path.extension().and_then(OsStr::to_str) {
            Some("svg") => Ok(Self { path, format: PlotFormat::Svg }),
            Some("png") => Ok(Self { path, format: PlotFormat::Png }),
            _ => Err(format!("expected a plot file that ends in .svg or .png, found {}", path.display())),
        }
    }
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
