//! Where a run's scenes come from, beside files as they are: simulated, cropped beforehand, with gaps closed.

mod cropped;
mod present;
mod simulated;

pub use cropped::AlreadyCropped;
pub use present::PresentFrames;
pub use simulated::simulated;
