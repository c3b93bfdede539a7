//! Evaluation protocols: evaluation indices, overlap bins, extrapolation splits, presets, lint, and trials.
//! A *trial* is everything a method may see of a scene, plus the cameras it has to render.

pub mod extrapolation;
pub mod overlap;
pub mod samplers;
pub mod trial;

mod bins;
mod error;
mod index;
mod known;
mod lint;
mod loading;
mod named_dataset;
mod preset;
mod sampling_rule;
#[cfg(test)]
mod test_source;

pub use bins::{BinCount, BinCounts, BinPlace, BinRule, OverlapBins};
pub use error::ProtocolError;
pub use index::{
    AbsentForm, EvaluationIndex, ForeignEntries, IndexEntry, IndexFile, IndexLayout, IndexMismatch, IndexNotices,
    OVERLAP_OF_LARGE, OVERLAP_OF_OTHER_WORDS, Overlap, SingleEntryForm, Spacing,
};
pub use known::{KNOWN_INDICES, KnownIndex};
pub use lint::{
    Comparability, CountDistribution, DatasetCheck, DatasetFacts, DropExample, FileFacts, FullLint, LintOptions,
    LintReport, OverlapFacts, PresetMatch, RecognisedIndex, Repeats, TableSharing, TargetCount, compare, lint,
    lint_file,
};
pub use named_dataset::{NAMED_DATASETS, NamedDataset};
pub use preset::{
    AcceptedIndex, Aggregation, Derivation, DisparityPlanes, DropReason, Dropped, EffectiveSetting, Filters,
    IndexMatch, IndexRule, LensDistortion, MeanCameraScale, MethodSetting, MetricIds, NearCull, NearFar,
    PoseNormalisation, Preset, RendererConvention, RendererExtent, RendererOverrides, RendererPrincipalPoint,
};
pub use samplers::NoEntry;
pub use sampling_rule::{BuiltIndex, OverlapRule, SamplingRule};
