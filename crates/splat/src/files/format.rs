use std::fmt;

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
