//! Scenes into trials: evaluation indices, overlap bins, extrapolation splits, presets and lint.
//! A *trial* is all that a method may see of a scene, and the frames it is asked to render.

pub mod extrapolation;
pub mod overlap;
pub mod samplers;

mod builder;
mod error;
mod index;

pub use builder::{BuiltIndex, IndexBuilder, OverlapRule};
pub use error::ProtocolError;
pub use index::{EvaluationIndex, IndexEntry};
pub use samplers::NoEntry;
