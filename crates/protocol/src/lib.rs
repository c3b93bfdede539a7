//! Scenes into trials: evaluation indices, overlap bins, extrapolation splits, presets and lint.
//! A *trial* is all that a method may see of a scene, and the frames it is asked to render.

pub mod extrapolation;
pub mod overlap;
pub mod samplers;

mod bins;
mod builder;
mod error;
mod index;
mod known;

pub use bins::{BinCounts, BinPlace, BinRule, BinnedMean, OverlapBins};
pub use builder::{BuiltIndex, IndexBuilder, OverlapRule};
pub use error::ProtocolError;
pub use index::{
    AbsentForm, EvaluationIndex, IndexEntry, IndexFile, IndexLayout, IndexNotices, LoneEntryForm, NotADigest,
    OVERLAP_OF_LARGE, OVERLAP_OF_OTHER_WORDS, Sha256Digest, Spacing,
};
pub use known::{KNOWN_INDICES, KnownIndex};
pub use samplers::NoEntry;
