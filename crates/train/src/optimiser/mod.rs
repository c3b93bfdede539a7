//! `AdamW`, learning-rate schedule, gradient clipping and weight averaging, on plain arrays that a checkpoint stores exactly.

mod adam_w;
mod average;
mod clip;
mod schedule;

pub use adam_w::{AdamW, Moments, Update};
pub use average::{average, warmed_up};
pub use clip::{clip, norm};
pub use schedule::Schedule;
