//! Scenes into trials: evaluation indices, overlap bins, extrapolation splits, presets and lint.
//! A *trial* is all that a method may see of a scene, and the frames it is asked to render.

mod error;
mod index;

pub use error::ProtocolError;
pub use index::{EvaluationIndex, IndexEntry};
