//! Training of the network: the paper's losses, optimiser and data, and DepthSplat's growing windows of frames, in runs that can be
//! killed at any moment.
//!
//! A run is a folder: `checkpoints/`, `weights.safetensors`, `steps.jsonl`, `evaluations.jsonl`, which one process at a time
//! writes (`run.lock`). A step depends on the configuration and the step number alone, so a resumed run ends bit for bit like an
//! uninterrupted one, on any number of threads; on another type of processor, with another driver of its adapter or another build of the
//! program, it may differ in the last bits, and says so.

mod checkpoint;
mod config;
mod contact_sheet;
mod device_state;
mod error;
mod evaluation;
mod features;
pub mod logs;
pub mod losses;
mod objective;
pub mod optimiser;
mod parameters;
mod provenance;
mod resolved;
pub mod samples;
mod skipped_step;
mod trainer;
mod update;

pub use checkpoint::{CheckpointFile, Checkpoints, InitialWeights, State};
pub use config::{
    CheckpointConfig, DataConfig, EvaluationConfig, LossConfig, ModelChoice, PerceptualChoice, SourceConfig,
    TrainConfig,
};
pub use contact_sheet::{SheetRow, contact_sheet};
pub use error::{Purpose, TrainError};
pub use evaluation::Evaluation;
pub use features::FeatureCache;
pub use objective::{FlatGradient, GroupGradients, GroupInput, Objective, PartSeconds, Terms};
pub use parameters::Parameters;
pub use resolved::Resolved;
pub use skipped_step::{Diagnosis, FailureReason, SampleFailure, SkippedStep};
pub use trainer::{Event, Limits, Start, Trainer, WEIGHTS};
