use std::io::Write;
use std::path::{Path, PathBuf};

use atsplat_files::create_folder;
use atsplat_pixels::ImageFormat;
use indexmap::IndexMap;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::pickle_writer::PickleWriter;
use super::rounding::require_kept_trajectory;
use super::{ChunkScene, INDEX, TorchError, is_named_chunk};
use crate::{SceneError, SceneSource, WarningKind, Warnings};

/// PyTorch's alignment of storages, so that they can be used from a mapped file.
const ALIGNMENT: u16 = 64;

/// Writes scenes as numbered chunks and an `index.json`, like `real_estate_10k_tools` (`src/convert.py`,
/// `src/generate_index.py`), for pixelSplat's loader and its descendants.
///
/// A chunk is written when its images reach the target size; a scene is never split. Files are renamed into place
/// when complete, and the same scenes give the same bytes. Until the last chunk is written, the index is empty, so that
/// what an interrupted writer leaves is not read as a whole dataset.
#[derive(Debug)]
pub struct ChunkWriter {
    folder: PathBuf,
    target_bytes: u64,
    pending: Vec<ChunkScene>,
    pending_bytes: u64,
    chunks: usize,
    index: IndexMap<String, String>,
}

/// The result of a [`ChunkWriter`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChunksWritten {
    /// Chunk files, in order.
    pub chunks: Vec<PathBuf>,
    /// Number of scenes in them.
    pub scenes: usize,
}

impl ChunkWriter {
    /// Bytes of images after which a chunk is written, for RE10K (`real_estate_10k_tools` `src/convert.py:17`).
    /// DepthSplat's DL3DV chunks use twice as much (`src/scripts/convert_dl3dv_test.py:44`). The original tools measure a
    /// scene's folder with `du -b`, which adds 4096 bytes of the folder itself.
    pub const TARGET_BYTES: u64 = 100_000_000;

    /// Starts writing to a folder, which is created if necessary.
    ///
    /// # Errors
    /// [`SceneError::Io`], and [`SceneError::Malformed`] if the folder already contains chunks, which would be read together
    /// with the new ones.
    pub fn create(folder: impl Into<PathBuf>, target_bytes: u64) -> Result<Self, SceneError> {
        let folder = folder.into();
        create_folder(&folder).map_err(SceneError::io("creating a folder for chunks", &folder))?;
        for entry in std::fs::read_dir(&folder).map_err(SceneError::io("listing chunks", &folder))? {
            let name = entry.map_err(SceneError::io("listing chunks", &folder))?.file_name();
            if is_named_chunk(name.as_ref()) || name == INDEX {
                let name = name.to_string_lossy();
                return Err(SceneError::malformed("torch chunks", &folder, "folder", "no chunks yet", name));
            }
        }
        Ok(Self { folder, target_bytes, pending: Vec::new(), pending_bytes: 0, chunks: 0, index: IndexMap::new() })
    }

    /// Adds a scene, and writes a chunk if it is full.
    ///
    /// # Errors
    /// [`SceneError::Torch`] if the scene's lengths differ, its key is repeated, an image is neither JPEG, PNG nor WebP,
    /// a camera overflows f32, or f32 moves one by more than a hundredth of the median distance between consecutive frames, as
    /// in georeferenced coordinates: the scene is skipped, and writing may continue. [`SceneError::Io`] if a chunk cannot be
    /// written.
    pub fn push(&mut self, scene: ChunkScene) -> Result<(), SceneError> {
        self.check(&scene).map_err(SceneError::torch(&self.folder))?;
        self.pending_bytes += scene.images.iter().map(|image| image.len() as u64).sum::<u64>();
        self.index.insert(scene.key.clone(), self.chunk_name());
        self.pending.push(scene);
        if self.pending_bytes >= self.target_bytes { self.flush() } else { Ok(()) }
    }

    /// Writes the last chunk and the index.
    ///
    /// # Errors
    /// Those of [`ChunkWriter::push`].
    pub fn finish(mut self) -> Result<ChunksWritten, SceneError> {
        if !self.pending.is_empty() {
            self.flush()?;
        }
        self.write_index(&self.index)?;
        let chunks = (0..self.chunks).map(|number| self.folder.join(name_of(number))).collect();
        Ok(ChunksWritten { chunks, scenes: self.index.len() })
    }

    fn chunk_name(&self) -> String {
        name_of(self.chunks)
    }

    fn write_index(&self, index: &IndexMap<String, String>) -> Result<(), SceneError> {
        let path = self.folder.join(INDEX);
        let json = serde_json::to_vec(index)
            .map_err(|source| SceneError::io("writing a chunk index", &path)(source.into()))?;
        atsplat_files::write(&path, &json).map_err(SceneError::io("writing a chunk index", &path))
    }

    fn flush(&mut self) -> Result<(), SceneError> {
        if self.chunks == 0 {
            self.write_index(&IndexMap::new())?;
        }
        write_chunk(&self.folder.join(self.chunk_name()), &self.pending)?;
        self.chunks += 1;
        self.pending.clear();
        self.pending_bytes = 0;
        Ok(())
    }

    fn check(&self, scene: &ChunkScene) -> Result<(), TorchError> {
        scene.require_equal_lengths()?;
        if self.index.contains_key(&scene.key) {
            return Err(TorchError::malformed(format!("scene {:?}", scene.key), "a unique key", "a repeated one"));
        }
        for (position, image) in scene.images.iter().enumerate() {
            image.verify()?;
            if !is_image(image) {
                let start = atsplat_files::hexadecimal(image.get(..8).unwrap_or(image));
                let location = format!("scene {:?}, field images[{position}]", scene.key);
                return Err(TorchError::malformed(location, "a JPEG, PNG or WebP file", format!("bytes {start}")));
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "checks whether it overflows")]
        let is_f32 = |number: &f64| (*number as f32).is_finite();
        match scene.cameras.iter().position(|row| !row.iter().all(is_f32)) {
            None => require_kept_trajectory(scene),
            Some(position) => {
                let location = format!("scene {:?}, field cameras[{position}]", scene.key);
                Err(TorchError::malformed(location, "numbers in the range of f32", "larger ones"))
            }
        }
    }
}

/// Writes one chunk and renames it into place.
///
/// # Errors
/// [`SceneError::Torch`] if a camera overflows f32, [`SceneError::Io`].
pub(super) fn write_chunk(path: &Path, scenes: &[ChunkScene]) -> Result<(), SceneError> {
    let (pickle, storages) = PickleWriter::chunk(scenes).map_err(SceneError::torch(path))?;
    let written = atsplat_files::write_with(path, |file| {
        let mut zip = ZipWriter::new(file);
        let mut entry = |name: &str, bytes: &[u8]| {
            zip.start_file(format!("archive/{name}"), zip_options(bytes.len()))?;
            zip.write_all(bytes)
        };
        entry("data.pkl", &pickle)?;
        entry("byteorder", b"little")?;
        for (key, storage) in storages.iter().enumerate() {
            entry(&format!("data/{key}"), storage)?;
        }
        entry("version", b"3\n")?;
        zip.finish()?.flush()
    });
    written.map_err(SceneError::io("writing a chunk", path))
}

/// Scenes of a dataset as chunks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportedChunks {
    /// The chunks of all scenes that are not skipped.
    pub written: ChunksWritten,
    /// Scenes that cannot be read or stored; they are in the warnings.
    pub skipped: u64,
}

/// Writes every scene of a dataset into chunks in `folder`, each full at `target_bytes` of images, calling `progress`
/// after each scene. If no scene can be read, not even an index is written.
///
/// # Errors
/// [`SceneError::Io`] if a scene cannot be fetched or a chunk cannot be written; the index of chunks written before is then empty.
pub fn export_chunks(
    source: &dyn SceneSource,
    folder: &Path,
    target_bytes: u64,
    warnings: &mut Warnings,
    progress: &dyn Fn(),
) -> Result<ExportedChunks, SceneError> {
    let mut writer = ChunkWriter::create(folder, target_bytes)?;
    let mut skipped = 0;
    for key in source.keys() {
        let loaded = source.load(key, warnings).and_then(|scene| ChunkScene::from_scene(&scene, warnings));
        let is_unreadable = loaded.is_err();
        let outcome = loaded.and_then(|scene| writer.push(scene));
        progress();
        match outcome {
            Ok(()) => {}
            Err(error) if is_unreadable || matches!(error, SceneError::Torch { .. }) => {
                source.check_fetched()?;
                skipped += 1;
                warnings.push(WarningKind::UnreadableScene, key, error.to_string());
            }
            Err(error) => return Err(error),
        }
    }
    if writer.index.is_empty() && skipped > 0 {
        return Ok(ExportedChunks { written: ChunksWritten { chunks: Vec::new(), scenes: 0 }, skipped });
    }
    Ok(ExportedChunks { written: writer.finish()?, skipped })
}

fn name_of(chunk: usize) -> String {
    format!("{chunk:06}.torch")
}

fn zip_options(len: usize) -> SimpleFileOptions {
    SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default())
        .unix_permissions(0o644)
        .large_file(u32::try_from(len).is_err())
        .with_alignment(ALIGNMENT)
}

/// Whether bytes are an image in a format that chunks contain.
fn is_image(bytes: &[u8]) -> bool {
    matches!(ImageFormat::sniff(bytes), Some(ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::WebP))
}
