//! Functions of the system's OpenCV: feature matching between pictures and the geometry check based on it, undistortion,
//! frames from videos.
//!
//! Only calls available in OpenCV 4.6 and later 4.x are used. Their results do not depend on the run or on OpenCV's
//! threads.

mod check_geometry;
mod matching;
#[cfg(test)]
pub(crate) mod test_pictures;
mod undistort;
mod video;

use atsplat_pixels::ImageU8;

use ::opencv::core::{Mat, Vec3b};
use ::opencv::prelude::*;

use crate::SceneError;

pub use check_geometry::{GeometryCheck, GeometryCheckOptions, PairCheck, PairChoice, SkippedPair, check_geometry};
pub use matching::{Features, MatchOptions, detect, epipolar_inliers, match_mutual, match_pair};
pub use undistort::{UndistortMode, Undistorter};
pub use video::{CutFrame, CutOptions, CutOutcome, FrameFormat, VideoCut, cut_frames};

/// Limits OpenCV's own threads, process-wide, to `count`; 0 and 1 both mean the calling thread only.
///
/// # Errors
/// [`SceneError::OpenCv`].
pub fn limit_threads(count: usize) -> Result<(), SceneError> {
    let count = i32::try_from(count).unwrap_or(i32::MAX);
    called("limiting threads", ::opencv::core::set_num_threads(count))
}

/// Adds what was being done to OpenCV's error.
fn called<T>(action: &'static str, result: ::opencv::Result<T>) -> Result<T, SceneError> {
    result.map_err(|source| SceneError::OpenCv { action, source })
}

/// An 8-bit `Mat` with the three channels R, G, B.
fn mat_from_picture(picture: &ImageU8) -> Result<Mat, SceneError> {
    let rows = i32::try_from(picture.height()).unwrap_or(i32::MAX);
    let flat = called("wrapping a picture", Mat::from_bytes::<Vec3b>(picture.samples()))?;
    let shaped = called("wrapping a picture", flat.reshape(3, rows))?;
    called("copying a picture", shaped.try_clone())
}
