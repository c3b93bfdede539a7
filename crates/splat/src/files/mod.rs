//! Files of Gaussians: one module per format, told apart by their first bytes.
//!
//! | format | read | written |
//! |---|---|---|
//! | 3DGS PLY: ascii, binary of either byte order; degrees 0 to 4; `filter_3D`; `uncertainty` | yes | yes |
//! | PlayCanvas' compressed PLY (`packed_position` …) | yes | no |
//! | SPZ 1 to 4 (Niantic) | yes | 2 and 3 |
//! | `.splat` (antimatter15) | yes | no |
//!
//! Gaussians come out in the axes of 3DGS' PLY files (+x right, +y down, +z forward), which are OpenCV's; SPZ is
//! converted. Any bytes give Gaussians or a typed error, and memory stays within a constant factor of what the
//! file's size can hold.

mod disk;
mod fault;
mod ply;
mod quantised;
mod splat;
mod spz;

use std::path::Path;

use serde::Serialize;

use crate::{Cleaning, GaussianParts, Gaussians, SplatError, Validation};
use fault::Fault;

/// How a Git LFS pointer begins (git-lfs `docs/spec.md`).
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// How numbers are stored in a PLY file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// Decimal text, one row a line.
    Ascii,
    /// Least significant byte first: what every 3DGS tool writes.
    BinaryLittleEndian,
    /// Most significant byte first.
    BinaryBigEndian,
}

/// The format that a file turned out to have.
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

/// The formats that can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// 3DGS' PLY, bit for bit but for infinite opacity logits, which become ±20.
    Ply(Encoding),
    /// SPZ 2: quantised, quaternions in 3 bytes. Centres to 2⁻¹² scene units, log-scales to 1/16 within
    /// [−10, 5.9375], coefficients to 1/16 (degree 1) or 1/8 within [−1, 1).
    Spz2 {
        /// Whether the Gaussians were trained with, and are to be drawn with, [`crate::RasterMode::Antialiased`].
        antialiased: bool,
    },
    /// SPZ 3: as 2, but quaternions in 4 bytes.
    Spz3 {
        /// As of SPZ 2.
        antialiased: bool,
    },
}

/// What reading a file came across.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Import {
    /// The file's format.
    pub format: Format,
    /// What was wrong with the stored Gaussians; those with a NaN are left out, infinite opacity logits are ±20
    /// ([`Cleaning::Import`]).
    pub validation: Validation,
    /// What the file holds and the Gaussians do not: properties, elements, extensions.
    pub unused: Vec<String>,
    /// Whether the Gaussians were trained with anti-aliasing, where the format says.
    pub antialiased: Option<bool>,
    /// Whether a PLY file's opacities all lie in [0, 1]: pixelSplat's and NoPoSplat's exporters write opacities where
    /// everybody else writes their logits, and nothing in the file tells. [`Gaussians::with_opacities_as_stored`]
    /// reads them so.
    pub opacities_may_be_no_logits: bool,
}

/// What a format's reader takes out of bytes.
struct Stored {
    parts: GaussianParts,
    format: Format,
    unused: Vec<String>,
    antialiased: Option<bool>,
}

/// Reads a file of Gaussians.
///
/// # Errors
/// [`SplatError::Io`]; otherwise as [`parse`].
pub fn read(path: &Path) -> Result<(Gaussians, Import), SplatError> {
    parse(&disk::read(path)?, path)
}

/// Reads Gaussians out of a file's bytes; `path` names them in errors, and its extension tells `.splat`, which has
/// no first bytes of its own.
///
/// # Errors
/// [`SplatError::Format`] for bytes that are none of the formats or break theirs, those behind the last row of a PLY
/// file's header among them; [`SplatError::LfsPointer`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<(Gaussians, Import), SplatError> {
    if bytes.starts_with(LFS_POINTER) {
        return Err(SplatError::LfsPointer { path: path.to_owned() });
    }
    let Stored { parts, format, unused, antialiased } = stored(bytes, path).map_err(|fault| fault.in_file(path))?;
    let (gaussians, validation) = Gaussians::new(parts)?.into_cleaned(Cleaning::Import);
    let logits = &gaussians.parts().opacity_logits;
    let is_opacity = |logit: &f32| (0.0..=1.0).contains(logit);
    let opacities_may_be_no_logits =
        matches!(format, Format::Ply(_)) && !logits.is_empty() && logits.iter().all(is_opacity);
    Ok((gaussians, Import { format, validation, unused, antialiased, opacities_may_be_no_logits }))
}

fn stored(bytes: &[u8], path: &Path) -> Result<Stored, Fault> {
    let has_extension = |wanted: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(wanted));
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        ply::read(bytes)
    } else if bytes.starts_with(&spz::GZIP_MAGIC) || bytes.starts_with(&spz::MAGIC) {
        spz::read(bytes)
    } else if has_extension("splat") {
        splat::read(bytes)
    } else {
        let start = bytes.get(..8).unwrap_or(bytes).escape_ascii();
        Err(Fault::new("first bytes", "a PLY, SPZ or .splat file", format!("\"{start}\"")))
    }
}

/// Writes Gaussians to a file, which appears when it is complete.
///
/// # Errors
/// [`SplatError::Format`] where the format has no place for what the Gaussians hold, [`SplatError::Io`].
pub fn write(path: &Path, gaussians: &Gaussians, output: Output) -> Result<(), SplatError> {
    let parts = gaussians.parts();
    match output {
        Output::Ply(encoding) => disk::write(path, |out| ply::write(parts, encoding, out)),
        Output::Spz2 { antialiased } => write_spz(path, parts, 2, antialiased),
        Output::Spz3 { antialiased } => write_spz(path, parts, 3, antialiased),
    }
}

fn write_spz(path: &Path, parts: &GaussianParts, version: u32, antialiased: bool) -> Result<(), SplatError> {
    let payload = spz::encode(parts, version, antialiased).map_err(|fault| fault.in_file(path))?;
    disk::write(path, |out| spz::compress(&payload, out))
}
