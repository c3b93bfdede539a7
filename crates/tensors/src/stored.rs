use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use atsplat_files::{FileError, Malformed, Sha256Digest};
use atsplat_pickle::{Dict, Key, SharedBytes, Tensor, Value, shortened};
use indexmap::IndexMap;
use sha2::{Digest, Sha256};

use crate::{StoredTensor, TensorError, TensorView, safetensors, write_safetensors};

const WHAT: &str = "checkpoint";
/// The formats of files.
const EXPECTED: &str = "a safetensors file, or one of torch.save";

/// Named tensors of a file of any origin.
#[derive(Clone, Debug, Default)]
pub struct StoredTensors {
    /// In the order of the file.
    pub tensors: IndexMap<String, StoredTensor>,
    /// Text metadata; only safetensors files have it.
    pub metadata: BTreeMap<String, String>,
}

/// A file of tensors, read but not interpreted.
#[derive(Clone, Debug)]
pub struct TensorFile {
    /// Path of the file.
    pub path: PathBuf,
    /// SHA-256 of the whole file.
    pub sha256: Sha256Digest,
    /// Its tensors and metadata.
    pub stored: StoredTensors,
}

impl TensorFile {
    /// Maps and reads a safetensors file or a checkpoint of `torch.save`, detected by its bytes.
    ///
    /// Hashing reads every byte once; tensors stay in the memory map.
    ///
    /// # Errors
    /// [`TensorError::Missing`] for a folder, [`TensorError::Io`], or [`TensorError::InFile`] around the errors of
    /// [`StoredTensors::parse`].
    pub fn open(path: &Path) -> Result<Self, TensorError> {
        Self::parse(path.to_owned(), mapped(path)?)
    }

    /// [`Self::open`] for bytes in memory; `path` is their name in messages.
    ///
    /// # Errors
    /// [`TensorError::InFile`] around the errors of [`StoredTensors::parse`].
    pub fn parse(path: PathBuf, bytes: SharedBytes) -> Result<Self, TensorError> {
        let sha256 = Sha256Digest::of(&bytes);
        let stored = StoredTensors::parse(bytes).map_err(|error| error.in_file(&path))?;
        tracing::debug!(file = %path.display(), tensors = stored.tensors.len(), %sha256, "read tensors");
        Ok(Self { path, sha256, stored })
    }

    /// [`Self::open`] for a file that users must provide: if it is absent, the error says with `expected` what it is and where
    /// to get it.
    ///
    /// # Errors
    /// [`TensorError::Missing`], and as [`Self::open`].
    pub fn find(path: &Path, expected: impl FnOnce() -> String) -> Result<Self, TensorError> {
        let found =
            Self::open(path).inspect(|file| tracing::info!(file = %path.display(), %file.sha256, "read weights"));
        found.map_err(|error| match error {
            TensorError::Io(error) if error.source.kind() == std::io::ErrorKind::NotFound => {
                TensorError::Missing { expected: expected(), path: path.to_owned() }
            }
            other => other,
        })
    }

    /// Checks the file's hash against an expected one, if any.
    ///
    /// # Errors
    /// [`TensorError::InFile`] around [`TensorError::Malformed`].
    pub fn check_sha256(&self, expected: Option<Sha256Digest>) -> Result<(), TensorError> {
        match expected.filter(|expected| *expected != self.sha256) {
            None => Ok(()),
            Some(expected) => {
                let expected = format!("a file of sha256 {expected}");
                let other = Malformed::new("weights", "file", expected, self.sha256);
                Err(TensorError::from(other).in_file(&self.path))
            }
        }
    }
}

/// The bytes of a file, in a memory map.
fn mapped(path: &Path) -> Result<SharedBytes, TensorError> {
    if path.is_dir() {
        // As training leaves them.
        let inside = path.join("weights.safetensors");
        let example = if inside.is_file() { format!(", such as {}", inside.display()) } else { String::new() };
        return Err(TensorError::Missing { expected: format!("a file{example}"), path: path.to_owned() });
    }
    atsplat_pickle::map(path).map_err(FileError::during("reading weights", path))
}

impl StoredTensors {
    /// [`TensorFile::open`] without the hash, so that only those tensors are read from the disk that are used.
    ///
    /// # Errors
    /// As [`TensorFile::open`].
    pub fn open(path: &Path) -> Result<Self, TensorError> {
        Self::parse(mapped(path)?).map_err(|error| error.in_file(path))
    }

    /// Reads a safetensors file, or a checkpoint of `torch.save` in either of its formats.
    ///
    /// A checkpoint's tensors are named by their path from the root, with keys of dicts and lists joined by dots; other
    /// objects are skipped. A training checkpoint therefore gives `state_dict.encoder…` and `optimizer.state…`: key maps
    /// select the part that they read.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] and [`TensorError::Torch`] if the bytes are neither, and [`TensorError::Malformed`] if repeated
    /// references would make objects, names or copies of tensors several times as large as the file.
    pub fn parse(file: SharedBytes) -> Result<Self, TensorError> {
        if safetensors::recognises(&file) {
            return safetensors::parse(&file);
        }
        if atsplat_pickle::recognises(&file) {
            let bytes = file.len();
            let root = atsplat_pickle::parse(file)?;
            let mut walk = Walk {
                found: Self::default(),
                objects_left: bytes.saturating_mul(4),
                copies_left: bytes.saturating_mul(2),
                names_left: bytes.saturating_mul(4),
            };
            walk.visit(&root, "")?;
            return Ok(walk.found);
        }
        if atsplat_files::is_lfs_pointer(&file) {
            let found = "a Git LFS pointer to it: run `git lfs pull` in its repository";
            return Err(Malformed::new("weights", "byte 0", EXPECTED, found).into());
        }
        let start: Vec<String> = file.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        let found = if start.is_empty() { "an empty file".to_owned() } else { start.join(" ") };
        Err(Malformed::new("weights", "byte 0", EXPECTED, found).into())
    }

    /// The safetensors file of these tensors. The same tensors give the same bytes.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] for a name that the format reserves.
    pub fn to_safetensors(&self) -> Result<Vec<u8>, TensorError> {
        let views = self.views();
        let mut file = safetensors::start(&views, &self.metadata)?;
        for (_, view) in &views {
            file.extend_from_slice(view.bytes());
        }
        Ok(file)
    }

    /// Writes [`Self::to_safetensors`] atomically, without a copy of the tensors.
    ///
    /// # Errors
    /// [`TensorError::Io`], and as [`Self::to_safetensors`].
    pub fn write(&self, path: &Path) -> Result<(), TensorError> {
        write_safetensors(path, &self.views(), &self.metadata)
    }

    fn views(&self) -> Vec<(&str, TensorView<'_>)> {
        self.tensors.iter().map(|(name, tensor)| (name.as_str(), tensor.view())).collect()
    }

    /// SHA-256 in hexadecimal of names, types, shapes and bytes of the tensors, independent of their order and file.
    pub fn digest(&self) -> String {
        let mut sorted: Vec<_> = self.tensors.iter().collect();
        sorted.sort_by_key(|(name, _)| *name);
        let mut hash = Sha256::new();
        for (name, tensor) in sorted {
            hash.update((name.len() as u64).to_le_bytes());
            hash.update(name);
            hash.update(tensor.to_string());
            hash.update(tensor.bytes());
        }
        atsplat_files::hexadecimal(&hash.finalize())
    }

    /// SHA-256 in hexadecimal of the metadata without the entry `excluded`, which may be this hash: keys and values in the order of
    /// keys, each after its length in bytes as u64 little-endian.
    pub fn metadata_digest(&self, excluded: &str) -> String {
        let mut hash = Sha256::new();
        for text in self.metadata.iter().filter(|(key, _)| *key != excluded).flat_map(|(key, value)| [key, value]) {
            hash.update((text.len() as u64).to_le_bytes());
            hash.update(text);
        }
        atsplat_files::hexadecimal(&hash.finalize())
    }
}

/// A walk through a checkpoint's objects, with limits.
struct Walk {
    found: StoredTensors,
    /// Objects that may still be visited: objects of a hostile file can be shared so that a walk along every path never ends.
    /// Without sharing, each takes at least a byte.
    objects_left: usize,
    /// Bytes into which strided tensors may still be copied; others stay in the file's map.
    copies_left: usize,
    /// Bytes that names and shapes may still take: references of two bytes to one tensor give as many names, each with all keys
    /// above it.
    names_left: usize,
}

impl Walk {
    /// Collects the tensors of a tensor or container at `path`. The depth is at most [`atsplat_pickle::MAX_DEPTH`].
    fn visit(&mut self, value: &Value, path: &str) -> Result<(), TensorError> {
        let location = || format!("object {:?}", shortened(path));
        let dimensions = value.as_tensor().map_or(0, |tensor| tensor.shape().len());
        self.names_left =
            self.names_left.checked_sub(path.len() + dimensions * size_of::<usize>()).ok_or_else(|| {
                Malformed::new(WHAT, location(), "names and shapes of at most four times the file's size", "more")
            })?;
        if let Some(tensor) = value.as_tensor() {
            let stored = self.stored(tensor, &location())?;
            return match self.found.tensors.insert(path.to_owned(), stored) {
                None => Ok(()),
                Some(_) => Err(Malformed::new(WHAT, location(), "a unique name", "two tensors").into()),
            };
        }
        for (position, item) in value.as_sequence().unwrap_or_default().iter().enumerate() {
            self.visit_part(item, path, &position)?;
        }
        for (key, item) in value.as_dict().into_iter().flat_map(Dict::iter) {
            match key {
                Key::Str(text) => self.visit_part(item, path, text)?,
                Key::Int(number) => self.visit_part(item, path, number)?,
            }
        }
        Ok(())
    }

    /// Visits a part of the container at `path`. Numbers and texts are only counted: names are made for the others alone.
    fn visit_part(&mut self, value: &Value, path: &str, key: &impl fmt::Display) -> Result<(), TensorError> {
        self.objects_left = self.objects_left.checked_sub(1).ok_or_else(|| {
            let location = format!("object {:?}", shortened(path));
            Malformed::new(WHAT, location, "at most four objects for each byte of the file", "more")
        })?;
        if !matches!(value, Value::Tensor(_) | Value::List(_) | Value::Tuple(_) | Value::Dict(_)) {
            return Ok(());
        }
        let name = if path.is_empty() { key.to_string() } else { format!("{path}.{key}") };
        self.visit(value, &name)
    }

    fn stored(&mut self, tensor: &Tensor, location: &str) -> Result<StoredTensor, TensorError> {
        if !tensor.is_contiguous() {
            let bytes =
                usize::try_from(tensor.element_count()).unwrap_or(usize::MAX).saturating_mul(tensor.dtype().bytes());
            self.copies_left = self.copies_left.checked_sub(bytes).ok_or_else(|| {
                Malformed::new(WHAT, location, "strided tensors of at most twice the file's size", tensor)
            })?;
        }
        let shape: Option<Vec<usize>> = tensor.shape().iter().map(|&size| usize::try_from(size).ok()).collect();
        let too_large = || Malformed::new(WHAT, location, "sizes that this machine can address", tensor);
        StoredTensor::new(tensor.dtype(), shape.ok_or_else(too_large)?, tensor.to_bytes()?)
    }
}
