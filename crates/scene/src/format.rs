use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::checks::ignored::Collections;
use crate::{OpenOptions, SceneError, SceneReader, Warnings, colmap, nerfstudio, re10k, torch};

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
    /// `transforms.json` of nerfstudio, DL3DV, `ScanNet++`, instant-ngp or Blender's synthetic scenes.
    Nerfstudio,
    /// A COLMAP sparse model, text or binary.
    Colmap,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::Re10k, Self::TorchChunks, Self::Nerfstudio, Self::Colmap];

    /// Stable name for reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Re10k => "re10k",
            Self::TorchChunks => "torch-chunks",
            Self::Nerfstudio => "nerfstudio",
            Self::Colmap => "colmap",
        }
    }

    /// Its data in messages: `RE10K trajectories`, `a COLMAP model`.
    pub fn data(self) -> &'static str {
        self.reader().data
    }

    /// The [data](Self::data) of all formats: `RE10K trajectories, .torch chunks, a transforms.json or a COLMAP model`.
    pub fn all_data() -> String {
        let [others @ .., last] = Self::ALL.map(Self::data);
        format!("{} or {last}", others.join(", "))
    }

    /// Whether scenes are captures: structure from motion need not place all of their images, and numbers in images' names, which the
    /// cameras of a rig share, are no timestamps.
    pub fn is_of_captures(self) -> bool {
        self.reader().is_of_captures
    }

    /// Whether datasets of this format read cameras, points or chunks from a file because of its name. Images may have any name
    /// ([`is_image_name`](crate::is_image_name)), and a file that is opened itself as well.
    pub fn reads_file(self, path: &Path) -> bool {
        (self.reader().reads_file)(path)
    }

    pub(crate) fn reader(self) -> &'static FormatReader {
        match self {
            Self::Re10k => &re10k::READER,
            Self::TorchChunks => &torch::READER,
            Self::Nerfstudio => &nerfstudio::READER,
            Self::Colmap => &colmap::READER,
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Facts about one format, and how it is detected and opened.
pub(crate) struct FormatReader {
    /// [`Format::data`].
    pub(crate) data: &'static str,
    /// What makes a folder with this name a scene, for messages.
    pub(crate) required: fn(&str) -> String,
    pub(crate) images: ImagePlace,
    /// What a folder without a whole scene has of one, except images.
    pub(crate) part_of_scene: fn(&Path) -> Option<String>,
    /// [`Format::is_of_captures`].
    pub(crate) is_of_captures: bool,
    /// The names of the [`ImageOptions`](crate::ImageOptions) that are read.
    pub(crate) image_options: &'static [&'static str],
    /// [`Format::reads_file`].
    pub(crate) reads_file: fn(&Path) -> bool,
    /// The path to open for a file with these first bytes; `None` if the file is not of this format.
    pub(crate) path_of_file: fn(&Path, &[u8]) -> Option<PathBuf>,
    pub(crate) is_folder_of_format: fn(&Path) -> Result<bool, SceneError>,
    /// Files whose content decides whether a folder is of this format, or is read when it is opened.
    pub(crate) read_to_open: fn(&Path) -> Result<Vec<PathBuf>, SceneError>,
    pub(crate) open: fn(&Path, &OpenOptions, &mut Warnings) -> Result<Opened, SceneError>,
}

/// Where the images of a scene are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ImagePlace {
    /// In the file of the cameras.
    WithCameras,
    /// In `images/` or a scaled copy of it, in the scene's folder.
    Images,
    /// There, or directly in the scene's folder.
    FolderOrImages,
}

/// The scenes of a dataset, and the folders that they are in.
pub(crate) type Opened = (Box<dyn SceneReader>, Collections);

#[cfg(test)]
mod tests {
    use super::*;

    /// In this crate's documentation, the page about data and Python's.
    #[test]
    fn every_format_is_named_where_they_are_listed_by_hand() {
        for (text, list) in [
            (include_str!("lib.rs"), "Dataset readers:"),
            (include_str!("../../../docs/protocols.md"), "- **Formats**:"),
            (include_str!("../../python/python/atsplat/protocols.py"), "Opens a dataset; its format is detected."),
        ] {
            let (_, listed) = text.split_once(list).unwrap();
            let listed: String = listed.chars().take(300).filter(|letter| *letter != '`').collect();
            let listed: Vec<&str> = listed.split_whitespace().filter(|word| *word != "//!").collect();
            let listed = listed.join(" ");
            for format in Format::ALL {
                let data = format.data().trim_start_matches("a ");
                assert!(listed.contains(data), "{data}: {listed}");
            }
        }
    }
}
