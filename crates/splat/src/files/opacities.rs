use std::fmt;
use std::path::Path;

use super::{Encoding, Format, ImportReport, SUSPICIOUS_OPACITIES};
use crate::{Gaussians, SplatError};

/// The Gaussians that were read from a file, and what may be stored in it in another way than it was read, in words. With
/// `opacities_as_stored`, a PLY file contains opacities where others contain logits, as pixelSplat's and NoPoSplat's exporters
/// write it; opacities outside [0, 1] become NaN, with a warning.
///
/// # Errors
/// [`SplatError::Format`] for `opacities_as_stored` with the formats that store opacities by definition: their readers have
/// made logits of them.
pub fn interpret(
    gaussians: Gaussians,
    import: &ImportReport,
    opacities_as_stored: bool,
    path: &Path,
) -> Result<(Gaussians, Vec<String>), SplatError> {
    let mut warnings = Vec::new();
    let gaussians = if opacities_as_stored {
        let (converted, warning) = converted(&gaussians, import, path)?;
        warnings.extend(warning);
        converted
    } else {
        if import.opacities_look_linear {
            let advice = "see --opacities-as-stored, in Python opacities_as_stored=True";
            warnings.push(format!("{SUSPICIOUS_OPACITIES}: they may not be logits; {advice}"));
        }
        gaussians
    };
    warnings.extend(import.suspicions());
    Ok((gaussians, warnings))
}

fn converted(
    gaussians: &Gaussians,
    import: &ImportReport,
    path: &Path,
) -> Result<(Gaussians, Option<String>), SplatError> {
    if !matches!(import.format, Format::Ply(_)) {
        return Err(SplatError::Format {
            path: path.to_owned(),
            location: "opacities as stored".to_owned(),
            expected: "a PLY file without logits".to_owned(),
            found: format!("{}, which stores opacities anyway; leave this option out", import.format),
        });
    }
    let stored = &gaussians.parts().opacity_logits;
    let outside = stored.iter().filter(|opacity| !(0.0..=1.0).contains(*opacity)).count();
    let all = stored.len();
    let warning = format!("{outside} of {all} stored opacities are outside [0, 1] and become NaN: they may be logits");
    Ok((gaussians.with_linear_opacities(), (outside > 0).then_some(warning)))
}

impl Format {
    /// The extension of its files, one of [`EXTENSIONS`](super::EXTENSIONS).
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
    use crate::files::{EXTENSIONS, Output, read, write};
    use crate::{Field, Problem};

    #[test]
    fn formats_that_store_opacities_are_rejected() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/files");
        for (name, format) in [
            ("compressed_degree1.ply", "compressed PLY"),
            ("version1.spz", "SPZ 1"),
            ("version2.spz", "SPZ 2"),
            ("version3.spz", "SPZ 3"),
            ("version4.spz", "SPZ 4"),
            ("rows.splat", ".splat"),
        ] {
            let path = fixtures.join(name);
            let (gaussians, import) = read(&path).unwrap();
            assert_eq!(path.extension().unwrap(), import.format.extension());
            assert!(EXTENSIONS.contains(&import.format.extension()), "{name}");
            let error = interpret(gaussians, &import, true, &path).unwrap_err().to_string();
            let expected = format!("found {format}, which stores opacities anyway; leave this option out");
            assert!(error.contains(name) && error.ends_with(&expected), "{error}");
        }
    }

    #[test]
    fn opacities_of_ply_files_are_converted_and_logits_warned_of() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/files");
        let (gaussians, _) = read(&fixtures.join("degree1_ascii.ply")).unwrap();
        let mut parts = gaussians.select(&[0, 0, 0]).unwrap().into_parts();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.ply");
        for (stored, lost, warning) in [
            ([0.75, 0.0, 1.0], 0, None),
            (
                [0.75, 1.5, -0.25],
                2,
                Some("2 of 3 stored opacities are outside [0, 1] and become NaN: they may be logits"),
            ),
        ] {
            parts.opacity_logits = stored.to_vec();
            let output = Output::Ply(Encoding::BinaryLittleEndian);
            write(&path, &Gaussians::new(parts.clone()).unwrap(), output).unwrap();
            let (kept, import) = read(&path).unwrap();
            let (converted, found) = interpret(kept.clone(), &import, true, &path).unwrap();
            assert_eq!(found, warning.as_slice());
            assert_eq!(converted.validate().count(Field::OpacityLogits, Problem::NotANumber), lost);
            assert_eq!(converted.parts().opacity_logits.first(), Some(&3.0f32.ln()));
            let (unchanged, found) = interpret(kept.clone(), &import, false, &path).unwrap();
            assert_eq!(unchanged, kept);
            assert_eq!(
                found.iter().filter(|text| text.starts_with(SUSPICIOUS_OPACITIES)).count(),
                usize::from(lost == 0)
            );
        }
    }
}
