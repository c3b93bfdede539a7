//! Two-view geometry on matched points: what the cameras of a scene claim, held against what its
//! pictures show. Pure arithmetic; the matches come from anywhere (feature `opencv` has SIFT).

mod convention;
mod epipolar;
mod score;
#[cfg(test)]
pub(crate) mod synthetic;
mod verdict;
mod view;

pub use convention::Convention;
pub use epipolar::EpipolarGeometry;
pub use score::{ConventionScore, MatchedPair, score_conventions};
pub use verdict::{Verdict, verdict};
pub use view::{PointMatch, View};
