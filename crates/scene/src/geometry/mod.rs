//! Two-view geometry: checks the cameras of a scene against points matched between its images. Pure arithmetic; the
//! matches are an input (`atsplat-opencv` provides SIFT).

mod convention;
mod convention_fit;
mod epipolar;
mod score;
#[cfg(test)]
pub(crate) mod synthetic;
mod view;

pub use convention::Convention;
pub use convention_fit::{ConventionFit, fitting_convention};
pub use epipolar::EpipolarGeometry;
pub use score::{ConventionScore, MatchedPair, score_conventions};
pub use view::{PointMatch, View};
