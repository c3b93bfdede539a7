//! Scene files of reconstructions.

use std::path::{Path, PathBuf};

use atsplat_splat::files::{self, Output};
use atsplat_splat::{Gaussians, SplatError};
use serde::Serialize;

use crate::GaussianFrame;

/// What was written.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct OutputRecord {
    /// The scene file.
    pub file: PathBuf,
    format: Output,
    /// World frame of the Gaussians.
    pub frame: GaussianFrame,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Degree of their spherical harmonics.
    pub sh_degree: u8,
}

/// Writes Gaussians that are given in this frame; also says which values the format's ranges changed.
///
/// # Errors
/// Those of [`files::write`].
pub fn write_gaussians(
    path: &Path,
    gaussians: &Gaussians,
    format: Output,
    frame: GaussianFrame,
) -> Result<(OutputRecord, Vec<String>), SplatError> {
    let clamped = files::write(path, gaussians, format)?.warnings();
    let (file, sh_degree) = (path.to_owned(), gaussians.sh_degree());
    Ok((OutputRecord { file, format, frame, gaussians: gaussians.len(), sh_degree }, clamped))
}

#[cfg(test)]
mod tests {
    use atsplat_splat::GaussianParts;

    use super::*;

    #[test]
    fn values_that_only_spz_clamps_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let gaussians = Gaussians::new(GaussianParts {
            means: vec![[0.5; 3]],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-11.0, -3.0, -3.0]],
            opacity_logits: vec![2.0],
            sh_degree: 0,
            sh: vec![[0.25; 3]],
            scalars: None,
            filter_3d: None,
        })
        .unwrap();
        let clamped = |name: &str| {
            let path = folder.path().join(name);
            write_gaussians(&path, &gaussians, Output::of_path(&path).unwrap(), GaussianFrame::Dataset).unwrap().1
        };
        assert_eq!(clamped("scene.spz"), ["log-scales clamped to SPZ's range [-10, 5.9375]: 1"]);
        assert!(clamped("scene.ply").is_empty());
    }
}
