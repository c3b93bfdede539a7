use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_pickle::{Dict, Key, SharedBytes, Tensor, Value, shortened};
use indexmap::IndexMap;
use sha2::{Digest, Sha256};

use super::{StoredTensor, safetensors};
use crate::ModelError;

const WHAT: &str = "checkpoint";
/// How many containers below the root of a checkpoint are looked through.
const DEPTH: usize = 5;
/// How many objects. A hostile file shares parts, so that a walk along every path could last for ever.
const MOST_OBJECTS: usize = 1 << 20;

/// Named tensors of a file, whoever wrote it.
#[derive(Clone, Debug, Default)]
pub struct StoredTensors {
    /// In the order of the file.
    pub tensors: IndexMap<String, StoredTensor>,
    /// Text beside them; safetensors files alone have it.
    pub metadata: BTreeMap<String, String>,
}

/// A file of tensors that was read, not yet asked what it means.
#[derive(Clone, Debug)]
pub struct TensorFile {
    /// Where it is.
    pub path: PathBuf,
    /// sha256 of the whole file, in hexadecimal.
    pub sha256: String,
    /// What it holds.
    pub stored: StoredTensors,
}

impl TensorFile {
    /// Maps and reads a safetensors file or a checkpoint of `torch.save`, told apart by their bytes.
    ///
    /// The file is hashed, so that every byte is read once; tensors stay in the map.
    ///
    /// # Errors
    /// [`ModelError::Io`], or [`ModelError::InFile`] around the errors of [`StoredTensors::parse`].
    pub fn open(path: &Path) -> Result<Self, ModelError> {
        let file = atsplat_pickle::map(path).map_err(ModelError::io("reading weights", path))?;
        Self::parse(path.to_owned(), file)
    }

    /// [`Self::open`], of bytes that are at hand; `path` is what messages call them.
    ///
    /// # Errors
    /// [`ModelError::InFile`] around the errors of [`StoredTensors::parse`].
    pub fn parse(path: PathBuf, bytes: SharedBytes) -> Result<Self, ModelError> {
        let sha256 = atsplat_files::hexadecimal(&Sha256::digest(&*bytes));
        let stored = StoredTensors::parse(bytes).map_err(|error| error.in_file(&path))?;
        Ok(Self { path, sha256, stored })
    }

    /// [`Self::open`] for a file that somebody has to get: where it is absent, `expected` says what it is and where from.
    ///
    /// # Errors
    /// [`ModelError::MissingWeights`], and as [`Self::open`].
    pub fn find(path: &Path, expected: impl FnOnce() -> String) -> Result<Self, ModelError> {
        Self::open(path).map_err(|error| match error {
            ModelError::Io { ref source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                ModelError::MissingWeights { expected: expected(), path: path.to_owned() }
            }
            other => other,
        })
    }

    /// Refuses a file of another hash than the one that was asked for, if one was.
    ///
    /// # Errors
    /// [`ModelError::InFile`] around [`ModelError::Malformed`].
    pub fn check_sha256(&self, asked: Option<&str>) -> Result<(), ModelError> {
        match asked.filter(|asked| !asked.eq_ignore_ascii_case(&self.sha256)) {
            None => Ok(()),
            Some(asked) => {
                let expected = format!("a file of sha256 {asked}");
                Err(ModelError::malformed("weights", "file", expected, &self.sha256).in_file(&self.path))
            }
        }
    }
}

impl StoredTensors {
    /// Reads a safetensors file, or a checkpoint of `torch.save` in either of its formats.
    ///
    /// A checkpoint's tensors are named by their path from the root, dicts and lists joined by dots; what is no
    /// tensor is passed over. A training checkpoint therefore gives `state_dict.encoder…` beside
    /// `optimizer.state…`: key maps name the part that they read.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] and [`ModelError::Torch`] where the bytes are neither.
    pub fn parse(file: SharedBytes) -> Result<Self, ModelError> {
        if safetensors::recognises(&file) {
            return safetensors::parse(&file);
        }
        if atsplat_pickle::recognises(&file) {
            let bytes = file.len();
            let root = atsplat_pickle::parse(file)?;
            let mut walk = Walk { found: Self::default(), objects_left: MOST_OBJECTS, copies_left: 2 * bytes };
            walk.visit(&root, "", DEPTH)?;
            return Ok(walk.found);
        }
        if atsplat_pickle::is_lfs_pointer(&file) {
            let found = "a Git LFS pointer to it: run `git lfs pull` in its repository";
            return Err(ModelError::malformed("weights", "byte 0", "a safetensors file, or one of torch.save", found));
        }
        let start: Vec<String> = file.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        let found = if start.is_empty() { "an empty file".to_owned() } else { start.join(" ") };
        Err(ModelError::malformed("weights", "byte 0", "a safetensors file, or one of torch.save", found))
    }

    /// The safetensors file of these tensors. The same tensors give the same bytes.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] for a name that the format keeps for itself.
    pub fn to_safetensors(&self) -> Result<Vec<u8>, ModelError> {
        safetensors::write(&self.tensors, &self.metadata)
    }

    /// Writes [`Self::to_safetensors`]; the file appears whole under its name, or not at all.
    ///
    /// # Errors
    /// [`ModelError::Io`], and as [`Self::to_safetensors`].
    pub fn write(&self, path: &Path) -> Result<(), ModelError> {
        let bytes = self.to_safetensors()?;
        atsplat_files::write(path, &bytes).map_err(ModelError::io("writing weights", path))
    }

    /// sha256 in hexadecimal of names, types, shapes and bytes of the tensors, whatever their order and file.
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
}

/// Through a checkpoint, with limits.
struct Walk {
    found: StoredTensors,
    objects_left: usize,
    /// Bytes that strided tensors may still be copied into; others stay in the file's map.
    copies_left: usize,
}

impl Walk {
    fn visit(&mut self, value: &Value, path: &str, depth: usize) -> Result<(), ModelError> {
        let location = || format!("object {:?}", shortened(path));
        self.objects_left = self.objects_left.checked_sub(1).ok_or_else(|| {
            ModelError::malformed(WHAT, location(), format!("at most {MOST_OBJECTS} objects"), "more")
        })?;
        if let Some(tensor) = value.as_tensor() {
            let stored = self.stored(tensor, &location())?;
            return match self.found.tensors.insert(path.to_owned(), stored) {
                None => Ok(()),
                Some(_) => Err(ModelError::malformed(WHAT, location(), "a name of its own", "two tensors")),
            };
        }
        let Some(depth) = depth.checked_sub(1) else { return Ok(()) };
        let below = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
        for (position, item) in value.as_sequence().unwrap_or_default().iter().enumerate() {
            self.visit(item, &below(&position.to_string()), depth)?;
        }
        for (key, item) in value.as_dict().into_iter().flat_map(Dict::iter) {
            let name = match key {
                Key::Str(text) => below(text),
                Key::Int(number) => below(&number.to_string()),
            };
            self.visit(item, &name, depth)?;
        }
        Ok(())
    }

    fn stored(&mut self, tensor: &Tensor, location: &str) -> Result<StoredTensor, ModelError> {
        if !tensor.is_contiguous() {
            let bytes =
                usize::try_from(tensor.element_count()).unwrap_or(usize::MAX).saturating_mul(tensor.dtype().bytes());
            self.copies_left = self.copies_left.checked_sub(bytes).ok_or_else(|| {
                ModelError::malformed(WHAT, location, "strided tensors of the file's own size", tensor)
            })?;
        }
        let shape: Option<Vec<usize>> = tensor.shape().iter().map(|&size| usize::try_from(size).ok()).collect();
        let shape = shape.ok_or_else(|| ModelError::malformed(WHAT, location, "sizes of this machine", tensor))?;
        StoredTensor::new(tensor.dtype(), shape, tensor.to_bytes()?)
    }
}
