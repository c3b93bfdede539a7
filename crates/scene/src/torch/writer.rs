use std::io::Write;
use std::path::{Path, PathBuf};

use indexmap::IndexMap;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::pickle_writer::PickleWriter;
use super::{ChunkScene, TorchError};
use crate::SceneError;

const FORMAT: &str = "torch chunks";
/// PyTorch aligns storages so that they can be mapped and used in place.
const ALIGNMENT: u16 = 64;

/// Writes scenes into numbered chunks and an `index.json`, as `real_estate_10k_tools` does
/// (`src/convert.py`, `src/generate_index.py`): what pixelSplat's loader and its descendants read.
///
/// A chunk is written when its pictures reach the target size; a scene is never split. Each file appears
/// whole, under its final name, or not at all, and the same scenes give the same bytes.
#[derive(Debug)]
pub struct ChunkWriter {
    folder: PathBuf,
    target_bytes: u64,
    pending: Vec<ChunkScene>,
    pending_bytes: u64,
    chunks: usize,
    index: IndexMap<String, String>,
}

/// What a [`ChunkWriter`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChunksWritten {
    /// Chunk files, in order.
    pub chunks: Vec<PathBuf>,
    /// Number of scenes in them.
    pub scenes: usize,
}

impl ChunkWriter {
    /// Bytes of pictures after which a chunk is written, for RE10K (`real_estate_10k_tools`
    /// `src/convert.py:17`). DepthSplat's DL3DV chunks use twice as much
    /// (`src/scripts/convert_dl3dv_test.py:44`). The originals count a scene's folder with `du -b`, which
    /// adds the folder's own 4096 bytes.
    pub const TARGET_BYTES: u64 = 100_000_000;

    /// Starts writing into a folder, which is made if need be.
    ///
    /// # Errors
    /// [`SceneError::Io`], and [`SceneError::Malformed`] where the folder already holds chunks: old ones
    /// would be read together with new ones.
    pub fn create(folder: impl Into<PathBuf>, target_bytes: u64) -> Result<Self, SceneError> {
        let folder = folder.into();
        std::fs::create_dir_all(&folder).map_err(SceneError::io("making a folder for chunks", &folder))?;
        for entry in std::fs::read_dir(&folder).map_err(SceneError::io("listing chunks", &folder))? {
            let name = entry.map_err(SceneError::io("listing chunks", &folder))?.file_name();
            let name = name.to_string_lossy();
            if name.ends_with(".torch") || name == "index.json" {
                return Err(SceneError::Malformed {
                    format: FORMAT,
                    location: "folder".to_owned(),
                    expected: "no chunks yet".to_owned(),
                    found: name.into_owned(),
                    path: folder,
                });
            }
        }
        Ok(Self { folder, target_bytes, pending: Vec::new(), pending_bytes: 0, chunks: 0, index: IndexMap::new() })
    }

    /// Adds a scene, and writes a chunk when that fills one.
    ///
    /// # Errors
    /// [`SceneError::Torch`] where the scene's lengths differ, its key was used before, a picture is neither
    /// JPEG, PNG nor WebP, or a camera does not fit f32: the scene is left out and the next may follow.
    /// [`SceneError::Io`] where a chunk cannot be written.
    pub fn push(&mut self, scene: ChunkScene) -> Result<(), SceneError> {
        self.check(&scene).map_err(SceneError::torch(&self.folder))?;
        self.pending_bytes += scene.images.iter().map(|image| image.len() as u64).sum::<u64>();
        self.index.insert(scene.key.clone(), self.chunk_name());
        self.pending.push(scene);
        if self.pending_bytes >= self.target_bytes { self.flush() } else { Ok(()) }
    }

    /// Writes what is left, and the index.
    ///
    /// # Errors
    /// As [`ChunkWriter::push`].
    pub fn finish(mut self) -> Result<ChunksWritten, SceneError> {
        if !self.pending.is_empty() {
            self.flush()?;
        }
        let index = self.folder.join("index.json");
        let json = serde_json::to_vec(&self.index)
            .map_err(|source| SceneError::io("writing a chunk index", &index)(source.into()))?;
        atsplat_files::write(&index, &json).map_err(SceneError::io("writing a chunk index", &index))?;
        let chunks = (0..self.chunks).map(|number| self.folder.join(name_of(number))).collect();
        Ok(ChunksWritten { chunks, scenes: self.index.len() })
    }

    fn chunk_name(&self) -> String {
        name_of(self.chunks)
    }

    fn flush(&mut self) -> Result<(), SceneError> {
        write_chunk(&self.folder.join(self.chunk_name()), &self.pending)?;
        self.chunks += 1;
        self.pending.clear();
        self.pending_bytes = 0;
        Ok(())
    }

    fn check(&self, scene: &ChunkScene) -> Result<(), TorchError> {
        scene.require_equal_lengths()?;
        if self.index.contains_key(&scene.key) {
            return Err(TorchError::malformed(format!("scene {:?}", scene.key), "a key of its own", "a used one"));
        }
        for (position, image) in scene.images.iter().enumerate() {
            if !is_picture(image) {
                let shown: Vec<String> = image.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
                let location = format!("scene {:?}, field images[{position}]", scene.key);
                return Err(TorchError::malformed(location, "a JPEG, PNG or WebP file", shown.join(" ")));
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "whether it overflows is the question")]
        let is_f32 = |number: &f64| (*number as f32).is_finite();
        match scene.cameras.iter().position(|row| !row.iter().all(is_f32)) {
            None => Ok(()),
            Some(position) => {
                let location = format!("scene {:?}, field cameras[{position}]", scene.key);
                Err(TorchError::malformed(location, "numbers that f32 can hold", "larger ones"))
            }
        }
    }
}

/// Writes one chunk; the file appears under its name when it is whole.
///
/// # Errors
/// [`SceneError::Torch`] where a camera does not fit f32, [`SceneError::Io`].
pub(super) fn write_chunk(path: &Path, scenes: &[ChunkScene]) -> Result<(), SceneError> {
    let (pickle, storages) = PickleWriter::chunk(scenes).map_err(SceneError::torch(path))?;
    let written = atsplat_files::write_with(path, |file| {
        let mut zip = ZipWriter::new(file);
        let mut entry = |name: &str, bytes: &[u8]| {
            zip.start_file(format!("archive/{name}"), stored(bytes.len()))?;
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

fn name_of(chunk: usize) -> String {
    format!("{chunk:06}.torch")
}

fn stored(len: usize) -> SimpleFileOptions {
    SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default())
        .unix_permissions(0o644)
        .large_file(u32::try_from(len).is_err())
        .with_alignment(ALIGNMENT)
}

fn is_picture(bytes: &[u8]) -> bool {
    let is_webp = bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP");
    bytes.starts_with(b"\xff\xd8\xff") || bytes.starts_with(b"\x89PNG\r\n\x1a\n") || is_webp
}
