//! Named tensors of files: safetensors, read and written, and PyTorch checkpoints, read.
//!
//! Files are memory-mapped and never executed. Any bytes give whole tensors or a typed error; what tensors mean is up to
//! the crates that use them.

mod error;
mod safetensors;
mod stored;
mod tensor;
mod view;

pub use atsplat_pickle::DType;
pub use error::TensorError;
pub use safetensors::read_metadata;
pub use stored::{StoredTensors, TensorFile};
pub use tensor::StoredTensor;
pub use view::{TensorView, write_safetensors};

#[cfg(test)]
mod tests;
