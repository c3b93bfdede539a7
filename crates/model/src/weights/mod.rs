//! Weights in and out: the toolkit's own safetensors files, other people's checkpoints by key maps, and what
//! became of every tensor.
//!
//! Files are mapped and never executed. Any bytes give weights that are whole, finite and of the right shapes, or
//! a typed error; nothing is loaded half-way.

mod backbone;
mod generated;
mod inspection;
mod key_map;
mod known_files;
mod model_weights;
mod report;
mod safetensors;
mod stored;
mod tensor;

pub use atsplat_pickle::DType;
pub use backbone::{BackboneWeights, read_backbone};
pub use generated::generated;
pub use inspection::{Backbone, Inspection};
pub use key_map::KeyMap;
pub use known_files::KnownFile;
pub use model_weights::{ModelWeights, Precision};
pub use report::{ImportReport, LeftOver, Matched, Mismatched, Missing};
pub use stored::{StoredTensors, TensorFile};
pub use tensor::StoredTensor;

#[cfg(test)]
mod tests;
