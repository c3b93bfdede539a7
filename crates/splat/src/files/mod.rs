//! File formats of Gaussians: one module per format, detected from the first bytes.
//!
//! | format | read | written |
//! |---|---|---|
//! | 3DGS PLY: ascii, binary of either byte order; degrees 0 to 4; `filter_3D`; `uncertainty` | yes | yes |
//! | PlayCanvas' compressed PLY (`packed_position` …) | yes | no |
//! | SPZ 1 to 4 (Niantic) | yes | 2 and 3 |
//! | `.splat` (antimatter15) | yes | no |
//!
//! Gaussians are returned in the axes of 3DGS' PLY files (+x right, +y down, +z forward), which are OpenCV's; SPZ is
//! converted. Any input gives Gaussians or a typed error, with memory bounded by a constant multiple of what a file of
//! its size can hold.

mod export;
mod format;
mod import;
mod ply;
mod splat;
mod spz;

use std::io;
use std::path::Path;

use atsplat_files::{FileError, Writer};
use atsplat_numeric::logit;

pub use export::ExportReport;
pub use format::{EXTENSIONS, Encoding, Format, Output};
pub use import::{ImportReport, SUSPICIOUS_COLOURS, SUSPICIOUS_LOG_SCALES, SUSPICIOUS_OPACITIES, interpret};

use crate::sh::C0;
use crate::{Cleaning, GaussianParts, Gaussians, LOGIT_OF_INFINITY, SplatError};

/// Contents of a file, as a format's reader returns them.
struct Stored {
    parts: GaussianParts,
    format: Format,
    unused: Vec<String>,
    integers: Vec<String>,
    antialiased: Option<bool>,
}

/// Reads a file of Gaussians.
///
/// # Errors
/// [`SplatError::Io`]; otherwise as [`parse`].
pub fn read(path: &Path) -> Result<(Gaussians, ImportReport), SplatError> {
    parse(&read_bytes(path)?, path)
}

/// Parses the bytes of a file; `path` names it in errors, and its extension identifies `.splat`, which has no magic
/// bytes.
///
/// # Errors
/// [`SplatError::Format`] for an unknown format or a malformed file, including bytes after the last row that a PLY
/// header declares; [`SplatError::LfsPointer`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<(Gaussians, ImportReport), SplatError> {
    parse_cleaned(bytes, path, Cleaning::Import)
}

/// As [`parse`], but with [`Cleaning::Reject`] Gaussians with infinite logits are rejected instead of repaired.
pub(crate) fn parse_cleaned(
    bytes: &[u8],
    path: &Path,
    policy: Cleaning,
) -> Result<(Gaussians, ImportReport), SplatError> {
    if atsplat_files::is_lfs_pointer(bytes) {
        return Err(SplatError::LfsPointer { path: path.to_owned() });
    }
    let Stored { parts, format, unused, integers, antialiased } =
        read_stored(bytes, path).map_err(|malformed| malformed.in_file(path))?;
    let is_ply = matches!(format, Format::Ply(_));
    let policy = if policy == Cleaning::Reject { policy } else { Cleaning::Import };
    let (gaussians, validation) = Gaussians::new(parts)?.into_cleaned(policy);
    let GaussianParts { opacity_logits, log_scales, sh_degree, sh, .. } = gaussians.parts();
    let may_be_suspicious = is_ply && !gaussians.is_empty();
    let is_opacity = |logit: &f32| (0.0..=1.0).contains(logit);
    let opacities_look_linear = may_be_suspicious && opacity_logits.iter().all(is_opacity);
    let is_scale = |log_scale: &f32| *log_scale > 0.0 && *log_scale <= 1.0;
    let scales_look_linear = may_be_suspicious && log_scales.as_flattened().iter().all(is_scale);
    let is_colour = |coefficient: &f32| (0.0..=1.0).contains(coefficient);
    let differ = |colours: &[f32]| colours.windows(2).any(|pair| matches!(pair, [a, b] if a.to_bits() != b.to_bits()));
    let harmonics_look_like_colours =
        may_be_suspicious && *sh_degree == 0 && sh.as_flattened().iter().all(is_colour) && differ(sh.as_flattened());
    let import = ImportReport {
        format,
        validation,
        unused,
        antialiased,
        opacities_look_linear,
        scales_look_linear,
        harmonics_look_like_colours,
        integers,
    };
    Ok((gaussians, import))
}

fn read_stored(bytes: &[u8], path: &Path) -> Result<Stored, Malformed> {
    let is_splat = path.extension().is_some_and(|found| found.eq_ignore_ascii_case(Format::Splat.extension()));
    // Rows may begin with the first bytes of gzip's header, but not with all of it: no coordinate is so small.
    let is_gzip = if is_splat { spz::is_gzip(bytes) } else { bytes.starts_with(&spz::GZIP_MAGIC) };
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        ply::read(bytes)
    } else if is_gzip || bytes.starts_with(&spz::MAGIC) {
        spz::read(bytes)
    } else if is_splat {
        splat::read(bytes)
    } else {
        let start = bytes.get(..8).unwrap_or(bytes).escape_ascii();
        let advice =
            convertible(bytes, path).map(|format| format!(": {format}, which splat-transform converts to PLY"));
        let found = format!("\"{start}\"{}", advice.unwrap_or_default());
        Err(Malformed::new("first bytes", "a PLY, SPZ or .splat file", found))
    }
}

/// What a file seems to be that is not read, but by playcanvas/splat-transform.
fn convertible(bytes: &[u8], path: &Path) -> Option<&'static str> {
    const ZIP: &[u8] = b"PK\x03\x04";
    const META: &[u8] = b"meta.json";
    let has_extension = |extension: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension));
    // PyTorch's checkpoints and NumPy's .npz are ZIP archives too.
    let is_archive = || bytes.starts_with(ZIP) && bytes.windows(META.len()).any(|name| name == META);
    let is_sog = has_extension("sog") || path.file_name().is_some_and(|name| name == "meta.json") || is_archive();
    let is_ksplat = has_extension("ksplat");
    is_sog.then_some("PlayCanvas' SOG").or_else(|| is_ksplat.then_some("a .ksplat file"))
}

/// Writes Gaussians to a file, which appears when it is complete; returns what the format's ranges changed.
///
/// # Errors
/// [`SplatError::Format`] if the format cannot store the Gaussians, [`SplatError::Io`].
pub fn write(path: &Path, gaussians: &Gaussians, output: Output) -> Result<ExportReport, SplatError> {
    let parts = gaussians.parts();
    match output {
        Output::Ply(encoding) => {
            write_file(path, |out| ply::write(parts, encoding, out))?;
            Ok(ExportReport::default())
        }
        Output::Spz2 { antialiased } => write_spz(path, parts, 2, antialiased),
        Output::Spz3 { antialiased } => write_spz(path, parts, 3, antialiased),
    }
}

fn write_spz(path: &Path, parts: &GaussianParts, version: u32, antialiased: bool) -> Result<ExportReport, SplatError> {
    let (payload, export) = spz::encode(parts, version, antialiased).map_err(|malformed| malformed.in_file(path))?;
    write_file(path, |out| spz::compress(&payload, out))?;
    Ok(export)
}

/// All bytes of a regular file.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, SplatError> {
    atsplat_files::read(path).map_err(FileError::during("reading Gaussians", path))
}

/// Writes a file that appears under its name when it is complete.
fn write_file(path: &Path, contents: impl FnOnce(&mut Writer) -> io::Result<()>) -> Result<(), SplatError> {
    atsplat_files::write_with(path, contents).map_err(FileError::during("writing Gaussians", path))
}

/// A malformed file, before its path is added.
#[derive(Debug)]
struct Malformed {
    location: String,
    expected: String,
    found: String,
}

impl Malformed {
    fn new(location: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self { location: location.into(), expected: expected.into(), found: found.into() }
    }

    fn in_file(self, path: &Path) -> SplatError {
        let Self { location, expected, found } = self;
        SplatError::Format { path: path.to_owned(), location, expected, found }
    }
}

/// The SH coefficient of degree 0 that gives a colour.
#[expect(clippy::cast_possible_truncation, reason = "coefficients are stored as f32")]
fn dc(colour: f64) -> f32 {
    ((colour - 0.5) / C0) as f32
}

/// The logit of a stored opacity in [0, 1]; finite at both ends, which are valid.
fn finite_logit(opacity: f64) -> f32 {
    logit(opacity).clamp(-LOGIT_OF_INFINITY, LOGIT_OF_INFINITY)
}

/// A unit quaternion from the index of its largest component, which is not stored, and the other three.
fn with_largest_component(index: u32, [a, b, c]: [f64; 3]) -> [f64; 4] {
    let largest = missing_component([a, b, c]);
    match index {
        0 => [largest, a, b, c],
        1 => [a, largest, b, c],
        2 => [a, b, largest, c],
        _ => [a, b, c, largest],
    }
}

/// The component of a unit quaternion that is not stored; ≥ 0.
fn missing_component(others: [f64; 3]) -> f64 {
    let squared = 1.0 - others.iter().map(|component| component * component).sum::<f64>();
    if squared > 0.0 { squared.sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_that_can_be_converted_are_named() {
        let found = |bytes: &[u8], name: &str| read_stored(bytes, Path::new(name)).err().unwrap().found;
        let cases: [(&[u8], &str, &str); 4] = [
            (b"PK\x03\x04\x14\0\0\0\x08", "scene.sog", "PlayCanvas' SOG"),
            (b"PK\x03\x04\x14\0meta.json{", "scene.ply", "PlayCanvas' SOG"),
            (b"{\"count\": 3}", "scene/meta.json", "PlayCanvas' SOG"),
            (b"\0\x01\0\0", "scene.KSPLAT", "a .ksplat file"),
        ];
        for (bytes, name, format) in cases {
            let advice = format!("\": {format}, which splat-transform converts to PLY");
            let found = found(bytes, name);
            assert!(found.ends_with(&advice), "{name}: {found}");
        }
        assert_eq!(found(b"GIF89a", "scene.ply"), "\"GIF89a\"");
        assert_eq!(found(b"PK\x03\x04\0\0archive/data.pkl", "chkpnt30000.pth"), "\"PK\\x03\\x04\\x00\\x00ar\"");
        assert_eq!(found(b"{}", "cameras.json"), "\"{}\"");
    }
}
