use atsplat_numeric::median;
use serde::Serialize;

use super::{Convention, EpipolarGeometry, PointMatch, View};

/// Two views as declared, and the points matched between their images.
#[derive(Clone, Debug, PartialEq)]
pub struct MatchedPair {
    /// The first view.
    pub first: View,
    /// The second view.
    pub second: View,
    /// Matched points in raw, distorted pixels of the two images.
    pub matches: Vec<PointMatch>,
}

/// How well one interpretation of the cameras explains the matches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ConventionScore {
    /// The interpretation.
    pub convention: Convention,
    /// Median symmetric epipolar distance over all matches of all pairs, in pixels.
    pub median_px: f64,
    /// Fraction of the matches that triangulate in front of both cameras, in [0, 1].
    pub in_front: f64,
    /// Number of matches measured.
    pub matches: usize,
}

/// Scores every interpretation that applies, in the order of [`Convention::ALL`]. None has a free parameter, so that
/// none is favoured by fitting.
///
/// Each match counts once. Pairs whose centres coincide under an interpretation, and points outside the domain of its
/// lens model, are not measured. An interpretation with fewer than half of the declared one's measured matches is
/// omitted; the declared one is omitted only if nothing can be measured.
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
            let undistorted = (first.undistorted(points.first), second.undistorted(points.second));
            let (Some(first), Some(second)) = undistorted else { continue };
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
    use glam::DVec2;

    fn of(scores: &[ConventionScore], convention: Convention) -> Option<ConventionScore> {
        scores.iter().find(|score| score.convention == convention).copied()
    }

    fn turning_pair() -> MatchedPair {
        matched(view([0.1, 0.05, 0.3], [0.5, 0.2, -0.3]), view([-0.15, -0.1, -0.1], [-0.6, 0.3, 0.4]))
    }

    #[test]
    fn the_declared_interpretation_is_exact_and_mistakes_are_far_off() {
        let scores = score_conventions(&[turning_pair()]);
        let declared = of(&scores, Convention::Declared).unwrap();
        assert!(Tolerance::absolute(1e-9).accepts(declared.median_px, 0.0), "{declared:?}");
        Tolerance::EXACT.assert([declared.in_front], [1.0], "in front");
        assert_eq!(scores.len(), 7, "three interpretations do not apply to square pixels and a pinhole: {scores:?}");
        for score in &scores[1..] {
            assert!(score.median_px > 3.0, "{score:?}");
        }
    }

    #[test]
    fn simulated_mistakes_are_identified() {
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
    fn two_simultaneous_pose_mistakes_are_identified() {
        // OpenGL camera-to-world matrices, read as OpenCV world-to-camera.
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
    fn lens_distortion_is_undone_and_omitting_it_is_detected() {
        let distorted = |mut view: View| {
            view.camera.distortion = Distortion::OpenCv { k1: -0.25, k2: 0.05, k3: 0.0, p1: 1e-3, p2: -2e-3 };
            view
        };
        let pinhole = turning_pair();
        let scores = score_conventions(&[matched(distorted(pinhole.first), distorted(pinhole.second))]);
        let declared = of(&scores, Convention::Declared).unwrap();
        assert!(Tolerance::absolute(1e-8).accepts(declared.median_px, 0.0), "{declared:?}");
        assert!(of(&scores, Convention::NoDistortion).unwrap().median_px > 1.0);
        let undistorted = MatchedPair { first: distorted(pinhole.first), second: distorted(pinhole.second), ..pinhole };
        let scores = score_conventions(&[undistorted]);
        assert!(Tolerance::absolute(1e-9).accepts(of(&scores, Convention::NoDistortion).unwrap().median_px, 0.0));
    }

    /// With half the focal lengths, the lens ends at a radius of 0.61 of the declared image plane, whose corners are at 0.78.
    #[test]
    fn an_interpretation_that_measures_fewer_than_half_of_the_matches_is_omitted() {
        let distorted = |mut view: View| {
            view.camera.distortion = Distortion::OpenCv { k1: -0.1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
            view
        };
        let pinhole = turning_pair();
        let [first, second] = [pinhole.first, pinhole.second].map(distorted);
        let measured = |central: usize, at_corner: usize| {
            let at = |x: f64, y: f64| PointMatch { first: DVec2::new(x, y), second: DVec2::new(x + 5.0, y) };
            let central = (0..central).map(|place| at(300.0 + place as f64, 200.0));
            let at_corner = (0..at_corner).map(|place| at(2.0 + place as f64, 2.0));
            let pair = MatchedPair { first, second, matches: central.chain(at_corner).collect() };
            let scores = score_conventions(&[pair]);
            [Convention::Declared, Convention::FocalHalved].map(|which| of(&scores, which).map(|score| score.matches))
        };
        assert_eq!(measured(4, 6), [Some(10), None]);
        assert_eq!(measured(5, 5), [Some(10), Some(5)]);
        assert_eq!(measured(6, 4), [Some(10), Some(6)]);
    }

    #[test]
    fn there_is_no_score_without_measurable_matches() {
        assert!(score_conventions(&[]).is_empty());
        let still = view([0.0; 3], [1.0, 0.0, 0.0]);
        let turned = view([0.2, 0.0, 0.0], [1.0, 0.0, 0.0]);
        assert!(of(&score_conventions(&[matched(still, turned)]), Convention::Declared).is_none(), "no baseline");
    }
}
