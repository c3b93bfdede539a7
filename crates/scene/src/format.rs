use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::checks::ignored::Collections;
use crate::{OpenOptions, SceneError, SceneSource, Warnings};

/// Bytes read of a file to detect its format.
pub(crate) const PROBE: u64 = 1 << 16;

/// A dataset's format, detected from its content.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Format {
    /// RE10K trajectory text, one file or a folder, with or without frames.
    Re10k,
    /// pixelSplat's `.torch` chunks, one file or a folder.
    TorchChunks,
    /// `transforms.json` of nerfstudio, DL3DV, instant-ngp or Blender's synthetic scenes.
    Nerfstudio,
    /// A COLMAP sparse model, text or binary.
    Colmap,
}

impl Format {
    /// Stable name for reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Re10k => "re10k",
            Self::TorchChunks => "torch-chunks",
            Self::Nerfstudio => "nerfstudio",
            Self::Colmap => "colmap",
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// How one format is detected and opened.
pub(crate) struct FormatReader {
    pub(crate) format: Format,
    /// The path to open for a file with these first bytes; `None` if the file is not of this format.
    pub(crate) path_of_file: fn(&Path, &[u8]) -> Option<PathBuf>,
    pub(crate) is_folder_of_format: fn(&Path) -> Result<bool, SceneError>,
    /// Files whose content decides whether a folder is of this format, or is read when it is opened.
    pub(crate) read_to_open: fn(&Path) -> Result<Vec<PathBuf>, SceneError>,
    pub(crate) open: fn(&Path, &OpenOptions, &mut Warnings) -> Result<Opened, SceneError>,
}

/// The scenes of a dataset, and the folders that they are in.
pub(crate) type Opened = (Box<dyn SceneSource>, Collections);
