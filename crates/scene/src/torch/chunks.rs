use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use indexmap::IndexMap;
use rayon::prelude::*;

use super::{Chunk, INDEX, STAGES, is_named_chunk};
use crate::checks::ignored::Collections;
use crate::files::{files_in, read_file};
use crate::json;
use crate::{Scene, SceneError, TimestampSource, WarningKind, Warnings};

const FORMAT: &str = "torch chunks";

/// A folder of `.torch` chunks, with or without an `index.json` from scene keys to chunks (`real_estate_10k_tools`
/// `src/generate_index.py`).
///
/// Scenes are in pixelSplat's order: by chunk file name, then in the chunk's order. The last few chunks stay parsed, so that
/// loading scenes in this order parses each chunk once.
#[derive(Debug)]
pub struct TorchChunks {
    folder: PathBuf,
    chunks: Vec<PathBuf>,
    keys: Vec<String>,
    /// Position in `chunks`, by key.
    chunk_of: HashMap<String, usize>,
    /// Whether what is wrong with the chunks was reported when they were listed.
    reported: bool,
    recent: Mutex<ChunkCache>,
}

/// A chunk, and what is wrong with it apart from its scenes.
#[derive(Debug)]
struct ParsedChunk {
    chunk: Chunk,
    problems: Warnings,
}

impl TorchChunks {
    /// Finds the scenes under `path`: a chunk, a folder of chunks, or a dataset whose chunks are in `test` (preferred,
    /// because this toolkit evaluates) or `train`. An `index.json` next to these folders that names no existing file is not
    /// theirs, and is not read if they contain chunks.
    ///
    /// Every chunk's list is read, but no images. The published loaders, too, go through all scenes of all chunks: scenes
    /// that the `index.json` does not list are read with a warning, and a scene that several chunks have is read from the one
    /// that the index says, or else from the first. Chunks that cannot be read and scenes of the index that are in no chunk are
    /// skipped with a warning. Next to an index without scenes, which an interrupted export leaves, no chunk is read.
    ///
    /// # Errors
    /// [`SceneError::Io`] if the folder cannot be listed, [`SceneError::Malformed`] if there are no chunks, or
    /// `index.json` is invalid or refers to another folder; for a single chunk, those of [`Chunk::open`].
    pub fn open(path: impl AsRef<Path>, warnings: &mut Warnings) -> Result<Self, SceneError> {
        Self::open_by(path.as_ref(), true, warnings)
    }

    /// Like [`Self::open`] for chunks that are not here yet: only the scenes of the `index.json` are read, if there is one, and each
    /// chunk when a scene of it is loaded. A scene that the index lists in another chunk, or in none, such as one without a key, is
    /// reported whenever the first listed scene of its chunk is loaded: warnings depend on which scenes are loaded, not on
    /// their order.
    pub(crate) fn open_by_index(path: &Path, warnings: &mut Warnings) -> Result<Self, SceneError> {
        Self::open_by(path, false, warnings)
    }

    fn open_by(path: &Path, reads_all: bool, warnings: &mut Warnings) -> Result<Self, SceneError> {
        if path.is_file() {
            let chunk = Chunk::open(path, warnings)?;
            let keys = chunk.keys().iter().map(|key| (key.clone(), 0)).collect();
            return Ok(Self::new(path.to_owned(), vec![path.to_owned()], keys, true));
        }
        let folder = stage(path)?;
        let found = chunks_in(&folder)?;
        let path = folder.join(INDEX);
        if !path.is_file() {
            return Ok(Self::scanned(folder, found, &IndexMap::new(), warnings));
        }
        let index = chunks_by_key(&folder, &path)?;
        if !reads_all || index.is_empty() {
            return Ok(Self::indexed(folder, index, &found, warnings));
        }
        // An index may name chunks in folders below.
        let named = index.values().filter(|chunk| chunk.is_file()).cloned();
        let chunks: BTreeSet<PathBuf> = found.into_iter().chain(named).collect();
        let source = Self::scanned(folder, chunks.into_iter().collect(), &index, warnings);
        source.compare_with(&index, warnings);
        Ok(source)
    }

    /// What [`Self::open_by_index`] reads in a folder: the indices that decide where its chunks are, or every chunk of a folder
    /// without one. No file need be here yet.
    pub(crate) fn read_to_open(path: &Path) -> Result<Vec<PathBuf>, SceneError> {
        let mut files = Vec::new();
        for folder in stages(path) {
            let (index, chunks) = (folder.join(INDEX), chunks_in(&folder)?);
            let (has_index, has_chunks) = (index.is_file(), !chunks.is_empty());
            files.extend(if has_index { vec![index] } else { chunks });
            if has_chunks {
                break;
            }
        }
        Ok(files)
    }

    /// The opened folder, and that of the chunks; scenes of other formats may be in both.
    pub(crate) fn collections(&self, opened: &Path) -> Collections {
        let stages = BTreeSet::from(STAGES.map(str::to_owned));
        [opened, &self.folder].into_iter().map(|folder| (folder.to_owned(), stages.clone())).collect()
    }

    fn new(folder: PathBuf, chunks: Vec<PathBuf>, scenes: Vec<(String, usize)>, reported: bool) -> Self {
        let keys = scenes.iter().map(|(key, _)| key.clone()).collect();
        let chunk_of = scenes.into_iter().collect();
        Self { folder, chunks, keys, chunk_of, reported, recent: Mutex::default() }
    }

    /// The scenes of an index, which has a chunk for each key.
    fn indexed(folder: PathBuf, index: IndexMap<String, PathBuf>, found: &[PathBuf], warnings: &mut Warnings) -> Self {
        let named: BTreeSet<PathBuf> = index.values().cloned().collect();
        let chunks: Vec<PathBuf> = named.into_iter().filter(|chunk| chunk.is_file()).collect();
        let hint = if index.is_empty() { " nor of another: was writing them interrupted?" } else { "" };
        for unindexed in found.iter().filter(|chunk| chunks.binary_search(chunk).is_err()) {
            let detail = format!("{INDEX} lists no scene of this chunk{hint}");
            warnings.push(WarningKind::UnindexedChunk, unindexed.display().to_string(), detail);
        }
        let mut scenes = Vec::with_capacity(index.len());
        for (key, chunk) in index {
            if let Ok(position) = chunks.binary_search(&chunk) {
                scenes.push((key, position));
            } else {
                let detail = format!("{INDEX} lists it in {}, which is missing", chunk.display());
                warnings.push(WarningKind::SceneNotFound, key, detail);
            }
        }
        // Stable: within a chunk the scenes keep the order of the index.
        scenes.sort_by_key(|(_, position)| *position);
        Self::new(folder, chunks, scenes, false)
    }

    /// The scenes of all chunks. An index says from which of several chunks a scene is read, and which scenes those chunks have that
    /// cannot be read.
    fn scanned(
        folder: PathBuf,
        chunks: Vec<PathBuf>,
        index: &IndexMap<String, PathBuf>,
        warnings: &mut Warnings,
    ) -> Self {
        let listed: Vec<(Result<Vec<String>, SceneError>, Warnings)> = chunks
            .par_iter()
            .map(|path| {
                let mut warnings = Warnings::new();
                let keys = Chunk::open(path, &mut warnings).map(|chunk| chunk.keys().to_vec());
                (keys, warnings)
            })
            .collect();
        let is_indexed_in = |key: &String, path: &PathBuf| index.get(key).is_some_and(|chunk| chunk == path);
        let of_chunks = listed.iter().zip(&chunks).filter_map(|((keys, _), path)| Some((keys.as_ref().ok()?, path)));
        let as_indexed = of_chunks.flat_map(|(keys, path)| keys.iter().filter(move |key| is_indexed_in(key, path)));
        let as_indexed: HashSet<String> = as_indexed.cloned().collect();
        let mut scenes: Vec<(String, usize)> = Vec::new();
        let mut seen = HashSet::new();
        for (position, ((keys, from_chunk), path)) in listed.into_iter().zip(&chunks).enumerate() {
            warnings.merge(from_chunk);
            let keys = keys.unwrap_or_else(|error| {
                let indexed: Vec<String> = index.keys().filter(|key| is_indexed_in(key, path)).cloned().collect();
                // The scenes of the index fail when they are loaded, unless an earlier chunk has all of them.
                if indexed.iter().all(|key| seen.contains(key)) {
                    warnings.push(WarningKind::UnreadableScene, path.display().to_string(), error.to_string());
                }
                indexed
            });
            for key in keys {
                let other = if as_indexed.contains(&key) && !is_indexed_in(&key, path) {
                    "the chunk that the index lists"
                } else if seen.insert(key.clone()) {
                    scenes.push((key, position));
                    continue;
                } else {
                    "an earlier chunk"
                };
                let detail = format!("{other} has the same key, so {} is not used", path.display());
                warnings.push(WarningKind::DuplicateScene, key, detail);
            }
        }
        Self::new(folder, chunks, scenes, true)
    }

    /// Warns of the scenes that an index does not list, and of those that are in no chunk.
    fn compare_with(&self, index: &IndexMap<String, PathBuf>, warnings: &mut Warnings) {
        for key in self.keys.iter().filter(|key| !index.contains_key(*key)) {
            let chunk = self.chunk_of.get(key).and_then(|position| self.chunks.get(*position));
            let chunk = chunk.map_or_else(String::new, |chunk| format!(" ({})", chunk.display()));
            let detail = format!("{INDEX} does not list it; it is read, as in the published loaders{chunk}");
            warnings.push(WarningKind::SceneBeyondIndex, key, detail);
        }
        for (key, chunk) in index.iter().filter(|(key, _)| !self.chunk_of.contains_key(*key)) {
            let why = if chunk.is_file() { "does not contain it" } else { "is missing" };
            let detail = format!("{INDEX} lists it in {}, which {why}", chunk.display());
            warnings.push(WarningKind::SceneNotFound, key, detail);
        }
    }

    /// The chunk files that contain scenes, in order.
    pub fn chunks(&self) -> &[PathBuf] {
        &self.chunks
    }

    /// The chunk of a scene.
    fn place_of(&self, key: &str) -> Result<(usize, &Path), SceneError> {
        let unknown = || SceneError::unknown_scene(key, &self.folder);
        let position = *self.chunk_of.get(key).ok_or_else(unknown)?;
        let path = self.chunks.get(position).ok_or_else(unknown)?;
        Ok((position, path))
    }

    fn chunk(&self, position: usize, path: &Path) -> Result<Arc<ParsedChunk>, SceneError> {
        if let Some(chunk) = self.recent.lock().unwrap_or_else(PoisonError::into_inner).get(position) {
            return Ok(chunk);
        }
        // Parsed outside the lock: two threads may parse the same chunk, which costs less than waiting.
        let mut from_chunk = Warnings::new();
        let chunk = Chunk::open(path, &mut from_chunk)?;
        // No index lists an entry without a key.
        let mut problems = from_chunk.with_kind_as(WarningKind::UnreadableScene, WarningKind::UnindexedScene);
        for key in chunk.keys() {
            let (kind, problem) = match self.chunk_of.get(key) {
                Some(listed) if *listed == position => continue,
                Some(_) => (WarningKind::DuplicateScene, "lists it in another chunk: this one is not used"),
                None => (WarningKind::UnindexedScene, "does not list it for this chunk"),
            };
            problems.push(kind, key, format!("{INDEX} {problem} ({})", path.display()));
        }
        let parsed = Arc::new(ParsedChunk { chunk, problems });
        self.recent.lock().unwrap_or_else(PoisonError::into_inner).put(position, &parsed);
        Ok(parsed)
    }

    /// Whether no scene is listed before `key` in the chunk at `position`.
    fn is_first(&self, key: &str, position: usize) -> bool {
        let is_before = |other: &String| self.chunk_of.get(other).is_some_and(|chunk| *chunk < position);
        self.keys.get(self.keys.partition_point(is_before)).is_some_and(|first| first == key)
    }
}

impl crate::SceneReader for TorchChunks {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        self.place_of(key).map(|(_, path)| vec![path.to_owned()])
    }

    fn read(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let (position, path) = self.place_of(key)?;
        let parsed = self.chunk(position, path)?;
        if !self.reported && self.is_first(key, position) {
            warnings.merge(parsed.problems.clone());
        }
        let record = parsed.chunk.record(key)?;
        record.report_radial(warnings);
        record.to_scene(path)
    }

    /// Chunks of captures have the numbers in images' names in place of timestamps.
    fn times_of(&self, scene: &Scene) -> TimestampSource {
        let has_times = scene.has_times(TimestampSource::Given);
        if has_times { TimestampSource::Given } else { TimestampSource::FromNames }
    }
}

/// Cache of the most recently used chunks, the latest at the end.
#[derive(Debug, Default)]
struct ChunkCache {
    chunks: Vec<(usize, Arc<ParsedChunk>)>,
}

impl ChunkCache {
    /// Each is a mapped file and a list of scenes: enough for every thread to use another chunk.
    const CAPACITY: usize = 32;

    fn get(&mut self, position: usize) -> Option<Arc<ParsedChunk>> {
        let at = self.chunks.iter().position(|(cached, _)| *cached == position)?;
        let entry = self.chunks.remove(at);
        let chunk = Arc::clone(&entry.1);
        self.chunks.push(entry);
        Some(chunk)
    }

    fn put(&mut self, position: usize, chunk: &Arc<ParsedChunk>) {
        if self.get(position).is_none() {
            if self.chunks.len() >= Self::CAPACITY {
                self.chunks.remove(0);
            }
            self.chunks.push((position, Arc::clone(chunk)));
        }
    }
}

/// The folders that may contain chunks, in order of preference.
pub(super) fn stages(root: &Path) -> impl Iterator<Item = PathBuf> {
    let below = STAGES.map(|name| root.join(name)).into_iter().filter(|folder| folder.is_dir());
    std::iter::once(root.to_owned()).chain(below)
}

/// The chunk of each key of an index in `folder`.
fn chunks_by_key(folder: &Path, index: &Path) -> Result<IndexMap<String, PathBuf>, SceneError> {
    let mut chunks = IndexMap::new();
    for (key, name) in read_index(index)? {
        let chunk = inside(folder, &name).ok_or_else(|| {
            let (location, found) = (format!("key {key:?}"), format!("{name:?}"));
            SceneError::malformed(FORMAT, index, location, "the name of a chunk in this folder", found)
        })?;
        chunks.insert(key, chunk);
    }
    Ok(chunks)
}

/// The folder that contains chunks: `root`, its `test`, or its `train`; the first that has an index if none does.
fn stage(root: &Path) -> Result<PathBuf, SceneError> {
    for folder in stages(root) {
        if !chunks_in(&folder)?.is_empty() || indexes_a_file(&folder)? {
            return Ok(folder);
        }
    }
    stages(root).find(|folder| folder.join(INDEX).is_file()).ok_or_else(|| {
        let expected = format!("*.torch or {INDEX} in the folder, its test or its train");
        SceneError::malformed(FORMAT, root, "folder", expected, "neither")
    })
}

/// Whether a folder has an index that names an existing file. Other JSON, such as an evaluation index, does not count.
fn indexes_a_file(folder: &Path) -> Result<bool, SceneError> {
    let index = folder.join(INDEX);
    if !index.is_file() {
        return Ok(false);
    }
    match read_index(&index) {
        Ok(chunks) => Ok(chunks.values().filter_map(|chunk| inside(folder, chunk)).any(|chunk| chunk.is_file())),
        Err(SceneError::Malformed(_)) => Ok(false),
        Err(error) => Err(error),
    }
}

/// The `.torch` files of a folder, sorted by name. Folders may be named like them.
pub(super) fn chunks_in(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    Ok(files_in(folder)?.into_iter().filter(|path| is_named_chunk(path)).collect())
}

fn read_index(path: &Path) -> Result<IndexMap<String, String>, SceneError> {
    let bytes = read_file("reading a chunk index", path)?;
    json::parse_object(&bytes).map_err(|source| {
        let location = format!("line {}, column {}", source.line(), source.column());
        let (expected, found) = json::problem(&bytes, &source, "an object of scene keys with chunk names");
        SceneError::malformed(FORMAT, path, location, expected, found)
    })
}

/// `name` in `folder`; `None` if it leaves the folder.
fn inside(folder: &Path, name: &str) -> Option<PathBuf> {
    let relative = Path::new(name);
    let mut parts = relative.components().peekable();
    let stays = parts.peek().is_some() && parts.all(|part| matches!(part, Component::Normal(_)));
    let portable = !name.contains('\\');
    (stays && portable).then(|| folder.join(relative))
}
