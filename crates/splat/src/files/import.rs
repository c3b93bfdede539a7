use std::path::Path;

use serde::Serialize;

use super::Format;
use crate::{Gaussians, SplatError, Validation};

/// How the suspicion of [`interpret`] about opacities begins.
pub const SUSPICIOUS_OPACITIES: &str = "every opacity of the file lies in [0, 1]";
/// How that of [`ImportReport::suspicions`] about scales begins.
pub const SUSPICIOUS_LOG_SCALES: &str = "every log-scale of the file lies in (0, 1]";
/// How that of [`ImportReport::suspicions`] about colours begins.
pub const SUSPICIOUS_COLOURS: &str = "every coefficient of the file lies in [0, 1]";

/// Report of reading a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ImportReport {
    /// The file's format.
    pub format: Format,
    /// Problems of the stored Gaussians; those with a NaN are dropped, infinite opacity logits become ±20
    /// ([`Cleaning::Import`](crate::Cleaning::Import)). Opacities of 0 and 1 are none in the formats that store opacities: their
    /// logits are ±20.
    pub validation: Validation,
    /// Ignored contents of the file: properties, elements, extensions.
    pub unused: Vec<String>,
    /// Whether the Gaussians were trained with anti-aliasing, if the file records it: an SPZ, or a PLY of Brush in a comment
    /// (`SplatRenderMode: mip`).
    pub antialiased: Option<bool>,
    /// Whether all opacity values of a PLY file are in [0, 1]: pixelSplat's and NoPoSplat's exporters write opacities
    /// where all others write logits, without marking the file. [`interpret`] converts them.
    pub opacities_look_linear: bool,
    /// Whether all log-scales of a PLY file are in (0, 1]: scenes have Gaussians below one unit of length, whose log-scales
    /// are negative, so that these may be scales without their logarithm.
    pub scales_look_linear: bool,
    /// Whether all coefficients of a PLY file without view dependence are in [0, 1], and are not all equal: as coefficients,
    /// they are samples from 0.5 to 0.78 alone, so that these may be colours themselves.
    pub harmonics_look_like_colours: bool,
    /// Properties of a PLY file that are integers, where 3DGS has floats, by type, as in "opacity is stored as uchar". They
    /// are read as they are, though they may stand for fractions of a range.
    pub integers: Vec<String>,
}

impl ImportReport {
    /// What may be stored in another way than it was read, in words. Opacities are not among it, because a caller may know
    /// how they are stored.
    pub fn suspicions(&self) -> Vec<String> {
        let scales = format!("{SUSPICIOUS_LOG_SCALES}: they may be scales without their logarithm");
        let colours = format!(
            "{SUSPICIOUS_COLOURS}, without view dependence: they may be colours, of which (colour - 0.5) / 0.282 is the coefficient"
        );
        let integer = |integer: &String| format!("{integer}: read as these integers, not as fractions of a range");
        self.scales_look_linear
            .then_some(scales)
            .into_iter()
            .chain(self.harmonics_look_like_colours.then_some(colours))
            .chain(self.integers.iter().map(integer))
            .collect()
    }
}

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
        let (converted, warning) = converted(gaussians, import, path)?;
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
    gaussians: Gaussians,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::{EXTENSIONS, Encoding, Output, read, write};
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
