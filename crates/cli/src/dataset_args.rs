use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_scene::{
    ColmapOptions, Dataset, Fetch, Format, NerfstudioOptions, OpenOptions, PictureFolder, Re10kOptions, Warnings,
};

use crate::objects::{CacheArgs, RemoteData};
use crate::parse::usage_error;

/// A dataset and where its pictures are.
#[derive(Debug, clap::Args)]
pub(crate) struct DatasetArgs {
    /// RE10K trajectories, `.torch` chunks, a `transforms.json`, a COLMAP model, or a folder of them; also as a URL (s3://, gs://,
    /// az://).
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

    #[command(flatten)]
    pub(crate) cache: CacheArgs,
}

impl DatasetArgs {
    /// Opens the dataset; its format is detected.
    pub(crate) fn open(&self, warnings: &mut Warnings) -> anyhow::Result<Dataset> {
        self.pictures.open(&self.data, warnings)
    }
}

impl PictureArgs {
    /// Opens the dataset at a path or URL; its format is detected.
    pub(crate) fn open(&self, path: &Path, warnings: &mut Warnings) -> anyhow::Result<Dataset> {
        self.open_at(path, self.cache.dataset(path)?.as_ref(), warnings)
    }

    /// Opens the dataset at `path`, or at the URL that was listed.
    pub(crate) fn open_at(
        &self,
        path: &Path,
        remote: Option<&Arc<RemoteData>>,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Dataset> {
        if let Some(url) = self.frames.as_deref().and_then(atsplat_objects::url) {
            anyhow::bail!("--frames: expected a folder of this machine, found {url}");
        }
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
            fetch: remote.map(|remote| Arc::clone(remote) as Arc<dyn Fetch>),
        };
        let path = remote.map_or(path, |remote| remote.path());
        let dataset = atsplat_scene::open_with(path, &options, warnings)?;
        self.check(Some(dataset.format)).map_err(usage_error)?;
        Ok(dataset)
    }

    /// Refuses arguments that datasets of this format do not read; `None` is the output of `atsplat render`.
    pub(crate) fn check(&self, format: Option<Format>) -> Result<(), String> {
        let (is_re10k, is_colmap) = (format == Some(Format::Re10k), format == Some(Format::Colmap));
        let is_nerfstudio = format == Some(Format::Nerfstudio);
        let rendered = || "the output of `atsplat render`".to_owned();
        let found = || format.map_or_else(rendered, |format| format!("a dataset in the format {format}"));
        for (name, given, is_read, what) in [
            ("--images", self.images.is_some(), is_nerfstudio || is_colmap, "captures of nerfstudio or COLMAP"),
            ("--frames", self.frames.is_some(), is_re10k || is_colmap, "RE10K trajectories or a COLMAP model"),
            ("--prefer-undistorted", self.prefer_undistorted, is_nerfstudio, "captures of nerfstudio or DL3DV"),
        ] {
            if given && !is_read {
                return Err(format!("{name}: expected {what}, found {}", found()));
            }
        }
        Ok(())
    }
}
