mod unrecognized;

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_files::FileError;

use crate::checks::ignored::report_ignored;
use crate::fetch::image_files;
use crate::files::read_start;
use crate::format::{Format, PROBE};
use crate::nerfstudio::AppliedTransform;
use crate::{
    ColmapOptions, Fetch, NerfstudioOptions, Re10kOptions, SceneError, SceneReader, SceneSource, TimestampSource,
    Warnings,
};

/// The formats in the order in which they are tried: the first that recognises a folder reads it. A `transforms.json` is before the
/// COLMAP model that it was made from, and which stays next to it. Trajectories are last, because other formats have `.txt` files too.
const TRIED: [Format; Format::ALL.len()] = [Format::TorchChunks, Format::Nerfstudio, Format::Colmap, Format::Re10k];

/// Options of all formats; those of the detected one apply.
#[derive(Clone, Debug, Default)]
pub struct OpenOptions {
    /// For [`Format::Re10k`].
    pub re10k: Re10kOptions,
    /// For [`Format::Nerfstudio`].
    pub nerfstudio: NerfstudioOptions,
    /// For [`Format::Colmap`].
    pub colmap: ColmapOptions,
    /// For a dataset whose files are empty on this disk until they are fetched.
    pub fetch: Option<Arc<dyn Fetch>>,
}

impl OpenOptions {
    fn fetch(&self, action: &'static str, dataset: &Path, paths: &[PathBuf]) -> Result<(), FileError> {
        fetch(self.fetch.as_deref(), action, dataset, paths)
    }
}

fn fetch(
    fetcher: Option<&dyn Fetch>,
    action: &'static str,
    dataset: &Path,
    paths: &[PathBuf],
) -> Result<(), FileError> {
    fetcher.map_or(Ok(()), |fetcher| fetcher.fetch(paths)).map_err(FileError::during(action, dataset))
}

/// An open dataset of a detected format.
pub struct Dataset {
    /// The detected format.
    pub format: Format,
    /// The path that was opened.
    pub path: PathBuf,
    scenes: Box<dyn SceneReader>,
    fetch: Option<Arc<dyn Fetch>>,
}

impl fmt::Debug for Dataset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Dataset({}, {} scenes, {})", self.format, self.scenes.keys().len(), self.path.display())
    }
}

impl SceneSource for Dataset {
    fn keys(&self) -> &[String] {
        self.scenes.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<crate::Scene, SceneError> {
        tracing::debug!(scene = key, "loading");
        if self.fetch.is_none() {
            return self.scenes.load(key, warnings);
        }
        let fetch = |paths: &[PathBuf]| fetch(self.fetch.as_deref(), "fetching a scene", &self.path, paths);
        fetch(&self.scenes.files(key)?)?;
        fetch(&self.scenes.images_for_sizes(key)?)?;
        let scene = self.scenes.load(key, warnings)?;
        fetch(&image_files(&scene))?;
        Ok(scene)
    }

    fn times(&self) -> TimestampSource {
        self.scenes.times()
    }

    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        self.scenes.files(key)
    }

    fn images_for_sizes(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        self.scenes.images_for_sizes(key)
    }

    fn check_fetched(&self) -> Result<(), FileError> {
        fetch(self.fetch.as_deref(), "fetching a scene", &self.path, &[])
    }

    fn applied_transform(&self, key: &str) -> Result<Option<AppliedTransform>, SceneError> {
        if self.fetch.is_some() {
            let files = self.scenes.files(key)?;
            fetch(self.fetch.as_deref(), "fetching a scene", &self.path, &files)?;
        }
        self.scenes.applied_transform(key)
    }
}

/// Opens a file or folder as a dataset, with default options.
///
/// # Errors
/// Those of [`open_with`].
pub fn open(path: impl AsRef<Path>, warnings: &mut Warnings) -> Result<Dataset, SceneError> {
    open_with(path, &OpenOptions::default(), warnings)
}

/// Opens a file or folder as a dataset.
///
/// The format is detected from content, not from the name: of a file by its first bytes, of JSON by its keys, of a folder by the
/// files that the format requires. If a folder has the files of several, the order is chunks, `transforms.json`, a COLMAP model,
/// trajectories; scenes of the others, and images without cameras, are counted as [`WarningKind::IgnoredScene`]. No
/// scene is read; of chunks, their lists of scenes are, or the index alone if they are still to be fetched.
///
/// [`WarningKind::IgnoredScene`]: crate::WarningKind::IgnoredScene
///
/// # Errors
/// [`SceneError::Io`]; [`SceneError::Unrecognized`] if no format matches: it says what is missing of a COLMAP model, or
/// names the datasets one folder below.
pub fn open_with(
    path: impl AsRef<Path>,
    options: &OpenOptions,
    warnings: &mut Warnings,
) -> Result<Dataset, SceneError> {
    let path = path.as_ref();
    std::fs::metadata(path).map_err(SceneError::io("opening a dataset", path))?;
    let start = if path.is_dir() {
        None
    } else {
        options.fetch("fetching a dataset", path, &[path.to_owned()])?;
        Some(read_start("opening a dataset", path, PROBE)?)
    };
    for format in TRIED {
        let reader = format.reader();
        if options.fetch.is_some() && start.is_none() {
            options.fetch("fetching a dataset", path, &(reader.read_to_open)(path)?)?;
        }
        let found = match &start {
            Some(start) => (reader.path_of_file)(path, start),
            None => (reader.is_folder_of_format)(path)?.then(|| path.to_owned()),
        };
        let Some(found) = found else { continue };
        let (scenes, collections) = (reader.open)(&found, options, warnings)?;
        if start.is_none() {
            report_ignored(&collections, format, scenes.keys(), options.fetch.is_some(), warnings)?;
        }
        tracing::info!(path = %path.display(), %format, scenes = scenes.keys().len(), "opened dataset");
        return Ok(Dataset { format, path: path.to_owned(), scenes, fetch: options.fetch.clone() });
    }
    let content = match start {
        Some(start) => unrecognized::content_of_file(path, &start),
        None => unrecognized::content_of_folder(path)?,
    };
    Err(SceneError::unrecognized(path, Format::all_data(), content))
}

#[cfg(test)]
mod tests;
