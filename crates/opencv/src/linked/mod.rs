mod check_geometry;
mod coverage;
mod error;
mod matching;
#[cfg(test)]
pub(crate) mod test_images;
mod undistort;
mod undistort_scene;
mod video;

use atsplat_pixels::ImageU8;

use ::opencv::core::{Mat, Vec3b};
use ::opencv::prelude::*;

pub use check_geometry::{GeometryCheck, GeometryCheckOptions, PairCheck, PairChoice, SkippedPair, check_geometry};
pub use coverage::{Coverage, FeatureCoverage, feature_overlap};
pub use error::OpenCvError;
pub use matching::{Features, MatchOptions, detect, epipolar_inliers, match_mutual};
pub use undistort::{UndistortMode, Undistorter};
pub use undistort_scene::{UndistortedFrames, undistort_scene, undistorted_files};
pub use video::{ExtractedFrame, ExtractedFrames, ExtractionOptions, ExtractionOutcome, FrameFormat, extract_frames};

/// Adds what was being done to OpenCV's error.
fn called<T>(action: &'static str, result: ::opencv::Result<T>) -> Result<T, OpenCvError> {
    result.map_err(|source| OpenCvError::Call { action, source })
}

/// A number of columns or rows, as OpenCV counts them.
fn side(length: u32) -> Result<i32, OpenCvError> {
    i32::try_from(length).ok().ok_or(OpenCvError::Side { found: length })
}

/// An 8-bit `Mat` with the three channels R, G, B.
fn mat_from_image(image: &ImageU8) -> Result<Mat, OpenCvError> {
    let rows = side(image.height())?;
    let flat = called("wrapping an image", Mat::from_bytes::<Vec3b>(image.samples()))?;
    let shaped = called("wrapping an image", flat.reshape(3, rows))?;
    called("copying an image", shaped.try_clone())
}
