//! Scene sources other than plain files: simulated, cropped in advance, or without frames whose pictures are missing.

mod cropped;
mod present;
mod simulated;

pub use cropped::AlreadyCropped;
pub use present::PresentFrames;
pub use simulated::simulated;
