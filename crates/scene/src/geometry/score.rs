use atsplat_numeric::median;
use serde::Serialize;

use super::{Convention, EpipolarGeometry, PointMatch, View};

/// Two views as declared and the points that were matched between their pictures, as they were found:
/// in pixels, through the lens.
#[derive(Clone, Debug, PartialEq)]
pub struct MatchedPair {
    /// The first view.
    pub first: View,
    /// The second view.
    pub second: View,
    /// Matched points in raw pixels of the two pictures.
    pub matches: Vec<PointMatch>,
}

/// How well one reading of the cameras explains the matches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ConventionScore {
    /// The reading.
    pub convention: Convention,
    /// Median symmetric epipolar distance over all matches of all pairs, in pixels.
    pub median_px: f64,
    /// Fraction of the matches whose rays meet in front of both cameras, in [0, 1].
    pub in_front: f64,
    /// How many matches were measured.
    pub matches: usize,
}

/// Scores every reading that applies, in the order of [`Convention::ALL`]. No reading has a free
/// parameter, so that none is favoured by fitting.
///
/// Each match counts once. Pairs whose centres coincide under a reading, and points that its lens model
/// does not reach, are not measured under it. A reading that measures fewer than half of what the
/// declared one does is left out rather than judged by a remainder; the declared one is left out only
/// where nothing can be measured.
pub fn score_conventions(pairs: &[MatchedPair]) -> Vec<ConventionScore> {
    let mut scores: Vec<ConventionScore> = Vec::new();
    for convention in Convention::ALL {
        let Some(score) = score(convention, pairs) else { continue };
        let enough = scores.first().map_or(0, |declared| declared.matches.div_ceil(2));
        if score.matches >= enough {
            scores.push(score);
        }
    }
    scores
}

fn score(convention: Convention, pairs: &[MatchedPair]) -> Option<ConventionScore> {
    let (mut distances, mut in_front) = (Vec::new(), 0usize);
    for pair in pairs {
        let (Some(first), Some(second)) = (convention.reinterpret(&pair.first), convention.reinterpret(&pair.second))
        else {
            continue;
        };
        let Some(geometry) = EpipolarGeometry::new(&first, &second) else { continue };
        for points in &pair.matches {
            let straight = (first.undistorted(points.first), second.undistorted(points.second));
            let (Some(first), Some(second)) = straight else { continue };
            let points = PointMatch { first, second };
            distances.push(geometry.distance(&points));
            in_front += usize::from(geometry.in_front(&points));
        }
    }
    let matches = distances.len();
    let median_px = median(distances)?;
    Some(ConventionScore { convention, median_px, in_front: in_front as f64 / matches as f64, matches })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::synthetic::{matched, view};
    use atsplat_camera::Distortion;
    use atsplat_numeric::Tolerance;

    fn of(scores: &[ConventionScore], convention: Convention) -> Option<ConventionScore> {
        scores.iter().find(|score| score.convention == convention).copied()
    }

    fn turning_pair() -> MatchedPair {
        matched(view([0.1, 0.05, 0.3], [0.5, 0.2, -0.3]), view([-0.15, -0.1, -0.1], [-0.6, 0.3, 0.4]))
    }

    #[test]
    fn declared_is_exact_and_every_mistake_is_far_off() {
        let scores = score_conventions(&[turning_pair()]);
        let declared = of(&scores, Convention::Declared).unwrap();
        assert!(Tolerance::absolute(1e-9).accepts(declared.median_px, 0.0), "{declared:?}");
        Tolerance::EXACT.assert([declared.in_front], [1.0], "in front");
        assert_eq!(scores.len(), 7, "square pixels and a pinhole rule three readings out: {scores:?}");
        for score in &scores[1..] {
            assert!(score.median_px > 3.0, "{score:?}");
        }
    }

    #[test]
    fn a_mistake_made_on_purpose_is_found_under_its_name() {
        let truth = turning_pair();
        let mistakes = [
            (Convention::PoseInverted, Convention::PoseInverted),
            (Convention::AxesFlipped, Convention::AxesFlipped),
            (Convention::FocalHalved, Convention::FocalDoubled),
            (Convention::FocalDoubled, Convention::FocalHalved),
            (Convention::FocalExchanged, Convention::FocalExchanged),
        ];
        for (made, found) in mistakes {
            let wrong = |view: &View| made.reinterpret(view).unwrap();
            let pair = MatchedPair { first: wrong(&truth.first), second: wrong(&truth.second), ..truth.clone() };
            let scores = score_conventions(&[pair]);
            let hit = of(&scores, found).unwrap();
            assert!(Tolerance::absolute(1e-9).accepts(hit.median_px, 0.0), "{made}: {hit:?}");
            assert!(of(&scores, Convention::Declared).unwrap().median_px > 3.0, "{made}");
        }
    }

    #[test]
    fn both_pose_mistakes_at_once_are_found_under_their_name() {
        // Files that hold OpenGL camera-to-world, read as OpenCV world-to-camera.
        let truth = turning_pair();
        let wrong = |view: &View| {
            let file = view.camera.camera_from_world.inverse().opengl_from_opencv();
            let pose = atsplat_camera::CameraFromWorld::from_rows(&file.to_rows()).unwrap();
            View { camera: atsplat_camera::Camera { camera_from_world: pose, ..view.camera }, ..*view }
        };
        let pair = MatchedPair { first: wrong(&truth.first), second: wrong(&truth.second), ..truth.clone() };
        let hit = of(&score_conventions(&[pair]), Convention::PoseInvertedAxesFlipped).unwrap();
        assert!(Tolerance::absolute(1e-9).accepts(hit.median_px, 0.0), "{hit:?}");
    }

    #[test]
    fn a_lens_is_undone_and_leaving_it_out_is_seen() {
        let bend = |mut view: View| {
            view.camera.distortion = Distortion::OpenCv { k1: -0.25, k2: 0.05, k3: 0.0, p1: 1e-3, p2: -2e-3 };
            view
        };
        let pinhole = turning_pair();
        let scores = score_conventions(&[matched(bend(pinhole.first), bend(pinhole.second))]);
        let declared = of(&scores, Convention::Declared).unwrap();
        assert!(Tolerance::absolute(1e-8).accepts(declared.median_px, 0.0), "{declared:?}");
        assert!(of(&scores, Convention::NoDistortion).unwrap().median_px > 1.0);
        let straight = MatchedPair { first: bend(pinhole.first), second: bend(pinhole.second), ..pinhole };
        let scores = score_conventions(&[straight]);
        assert!(Tolerance::absolute(1e-9).accepts(of(&scores, Convention::NoDistortion).unwrap().median_px, 0.0));
    }

    #[test]
    fn nothing_to_measure_gives_no_score() {
        assert!(score_conventions(&[]).is_empty());
        let still = view([0.0; 3], [1.0, 0.0, 0.0]);
        let turned = view([0.2, 0.0, 0.0], [1.0, 0.0, 0.0]);
        assert!(of(&score_conventions(&[matched(still, turned)]), Convention::Declared).is_none(), "no baseline");
    }
}
