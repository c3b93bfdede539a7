use std::path::{Path, PathBuf};

use anyhow::bail;
use atsplat_scene::{
    ColmapOptions, Dataset, NerfstudioOptions, OpenOptions, PictureFolder, Re10kOptions, SceneSource as _, Warnings,
};
use clap::Args;

/// Which dataset, and where its pictures are.
#[derive(Debug, Args)]
pub(crate) struct DatasetWords {
    /// RE10K trajectories, `.torch` chunks, a `transforms.json`, a COLMAP model, or a folder of them.
    pub(crate) data: PathBuf,

    #[command(flatten)]
    pictures: PictureWords,
}

/// Where a dataset's pictures are; for commands whose dataset is an argument named `data`.
#[derive(Debug, Args)]
pub(crate) struct PictureWords {
    /// Which copy of a capture's pictures: 1 for `images`, 2, 4 or 8 for `images_2` … (nerfstudio, COLMAP).
    #[arg(long, value_name = "N", requires = "data", value_parser = clap::value_parser!(u32).range(1..=64))]
    images: Option<u32>,

    /// Folder with the frames, where they are not beside the poses (RE10K, COLMAP).
    #[arg(long, value_name = "PATH", requires = "data")]
    frames: Option<PathBuf>,

    /// Take DL3DV's undistorted `gaussian_splat/` where a scene has it.
    #[arg(long, requires = "data")]
    prefer_undistorted: bool,
}

impl DatasetWords {
    /// Opens the dataset as its content tells.
    pub(crate) fn open(&self, warnings: &mut Warnings) -> anyhow::Result<Dataset> {
        self.pictures.open(&self.data, warnings)
    }
}

impl PictureWords {
    /// Opens the dataset at `path` as its content tells.
    pub(crate) fn open(&self, path: &Path, warnings: &mut Warnings) -> anyhow::Result<Dataset> {
        let pictures = match self.images {
            None => PictureFolder::default(),
            Some(1) => PictureFolder::Listed,
            Some(factor) => PictureFolder::Downscaled(factor),
        };
        let options = OpenOptions {
            re10k: Re10kOptions { frames_root: self.frames.clone() },
            nerfstudio: NerfstudioOptions {
                pictures,
                prefer_gaussian_splat: self.prefer_undistorted,
                ..NerfstudioOptions::default()
            },
            colmap: ColmapOptions { pictures, images_root: self.frames.clone() },
        };
        Ok(atsplat_scene::open_with(path, &options, warnings)?)
    }
}

/// The scene that is meant, where a dataset may hold several.
pub(crate) fn key_of<'a>(dataset: &'a Dataset, asked: Option<&'a str>) -> anyhow::Result<&'a str> {
    match (asked, dataset.keys()) {
        (Some(key), _) => Ok(key),
        (None, [only]) => Ok(only),
        (None, keys) => {
            let some: Vec<&str> = keys.iter().take(5).map(String::as_str).collect();
            let (path, count) = (dataset.path.display(), keys.len());
            bail!("{path} holds {count} scenes ({} …): say which with --key", some.join(", "))
        }
    }
}
