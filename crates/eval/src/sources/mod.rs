//! Scene sources other than plain files: simulated, or already cropped.

mod cropped;
mod simulated;

pub use cropped::AlreadyCropped;
pub use simulated::{is_simulated, simulated, simulated_dataset};
