use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use crate::colmap::{ColmapOptions, ColmapScenes, model_below, model_folders, part_of_model};
use crate::fetch::image_files;
use crate::files::{list, read_file, read_start};
use crate::ignored::{Collections, files_like_transforms, report_ignored};
use crate::json;
use crate::nerfstudio::{AppliedTransform, NerfstudioOptions, NerfstudioScenes, scene_files};
use crate::re10k::{Re10kOptions, Re10kScenes, read_trajectory, starts_like_a_trajectory, trajectory_files};
use crate::torch::TorchChunks;
use crate::{Fetch, SceneError, SceneSource, Warnings};

/// The supported formats, for messages.
const EXPECTED: &str = "RE10K trajectories, .torch chunks, a transforms.json or a COLMAP model";

/// Bytes read of a file to detect its format.
const PROBE: u64 = 1 << 16;

/// Text files that are read to find a trajectory, and folders that are searched for what to say of one without a dataset.
const PROBED: usize = 20;

/// Datasets below a folder that is none itself, in its error.
const DATASETS_NAMED: usize = 3;

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
    fn fetch(&self, action: &'static str, dataset: &Path, paths: &[PathBuf]) -> Result<(), SceneError> {
        fetch(self.fetch.as_deref(), action, dataset, paths)
    }
}

fn fetch(
    fetcher: Option<&dyn Fetch>,
    action: &'static str,
    dataset: &Path,
    paths: &[PathBuf],
) -> Result<(), SceneError> {
    fetcher.map_or(Ok(()), |fetcher| fetcher.fetch(paths)).map_err(SceneError::io(action, dataset))
}

/// An open dataset of a detected format.
pub struct Dataset {
    /// The detected format.
    pub format: Format,
    /// The path that was opened.
    pub path: PathBuf,
    source: Box<dyn SceneSource>,
    fetch: Option<Arc<dyn Fetch>>,
}

impl fmt::Debug for Dataset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Dataset({}, {} scenes, {})", self.format, self.source.keys().len(), self.path.display())
    }
}

impl SceneSource for Dataset {
    fn keys(&self) -> &[String] {
        self.source.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<crate::Scene, SceneError> {
        tracing::debug!(scene = key, "loading");
        if self.fetch.is_none() {
            return self.source.load(key, warnings);
        }
        let fetch = |paths: &[PathBuf]| fetch(self.fetch.as_deref(), "fetching a scene", &self.path, paths);
        fetch(&self.source.files(key)?)?;
        let scene = self.source.load(key, warnings)?;
        fetch(&image_files(&scene))?;
        Ok(scene)
    }

    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        self.source.files(key)
    }

    fn applied_transform(&self, key: &str) -> Result<Option<AppliedTransform>, SceneError> {
        if self.fetch.is_some() {
            let files = self.source.files(key)?;
            fetch(self.fetch.as_deref(), "fetching a scene", &self.path, &files)?;
        }
        self.source.applied_transform(key)
    }
}

/// Opens a file or folder as the dataset it holds, with default options.
///
/// # Errors
/// Those of [`open_with`].
pub fn open(path: impl AsRef<Path>, warnings: &mut Warnings) -> Result<Dataset, SceneError> {
    open_with(path, &OpenOptions::default(), warnings)
}

/// Opens a file or folder as the dataset it holds.
///
/// The format is detected from content, not from the name: of a file by its first bytes, of a folder by the files that
/// the format requires. If a folder holds several, the order is chunks, `transforms.json`, a COLMAP model,
/// trajectories; scenes of the others, and images without cameras, are counted as [`WarningKind::IgnoredScene`]. No
/// scene is read.
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
    for entry in REGISTRY {
        if options.fetch.is_some() && start.is_none() {
            options.fetch("fetching a dataset", path, &(entry.read_to_open)(path)?)?;
        }
        let place = match &start {
            Some(start) => (entry.file)(path, start),
            None => (entry.folder)(path)?.then(|| path.to_owned()),
        };
        if let Some(place) = place {
            let (source, collections) = (entry.open)(&place, options, warnings)?;
            if start.is_none() {
                report_ignored(&collections, entry.format, source.keys(), options.fetch.is_some(), warnings)?;
            }
            let scenes = source.keys().len();
            tracing::info!(path = %path.display(), format = %entry.format, scenes, "opened dataset");
            let (format, path, fetch) = (entry.format, path.to_owned(), options.fetch.clone());
            return Ok(Dataset { format, path, source, fetch });
        }
    }
    if let Some(content) = start.as_deref().filter(|start| is_json(start, b'[')).and_then(|_| json_content(path)) {
        return Err(SceneError::unrecognized(path, EXPECTED, content));
    }
    Err(SceneError::unrecognized(path, EXPECTED, what_is_there(path, start.is_some())?))
}

/// A description of a file or folder that is not a dataset: what is missing, or where a dataset is.
fn what_is_there(path: &Path, is_file: bool) -> Result<String, SceneError> {
    let kind = if is_file { "another kind of file" } else { "a folder without these" };
    let model = if is_file { folder_of_part(path) } else { Some(path.to_owned()) };
    let of_part =
        |(part, folder): (String, PathBuf)| format!("a part of a COLMAP model, {part} in {}", folder.display());
    if let Some(part) = model.as_deref().and_then(part_of_model) {
        return Ok(of_part(part));
    }
    let transforms = if is_file { Vec::new() } else { files_like_transforms(path) };
    if !transforms.is_empty() {
        return Ok(format!("{kind}, but with {}: give that file", transforms.join(" and ")));
    }
    let below = if is_file { Vec::new() } else { subfolders(path) };
    let holds_dataset = |folder: &PathBuf| {
        let holds = |entry: &Entry| (entry.folder)(folder).is_ok_and(|holds| holds);
        REGISTRY.iter().find(|entry| holds(entry)).map(|entry| format!("{} ({})", folder.display(), entry.format))
    };
    let datasets: Vec<String> = below.iter().filter_map(holds_dataset).take(DATASETS_NAMED).collect();
    if !datasets.is_empty() {
        return Ok(format!("{kind}, but with datasets below it: {}", datasets.join(", ")));
    }
    let model_in = |folder: &Path| Some(folder.join(model_below(folder)?));
    let own = Some(path).filter(|_| !is_file);
    if let Some(model) = own.into_iter().chain(below.iter().map(PathBuf::as_path)).find_map(model_in) {
        return Ok(format!("{kind}, but with a COLMAP model in {}: give that folder", model.display()));
    }
    if let Some(part) = below.iter().find_map(|capture| part_of_model(capture)) {
        return Ok(of_part(part));
    }
    let text = if is_file {
        Some(path.to_owned()).filter(|path| has_extension(path, "txt"))
    } else {
        trajectory_files(path)?.into_values().next()
    };
    let not_a_trajectory = text.and_then(|text| read_trajectory(&text).err());
    Ok(not_a_trajectory.map_or_else(|| kind.to_owned(), |error| format!("{kind}; {error}")))
}

/// The first folders in a folder, without hidden ones; none if it cannot be listed.
fn subfolders(path: &Path) -> Vec<PathBuf> {
    let entries = list(path).unwrap_or_default();
    let folders = entries.into_iter().filter(|(name, is_folder)| *is_folder && !name.starts_with('.'));
    folders.take(PROBED).map(|(name, _)| path.join(name)).collect()
}

/// How one format is detected and opened.
struct Entry {
    format: Format,
    /// The path to open, given a file and its first bytes; `None` if it is not of this format.
    file: fn(&Path, &[u8]) -> Option<PathBuf>,
    folder: fn(&Path) -> Result<bool, SceneError>,
    /// Files whose content decides whether a folder is of this format, or is read when it is opened.
    read_to_open: fn(&Path) -> Result<Vec<PathBuf>, SceneError>,
    open: Opener,
}

type Opener = fn(&Path, &OpenOptions, &mut Warnings) -> Result<(Box<dyn SceneSource>, Collections), SceneError>;

const REGISTRY: [Entry; 4] = [
    Entry {
        format: Format::TorchChunks,
        file: |path, start| is_chunk(start).then(|| path.to_owned()),
        folder: holds_chunks,
        read_to_open: |path| if holds_chunks(path)? { TorchChunks::read_to_open(path) } else { Ok(Vec::new()) },
        open: |path, _, warnings| {
            let source = TorchChunks::open(path, warnings)?;
            let collections = source.collections(path);
            Ok((Box::new(source), collections))
        },
    },
    Entry {
        format: Format::Nerfstudio,
        file: |path, start| is_json(start, b'{').then(|| path.to_owned()),
        folder: |path| Ok(!scene_files(path, false)?.is_empty()),
        read_to_open: |_| Ok(Vec::new()),
        open: |path, options, warnings| {
            let source = NerfstudioScenes::open(path, options.nerfstudio, warnings)?;
            let collections = source.collections().clone();
            Ok((Box::new(source), collections))
        },
    },
    Entry {
        format: Format::Colmap,
        file: |path, _| model_around(path),
        folder: |path| Ok(!model_folders(path)?.is_empty()),
        read_to_open: |_| Ok(Vec::new()),
        open: |path, options, _| {
            let source = ColmapScenes::open(path, options.colmap.clone())?;
            let collections = source.collections();
            Ok((Box::new(source), collections))
        },
    },
    Entry {
        format: Format::Re10k,
        file: |path, start| starts_like_a_trajectory(start).then(|| path.to_owned()),
        folder: holds_trajectories,
        read_to_open: |path| Ok(trajectory_files(path)?.into_values().take(PROBED).collect()),
        open: |path, options, warnings| {
            let source = Re10kScenes::open(path, options.re10k.clone(), warnings)?;
            let collections = source.collections();
            Ok((Box::new(source), collections))
        },
    },
];

/// Whether a file starts like a zip archive or with the magic number of `torch.save` before it wrote archives.
fn is_chunk(start: &[u8]) -> bool {
    const LEGACY_MAGIC: [u8; 14] = [0x80, 0x02, 0x8a, 0x0a, 0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];
    start.starts_with(b"PK\x03\x04") || start.starts_with(&LEGACY_MAGIC)
}

/// Whether there are chunks in the folder, or in its `test` or `train` (pixelSplat's layout).
fn holds_chunks(folder: &Path) -> Result<bool, SceneError> {
    for stage in ["", "test", "train"].map(|stage| folder.join(stage)) {
        let is_chunk = |name: &str| has_extension(Path::new(name), "torch");
        if stage.is_dir() && list(&stage)?.iter().any(|(name, is_folder)| !is_folder && is_chunk(name)) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found == extension)
}

/// Whether a file starts with this bracket, after an optional byte order mark.
fn is_json(start: &[u8], bracket: u8) -> bool {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    start.trim_ascii_start().first() == Some(&bracket)
}

/// A description of a JSON file; `None` if it is not valid JSON.
fn json_content(path: &Path) -> Option<String> {
    let value = json::parse(&read_file("opening a dataset", path).ok()?).ok()?;
    Some(json::describe(&value))
}

/// The folder of the COLMAP model that `file` belongs to.
fn model_around(file: &Path) -> Option<PathBuf> {
    folder_of_part(file).filter(|folder| model_folders(folder).is_ok_and(|models| !models.is_empty()))
}

/// The folder of a file that is named like one of a COLMAP model.
fn folder_of_part(file: &Path) -> Option<PathBuf> {
    let is_part = matches!(file.file_stem()?.to_str()?, "cameras" | "images" | "points3D");
    let folder = file.parent().filter(|folder| *folder != Path::new("")).unwrap_or_else(|| Path::new("."));
    is_part.then(|| folder.to_owned())
}

/// Whether one of the first text files in a folder is a trajectory; others may be a licence, for example.
fn holds_trajectories(folder: &Path) -> Result<bool, SceneError> {
    for file in trajectory_files(folder)?.values().take(PROBED) {
        if starts_like_a_trajectory(&read_start("opening a dataset", file, PROBE)?) {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests;
