//! Gaussians of a file with a record of their origin and cleaning, and readable summaries of both and of renders.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

use atsplat_files::Sha256Digest;
use serde::Serialize;

use crate::files::{self, Format};
use crate::{Cleaning, GaussianCounts, Gaussians, SplatError, Validation};

/// Origin of the Gaussians and how they were cleaned.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneFileRecord {
    /// The file.
    pub file: PathBuf,
    /// Its hash.
    pub sha256: Sha256Digest,
    /// Its length.
    pub bytes: u64,
    /// Its format.
    pub format: Format,
    /// Number of Gaussians after cleaning.
    pub gaussians: usize,
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
    /// Whether stored opacities were read as opacities, not logits.
    pub opacities_as_stored: bool,
    /// Problems found on import: NaN is removed, infinite opacity logits become ±20. With the policy [`Cleaning::Reject`], all
    /// Gaussians with problems are removed.
    pub import: Validation,
    /// Problems found by the policy after import, in rows of the file too.
    pub cleaning: CleaningRecord,
    /// Fields of the file that are not used.
    pub unused: Vec<String>,
    /// Whether the file was trained with antialiasing, if it says so.
    pub antialiased: Option<bool>,
}

/// Cleaning of the Gaussians after import.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct CleaningRecord {
    /// The policy.
    pub policy: Cleaning,
    /// Problems found.
    pub found: Validation,
}

/// Gaussians of a file.
#[derive(Debug)]
pub struct SceneFile {
    /// The Gaussians after cleaning.
    pub gaussians: Gaussians,
    /// Where they come from.
    pub record: SceneFileRecord,
    /// What a user should know.
    pub warnings: Vec<String>,
    /// Seconds of reading, hashing and cleaning.
    pub reading_secs: f64,
}

impl SceneFile {
    /// Reads, hashes and cleans the Gaussians of a file. [`Cleaning::Reject`] rejects infinite opacity logits of a PLY file too;
    /// the other formats store opacities, of which 0 and 1 are valid.
    ///
    /// # Errors
    /// [`SplatError`] if the file cannot be read or breaks its format; as [`files::interpret`].
    pub fn read(path: &Path, policy: Cleaning, opacities_as_stored: bool) -> Result<Self, SplatError> {
        let start = Instant::now();
        let contents = files::read_bytes(path)?;
        let (parsed, sha256) =
            rayon::join(|| files::parse_cleaned(&contents, path, policy), || Sha256Digest::of(&contents));
        let (gaussians, import) = parsed?;
        let (gaussians, mut notes) = files::interpret(gaussians, &import, opacities_as_stored, path)?;
        let (gaussians, mut found) = gaussians.into_cleaned(policy);
        // Both lists of problems have the rows of the file.
        for finding in &mut found.findings {
            finding.first = import.validation.position_before(finding.first);
        }
        if gaussians.is_empty() {
            notes.push("no Gaussian is left: images show the background".to_owned());
        }
        let record = SceneFileRecord {
            file: path.to_owned(),
            sha256,
            bytes: contents.len() as u64,
            format: import.format,
            gaussians: gaussians.len(),
            sh_degree: gaussians.sh_degree(),
            opacities_as_stored,
            import: import.validation,
            cleaning: CleaningRecord { policy, found },
            unused: import.unused,
            antialiased: import.antialiased,
        };
        Ok(SceneFile { gaussians, record, warnings: notes, reading_secs: start.elapsed().as_secs_f64() })
    }
}

/// Count, degree, format and problems of the Gaussians.
impl fmt::Display for SceneFileRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} Gaussians of degree {}, {}, {} bytes",
            self.gaussians, self.sh_degree, self.format, self.bytes
        )?;
        problems(f, "on import", &self.import)?;
        problems(f, "after import", &self.cleaning.found)?;
        if !self.unused.is_empty() {
            writeln!(f, "unused fields of the file: {}", self.unused.join(", "))?;
        }
        Ok(())
    }
}

fn problems(f: &mut fmt::Formatter<'_>, when: &str, found: &Validation) -> fmt::Result {
    if found.is_clean() {
        return Ok(());
    }
    let Validation { invalid, rejected, repaired, .. } = found;
    write!(f, "{invalid} Gaussians with problems {when}: {rejected} removed, {repaired} repaired")?;
    match invalid.saturating_sub(rejected + repaired) {
        0 => writeln!(f)?,
        kept => writeln!(f, ", {kept} kept as they are")?,
    }
    for finding in &found.findings {
        write!(f, "{:>12}  ", finding.count)?;
        finding.field.serialize(&mut *f)?;
        f.write_str(": ")?;
        finding.problem.serialize(&mut *f)?;
        writeln!(f, ", first at {}", finding.first)?;
    }
    Ok(())
}

/// Mean counts over rendered frames, each of which counts every Gaussian of the scene once.
#[derive(Clone, Copy, Debug)]
pub struct GaussianCountsTable {
    /// Counts over all frames.
    pub counts: GaussianCounts,
    /// Number of Gaussians in the scene.
    pub gaussians: usize,
}

impl fmt::Display for GaussianCountsTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { counts, gaussians } = *self;
        let (all, GaussianCounts { drawn, invalid, outside_depth, faint, outside_image }) = (counts.total(), counts);
        if all == 0 {
            return Ok(());
        }
        writeln!(f, "\n{:>12}  Gaussians per frame", "")?;
        let rows = [
            (drawn, "drawn"),
            (outside_image, "outside the image"),
            (outside_depth, "in front of the near plane or beyond the far plane"),
            (faint, "too faint everywhere"),
            (invalid, "with a value that is not finite or too large"),
        ];
        for (count, what) in rows {
            let share = count as f64 / all as f64;
            let (mean, share) = (share * gaussians as f64, 100.0 * share);
            writeln!(f, "{mean:>12.1}  {share:>5.1} %  {what}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GaussianParts;
    use crate::files::Output;

    fn parts(opacity_logits: Vec<f32>, log_scale: f32) -> GaussianParts {
        let count = opacity_logits.len();
        GaussianParts {
            means: (0..count).map(|at| [at as f32, 0.0, 2.0]).collect(),
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; count],
            log_scales: vec![[log_scale, 0.5, 1.0]; count],
            opacity_logits,
            sh: vec![[0.5; 3]; count],
            ..GaussianParts::default()
        }
    }

    /// In ASCII, with logits as they are: the writer replaces infinite ones.
    fn ply(parts: &GaussianParts) -> String {
        let names = "x y z rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 opacity f_dc_0 f_dc_1 f_dc_2";
        let properties: String = names.split(' ').flat_map(|name| ["property float ", name, "\n"]).collect();
        let rows = parts.means.iter().zip(&parts.log_scales).zip(&parts.opacity_logits);
        let row = |(([x, y, z], [s0, s1, s2]), logit): ((&[f32; 3], &[f32; 3]), &f32)| {
            format!("{x} {y} {z} 1 0 0 0 {s0} {s1} {s2} {logit} 0 0 0\n")
        };
        let rows = rows.map(row).collect::<Vec<_>>().concat();
        format!("ply\nformat ascii 1.0\nelement vertex {}\n{properties}end_header\n{rows}", parts.means.len())
    }

    #[test]
    fn rejecting_leaves_no_infinite_logit_of_a_ply_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.ply");
        let infinities = parts(vec![2.0, f32::INFINITY, -1.0, f32::NEG_INFINITY, f32::NAN, 100.0], -3.0);
        std::fs::write(&path, ply(&infinities)).unwrap();
        let of = |policy| {
            let SceneFile { gaussians, record, .. } = SceneFile::read(&path, policy, false).unwrap();
            let (import, found) = (record.import, record.cleaning.found);
            assert_eq!(gaussians.len() + import.rejected + found.rejected, 6, "{policy:?}");
            (gaussians.parts().opacity_logits.clone(), import.rejected, import.repaired)
        };
        assert_eq!(of(Cleaning::Import), (vec![2.0, 20.0, -1.0, -20.0, 100.0], 1, 2));
        assert_eq!(of(Cleaning::Repair), (vec![2.0, 20.0, -1.0, -20.0, 20.0], 1, 2));
        assert_eq!(of(Cleaning::Reject), (vec![2.0, -1.0], 4, 0));
    }

    /// Row 1 is removed on import, so that row 3 is the third of those that are left.
    #[test]
    fn problems_after_import_have_the_rows_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.ply");
        let mut broken = parts(vec![2.0, f32::NAN, 1.0, 100.0, 1.0], -3.0);
        broken.means[0][1] = f32::INFINITY;
        std::fs::write(&path, ply(&broken)).unwrap();
        let text = SceneFile::read(&path, Cleaning::Import, false).unwrap().record.to_string();
        for expected in [
            "3 Gaussians with problems on import: 1 removed, 0 repaired, 2 kept as they are\n",
            "2 Gaussians with problems after import: 0 removed, 0 repaired, 2 kept as they are\n",
        ] {
            assert!(text.contains(expected), "{text}");
        }
        assert_eq!(text.matches("means: infinite, first at 0\n").count(), 2, "{text}");
        assert_eq!(text.matches("opacity-logits: out-of-range, first at 3\n").count(), 2, "{text}");
    }

    /// An opacity of 1 is a byte like any other.
    #[test]
    fn rejecting_keeps_the_opaque_gaussians_of_quantised_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.spz");
        let opaque = Gaussians::new(parts(vec![2.0, f32::INFINITY], -3.0)).unwrap();
        files::write(&path, &opaque, Output::Spz3 { antialiased: false }).unwrap();
        for policy in [Cleaning::Import, Cleaning::Repair, Cleaning::Reject] {
            let scene = SceneFile::read(&path, policy, false).unwrap();
            assert_eq!((scene.gaussians.len(), scene.gaussians.parts().opacity_logits[1]), (2, 20.0), "{policy:?}");
            let text = scene.record.to_string();
            assert!(!text.contains("problems"), "{policy:?}: {text}");
        }
    }

    #[test]
    fn scales_that_may_have_no_logarithm_are_warned_of() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.ply");
        let warnings = |log_scale: f32| {
            std::fs::write(&path, ply(&parts(vec![2.0, 3.0], log_scale))).unwrap();
            SceneFile::read(&path, Cleaning::Import, false).unwrap().warnings
        };
        let expected = "every log-scale of the file lies in (0, 1]: they may be scales without their logarithm";
        assert_eq!(warnings(0.01), [expected]);
        for log_scale in [0.0, -0.01, 1.01] {
            assert_eq!(warnings(log_scale), [""; 0], "{log_scale}");
        }
    }
}
