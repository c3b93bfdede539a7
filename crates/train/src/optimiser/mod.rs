//! `AdamW`, its schedule, clipping and averaging, over named arrays: simple enough that its state can be written down exactly.

mod adam_w;
mod average;
mod clip;
mod schedule;

pub use adam_w::{AdamW, Moments, Update};
pub use average::{average, kept};
pub use clip::{clip, norm};
pub use schedule::Schedule;
