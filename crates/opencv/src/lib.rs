//! Functions of the system's OpenCV: feature matching between images, the geometry check and the overlap estimator
//! based on it, undistortion, frames from videos.
//!
//! Empty without the cargo feature `opencv`, so that a build without OpenCV has this crate too, and so that the feature
//! recompiles only this crate and the binary. Only calls available in OpenCV 4.6 and later 4.x are used. Their results do
//! not depend on the run or on OpenCV's threads.

#[cfg(feature = "opencv")]
mod linked;

#[cfg(feature = "opencv")]
pub use linked::*;
