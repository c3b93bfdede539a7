//! Reading and writing of weights: the toolkit's safetensors files, and other checkpoints by key maps, with a report on
//! every tensor.
//!
//! Files are memory-mapped and never executed. Any bytes give weights that are complete, finite and of the right shapes, or
//! a typed error; nothing is loaded partially.

mod backbone;
mod generated;
mod imported;
mod inspection;
mod key_map;
mod known_files;
mod model_weights;
mod report;
pub mod training_data;
mod verification;

pub use atsplat_tensors::{DType, StoredTensor, StoredTensors, TensorError, TensorFile};
pub use backbone::{BackboneWeights, read_backbone};
pub use generated::generated;
pub use imported::{ImportedBackbone, ImportedFile};
pub use inspection::{Backbone, Inspection};
pub use key_map::KeyMap;
pub use known_files::KnownFile;
pub use model_weights::{CHECKPOINT_KEY, ModelWeights, Precision};
pub use report::{ImportReport, Matched, MismatchCounts, MismatchReason, Mismatched, Missing, OtherSets, UnusedTensor};
pub use verification::Verification;

#[cfg(test)]
mod tests;
