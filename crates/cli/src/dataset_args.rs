use std::path::{Path, PathBuf};

use atsplat_scene::{ColmapOptions, Dataset, NerfstudioOptions, OpenOptions, PictureFolder, Re10kOptions, Warnings};

/// A dataset and where its pictures are.
#[derive(Debug, clap::Args)]
pub(crate) struct DatasetArgs {
    /// RE10K trajectories, `.torch` chunks, a `transforms.json`, a COLMAP model, or a folder of them.
    pub(crate) data: PathBuf,

    #[command(flatten)]
    pictures: PictureArgs,
}

/// Where a dataset's pictures are, for commands whose dataset is an argument named `data`.
#[derive(Debug, clap::Args)]
pub(crate) struct PictureArgs {
    /// Which copy of a capture's pictures: 1 for `images`, 2, 4 or 8 for `images_2` … (nerfstudio, COLMAP).
    #[arg(long, value_name = "N", requires = "data", value_parser = clap::value_parser!(u32).range(1..=64))]
    images: Option<u32>,

    /// Folder of the frames, if they are not next to the poses (RE10K, COLMAP).
    #[arg(long, value_name = "PATH", requires = "data")]
    frames: Option<PathBuf>,

    /// Use DL3DV's undistorted `gaussian_splat/` in scenes that have it.
    #[arg(long, requires = "data")]
    prefer_undistorted: bool,
}

impl DatasetArgs {
    /// Opens the dataset; its format is detected.
    pub(crate) fn open(&self, warnings: &mut Warnings) -> anyhow::Result<Dataset> {
        self.pictures.open(&self.data, warnings)
    }
}

impl PictureArgs {
    /// Opens the dataset at `path`; its format is detected.
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
