use std::collections::BTreeMap;
use std::fmt;
use std::io::Write as _;
use std::path::Path;

use atsplat_files::FileError;
use atsplat_pickle::DType;

use crate::tensor::check_length;
use crate::{TensorError, safetensors};

/// A row-major array to be written whose bytes are borrowed.
#[derive(Clone)]
pub struct TensorView<'a> {
    pub(crate) dtype: DType,
    pub(crate) shape: Vec<usize>,
    pub(crate) bytes: &'a [u8],
}

impl<'a> TensorView<'a> {
    /// A tensor of little-endian bytes.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] if the number of bytes does not fit the shape.
    pub fn new(dtype: DType, shape: Vec<usize>, bytes: &'a [u8]) -> Result<Self, TensorError> {
        check_length(dtype, &shape, bytes.len())?;
        Ok(Self { dtype, shape, bytes })
    }

    /// Type of the elements.
    pub const fn dtype(&self) -> DType {
        self.dtype
    }

    /// Size of each dimension; empty for a scalar.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Row-major little-endian bytes.
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }
}

impl fmt::Debug for TensorView<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?}", self.dtype, self.shape)
    }
}

/// Writes a safetensors file atomically, with the tensors in the given order and without a copy of their bytes. The same arguments
/// give the same file.
///
/// # Errors
/// [`TensorError::Malformed`] for a name that the format reserves or that two tensors have; [`TensorError::Io`].
pub fn write_safetensors(
    path: &Path,
    tensors: &[(&str, TensorView<'_>)],
    metadata: &BTreeMap<String, String>,
) -> Result<(), TensorError> {
    let start = safetensors::start(tensors, metadata)?;
    let written = atsplat_files::write_with(path, |file| {
        file.write_all(&start)?;
        tensors.iter().try_for_each(|(_, tensor)| file.write_all(tensor.bytes))
    });
    written.map_err(FileError::during("writing weights", path))
}
