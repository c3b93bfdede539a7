use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_camera::ImageSize;
use atsplat_scene::{Dataset, Fetch, Format, ImageOptions, OpenOptions, Warnings};

use crate::objects::{CacheArgs, RemoteData};
use crate::parse::usage_error;

/// A dataset and where its images are.
#[derive(Debug, clap::Args)]
pub(crate) struct DatasetArgs {
    #[arg(help = data_help())]
    pub(crate) data: PathBuf,

    #[command(flatten)]
    images: ImageArgs,
}

/// Where a dataset's images are, for commands whose dataset is an argument named `data`.
#[derive(Debug, clap::Args)]
pub(crate) struct ImageArgs {
    /// Which copy of a capture's images: 1 for `images`, 2, 4 or 8 for `images_2` … (nerfstudio, COLMAP).
    #[arg(long, value_name = "N", requires = "data", value_parser = clap::value_parser!(u32).range(1..=64))]
    images: Option<u32>,

    /// Folder of the frames, if they are not next to the poses (RE10K, COLMAP).
    #[arg(long, value_name = "PATH", requires = "data")]
    frames: Option<PathBuf>,

    /// Use DL3DV's undistorted `gaussian_splat/` in scenes that have it; an error if none does.
    #[arg(long, requires = "data")]
    prefer_undistorted: bool,

    #[command(flatten)]
    pub(crate) cache: CacheArgs,
}

fn data_help() -> String {
    format!("{}, or a folder of them; also as a URL (s3://, gs://, az://)", Format::all_data())
}

/// The help of an argument for photos with cameras.
pub(crate) fn photos_help() -> String {
    let record = "the `render.json` that `atsplat render` wrote next to its images";
    format!("Posed photos: {}, or a folder of them; also {record}", Format::all_data())
}

impl DatasetArgs {
    /// Opens the dataset; its format is detected.
    pub(crate) fn open(&self, warnings: &mut Warnings) -> anyhow::Result<Dataset> {
        self.images.open(&self.data, warnings)
    }
}

impl ImageArgs {
    /// The same arguments for another copy of a capture's images.
    pub(crate) fn with_images(&self, factor: u32) -> Self {
        let (frames, cache) = (self.frames.clone(), self.cache.clone());
        Self { images: Some(factor), frames, prefer_undistorted: self.prefer_undistorted, cache }
    }

    /// Opens the dataset at a path or URL; its format is detected.
    pub(crate) fn open(&self, path: &Path, warnings: &mut Warnings) -> anyhow::Result<Dataset> {
        self.open_for(path, None, warnings)
    }

    /// As [`Self::open`], for images of this size: see [`Self::open_at`].
    pub(crate) fn open_for(
        &self,
        path: &Path,
        expected_size: Option<ImageSize>,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Dataset> {
        self.open_at(path, self.cache.dataset(path)?.as_ref(), expected_size, warnings)
    }

    /// Opens the dataset at `path`, or at the URL that was listed. Of several copies of a scene's images, the one of `expected_size` is
    /// used if the scene lacks the folder that it lists; not in object storage.
    pub(crate) fn open_at(
        &self,
        path: &Path,
        remote: Option<&Arc<RemoteData>>,
        expected_size: Option<ImageSize>,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Dataset> {
        let fetch = remote.map(|remote| Arc::clone(remote) as Arc<dyn Fetch>);
        let mut options = OpenOptions { fetch, ..self.options().open_options() };
        // Which images of object storage are here depends on what was fetched before.
        options.nerfstudio.expected_size = expected_size.filter(|_| remote.is_none());
        let path = remote.map_or(path, |remote| remote.path());
        let dataset = atsplat_scene::open_with(path, &options, warnings)?;
        self.check(Some(dataset.format))?;
        Ok(dataset)
    }

    /// Rejects arguments that datasets of this format do not read; `None` is the output of `atsplat render`.
    pub(crate) fn check(&self, format: Option<Format>) -> Result<(), clap::Error> {
        self.options().check(format).map_err(|unread| usage_error(format!("--{unread}")))
    }

    fn options(&self) -> ImageOptions {
        let (images, frames) = (self.images, self.frames.clone());
        ImageOptions { images, frames, prefer_undistorted: self.prefer_undistorted }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_of_data_names_every_format() {
        let command = <DatasetArgs as clap::Args>::augment_args(clap::Command::new("inspect"));
        let data = command.get_arguments().find(|argument| argument.get_id() == "data").unwrap();
        for help in [data.get_help().unwrap().to_string(), photos_help()] {
            assert!(Format::ALL.iter().all(|format| help.contains(format.data())), "{help}");
        }
    }
}
