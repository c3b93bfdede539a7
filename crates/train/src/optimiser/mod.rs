//! `AdamW`, its schedule, and clipping, over named arrays: simple enough that its state can be written down exactly.

mod adam_w;
mod clip;
mod schedule;

pub use adam_w::{AdamW, Moments, Update};
pub use clip::{clip, norm};
pub use schedule::Schedule;
