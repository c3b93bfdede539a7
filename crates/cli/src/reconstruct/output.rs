//! The file of Gaussians.

use std::path::{Path, PathBuf};

use atsplat_splat::Gaussians;
use atsplat_splat::files::{self, Encoding, Output};
use serde::Serialize;

use super::FrameArg;

/// Format of the scene file, by its extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SceneFormat {
    Ply,
    Spz,
}

/// What was written.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct OutputRecord {
    pub(super) file: PathBuf,
    format: Output,
    /// Coordinate frame of the Gaussians.
    pub(super) frame: FrameArg,
    pub(super) gaussians: usize,
    pub(super) sh_degree: u8,
}

impl SceneFormat {
    pub(super) fn of_path(path: &Path) -> Result<Self, String> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("ply") => Ok(Self::Ply),
            Some("spz") => Ok(Self::Spz),
            _ => Err(format!("expected a file that ends in .ply or .spz, found {}", path.display())),
        }
    }
}

/// Parses `--out`.
pub(super) fn path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    SceneFormat::of_path(&path)?;
    Ok(path)
}

/// `scene.ply.json`: listed next to its scene, and not the name of any dataset's file.
pub(super) fn record_path(out: &Path) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(".json");
    PathBuf::from(name)
}

/// Writes Gaussians that are given in this frame.
pub(super) fn write(
    path: &Path,
    gaussians: &Gaussians,
    format: SceneFormat,
    frame: FrameArg,
) -> anyhow::Result<OutputRecord> {
    let format = match format {
        SceneFormat::Ply => Output::Ply(Encoding::BinaryLittleEndian),
        SceneFormat::Spz => Output::Spz3 { antialiased: false },
    };
    files::write(path, gaussians, format)?;
    Ok(OutputRecord {
        file: path.to_owned(),
        format,
        frame,
        gaussians: gaussians.len(),
        sh_degree: gaussians.sh_degree(),
    })
}
