use std::ffi::OsStr;
use std::fmt;
use std::path::Path;

use atsplat_files::InvalidText;
use serde::Serialize;

/// Number encoding of a PLY file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// Decimal text, one row per line.
    Ascii,
    /// Least significant byte first, as every 3DGS tool writes it.
    BinaryLittleEndian,
    /// Most significant byte first.
    BinaryBigEndian,
}

/// The detected format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// 3DGS' PLY.
    Ply(Encoding),
    /// PlayCanvas' compressed PLY.
    CompressedPly,
    /// SPZ of this version.
    Spz(u32),
    /// antimatter15's rows of 32 bytes.
    Splat,
}

/// The extensions of files of Gaussians, in the order in which they are looked for.
pub const EXTENSIONS: [&str; 3] = ["ply", "spz", "splat"];

/// A format to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// 3DGS' PLY; lossless except that infinite opacity logits become ±20.
    Ply(Encoding),
    /// SPZ 2: quantised, with quaternions in 3 bytes. Centres to 2⁻¹² scene units within ±2047, log-scales to 1/16
    /// within [−10, 5.9375], opacities to 1/255, coefficients to 4/153 within ±10/3 (degree 0), to 1/16 (degree 1) or
    /// 1/8 within [−1, 1). Beyond these ranges, all centres get coarser steps, and other values become the nearest
    /// within, which [`ExportReport`](super::ExportReport) counts.
    Spz2 {
        /// Whether the Gaussians were trained, and should be rendered, with [`crate::RasterMode::Antialiased`].
        antialiased: bool,
    },
    /// SPZ 3: as SPZ 2, with quaternions in 4 bytes.
    Spz3 {
        /// As for SPZ 2.
        antialiased: bool,
    },
}

impl Output {
    /// All formats, for Gaussians without antialiasing.
    pub const ALL: [Self; 5] = [
        Self::Ply(Encoding::BinaryLittleEndian),
        Self::Ply(Encoding::Ascii),
        Self::Ply(Encoding::BinaryBigEndian),
        Self::Spz2 { antialiased: false },
        Self::Spz3 { antialiased: false },
    ];

    /// The format that a path's extension names, in upper or lower case: binary PLY or SPZ 3, without antialiasing.
    ///
    /// # Errors
    /// The known extensions, and the path.
    pub fn of_path(path: &Path) -> Result<Self, InvalidText> {
        let extension = path.extension().map(OsStr::to_ascii_lowercase);
        match extension.as_ref().and_then(|extension| extension.to_str()) {
            Some("ply") => Ok(Self::Ply(Encoding::BinaryLittleEndian)),
            Some("spz") => Ok(Self::Spz3 { antialiased: false }),
            _ => Err(InvalidText::new("a file that ends in .ply or .spz", &path.to_string_lossy())),
        }
    }

    /// The name on the command line and in records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ply(Encoding::BinaryLittleEndian) => "ply",
            Self::Ply(Encoding::Ascii) => "ply-ascii",
            Self::Ply(Encoding::BinaryBigEndian) => "ply-big-endian",
            Self::Spz2 { .. } => "spz2",
            Self::Spz3 { .. } => "spz3",
        }
    }

    /// The same format for Gaussians of this mode, which PLY does not store.
    #[must_use]
    pub const fn with_antialiased(self, antialiased: bool) -> Self {
        match self {
            Self::Ply(encoding) => Self::Ply(encoding),
            Self::Spz2 { .. } => Self::Spz2 { antialiased },
            Self::Spz3 { .. } => Self::Spz3 { antialiased },
        }
    }

    /// Whether all fields of Gaussians are read back with their bits, except for infinite opacity logits.
    pub const fn is_lossless(self) -> bool {
        match self {
            Self::Ply(_) => true,
            Self::Spz2 { .. } | Self::Spz3 { .. } => false,
        }
    }
}

impl Format {
    /// The extension of its files, one of [`EXTENSIONS`].
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Ply(_) | Self::CompressedPly => "ply",
            Self::Spz(_) => "spz",
            Self::Splat => "splat",
        }
    }
}

/// A readable name.
impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ply(Encoding::Ascii) => f.write_str("PLY in ASCII"),
            Self::Ply(Encoding::BinaryLittleEndian) => f.write_str("PLY"),
            Self::Ply(Encoding::BinaryBigEndian) => f.write_str("PLY, big-endian"),
            Self::CompressedPly => f.write_str("compressed PLY"),
            Self::Spz(version) => write!(f, "SPZ {version}"),
            Self::Splat => f.write_str(".splat"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_in_any_case_name_a_format() {
        let of = |path: &str| Output::of_path(Path::new(path));
        for path in ["scene.ply", "scene.PLY", "a.spz/scene.Ply"] {
            assert_eq!(of(path), Ok(Output::Ply(Encoding::BinaryLittleEndian)), "{path}");
        }
        for path in ["scene.spz", "a.ply/SCENE.SPZ"] {
            assert_eq!(of(path), Ok(Output::Spz3 { antialiased: false }), "{path}");
        }
        for path in ["scene.splat", "scene", "ply", "scene.ply.json", ""] {
            let expected = format!("expected a file that ends in .ply or .spz, found {path:?}");
            assert_eq!(of(path).unwrap_err().to_string(), expected);
        }
    }

    /// A format that is not in the list could not be named on the command line.
    #[test]
    fn formats_have_different_names_and_keep_the_mode() {
        let names = ["ply", "ply-ascii", "ply-big-endian", "spz2", "spz3"];
        assert_eq!(Output::ALL.map(Output::name), names);
        assert_eq!(Output::ALL.map(|output| output.with_antialiased(true).name()), names);
        assert_eq!(Output::ALL.map(Output::is_lossless), [true, true, true, false, false]);
        let antialiased = Output::ALL.map(|output| output.with_antialiased(true));
        assert_eq!(antialiased[3..], [Output::Spz2 { antialiased: true }, Output::Spz3 { antialiased: true }]);
        assert_eq!(antialiased[..3], Output::ALL[..3]);
    }
}
