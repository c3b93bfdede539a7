use std::collections::BTreeSet;

use atsplat_camera::{Camera, ImageSize};
use atsplat_pixels::ImageU8;
use atsplat_protocol::ProtocolError;
use atsplat_scene::geometry::{EpipolarGeometry, PointMatch, View};
use glam::DVec2;
use serde::Serialize;

use super::{Features, MatchOptions, OpenCvError, detect, match_mutual};

/// Overlap by matched features: both images are divided into a grid; of one view's cells with SIFT features, the
/// fraction that contains a feature matched to the other view; the smaller of both directions.
///
/// A match counts if it is mutual, passes the ratio test, and agrees with the given cameras: within
/// `limit` of its epipolar line and in front of both cameras or, for cameras with the same centre,
/// within `limit` of where the rotation maps it. Cells without features (blank walls, sky) are ignored.
///
/// This is a lower bound that falls with the baseline and with blur, as sparse matching does. It is not the
/// quantity that NoPoSplat publishes in its index (dense `RoMa` matches, code never released); do not mix the two in
/// one set of bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureCoverage {
    /// Cells along each side of the image; at least 1.
    pub cells: u32,
    /// Largest distance of a match from its epipolar line, root mean square of both images, as a fraction of the mean of
    /// their diagonals.
    pub limit: f64,
    /// How features are found and matched.
    pub matching: MatchOptions,
}

impl Default for FeatureCoverage {
    /// 8×8 cells: a 256×256 image has some hundred features, a few in every cell. 0.5 % of its diagonal is
    /// 1.8 pixels.
    fn default() -> Self {
        Self { cells: 8, limit: 0.005, matching: MatchOptions::default() }
    }
}

/// The coverage of two views by matched features.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Fraction of the first view's cells with features that are matched into the second, in [0, 1].
    pub first_in_second: f64,
    /// Fraction of the second view's cells with features that are matched into the first, in [0, 1].
    pub second_in_first: f64,
    /// Mutual matches that passed the ratio test.
    pub tentative: usize,
    /// The tentative matches that agree with the cameras.
    pub verified: usize,
}

impl Coverage {
    /// The smaller of the two directions, in [0, 1].
    pub fn overlap(&self) -> f64 {
        if self.second_in_first < self.first_in_second { self.second_in_first } else { self.first_in_second }
    }
}

impl FeatureCoverage {
    /// Two-way overlap in [0, 1].
    ///
    /// # Errors
    /// As [`Self::coverage`].
    pub fn overlap(&self, a: (&Camera, &ImageU8), b: (&Camera, &ImageU8)) -> Result<f64, ProtocolError> {
        Ok(self.coverage(a, b)?.overlap())
    }

    /// The coverage in both directions. Images may be scaled to any size, but not cropped, relative to what the
    /// intrinsics describe.
    ///
    /// # Errors
    /// [`ProtocolError::Overlap`] if an image has no features, the grid has no cells, or OpenCV fails.
    pub fn coverage(&self, a: (&Camera, &ImageU8), b: (&Camera, &ImageU8)) -> Result<Coverage, ProtocolError> {
        if self.cells == 0 {
            return Err(unusable("the grid has no cells"));
        }
        let (first, second) = (ViewFeatures::new(a, self)?, ViewFeatures::new(b, self)?);
        let matches = match_mutual(&first.features, &second.features, self.matching.ratio).map_err(failed)?;
        let agreement = Agreement::new(&first.view, &second.view, self.limit);
        let verified: Vec<&PointMatch> = matches.iter().filter(|points| agreement.fits(points)).collect();
        let fraction = |seen: &ViewFeatures, at: fn(&PointMatch) -> DVec2| {
            let matched: BTreeSet<_> =
                verified.iter().filter_map(|points| self.cell(seen.view.size, at(points))).collect();
            matched.len() as f64 / seen.cells.len() as f64
        };
        Ok(Coverage {
            first_in_second: fraction(&first, |points| points.first),
            second_in_first: fraction(&second, |points| points.second),
            tentative: matches.len(),
            verified: verified.len(),
        })
    }

    /// Column and row of the cell that a pixel falls into.
    fn cell(&self, size: ImageSize, pixel: DVec2) -> Option<(u32, u32)> {
        let along = |place: f64, length: u32| {
            let cell = (place / f64::from(length) * f64::from(self.cells)).floor();
            // A feature at the edge may be a fraction of a pixel outside.
            let last = f64::from(self.cells - 1);
            cell.is_finite().then(|| whole(cell.clamp(0.0, last)))
        };
        Some((along(pixel.x, size.width)?, along(pixel.y, size.height)?))
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells of a u32 grid")]
fn whole(cell: f64) -> u32 {
    cell as u32
}

/// A view with its features and the cells that they occupy.
struct ViewFeatures {
    view: View,
    features: Features,
    cells: BTreeSet<(u32, u32)>,
}

impl ViewFeatures {
    fn new((camera, image): (&Camera, &ImageU8), grid: &FeatureCoverage) -> Result<Self, ProtocolError> {
        let size = ImageSize { width: image.width(), height: image.height() };
        let features = detect(image, &grid.matching).map_err(failed)?;
        let cells: BTreeSet<_> = features.points().iter().filter_map(|point| grid.cell(size, *point)).collect();
        if cells.is_empty() {
            return Err(unusable("an image has no features"));
        }
        Ok(Self { view: View { camera: *camera, size }, features, cells })
    }
}

/// Decides whether a match agrees with two cameras, whichever of them is the first.
struct Agreement<'a> {
    first: &'a View,
    second: &'a View,
    geometry: Option<EpipolarGeometry>,
    limit_px: f64,
}

impl<'a> Agreement<'a> {
    fn new(first: &'a View, second: &'a View, limit: f64) -> Self {
        let geometry = EpipolarGeometry::new(first, second);
        let limit_px = limit * 0.5 * (first.diagonal() + second.diagonal());
        Self { first, second, geometry, limit_px }
    }

    fn fits(&self, points: &PointMatch) -> bool {
        let straight = (self.first.undistorted(points.first), self.second.undistorted(points.second));
        let (Some(first), Some(second)) = straight else { return false };
        let points = PointMatch { first, second };
        match &self.geometry {
            Some(geometry) => geometry.distance(&points) <= self.limit_px && geometry.in_front(&points),
            None => self.turned_distance(&points).is_some_and(|distance| distance <= self.limit_px),
        }
    }

    /// Root mean square distance, in pixels, of each point from where the rotation maps the other one; `None` if that is
    /// behind a camera.
    fn turned_distance(&self, points: &PointMatch) -> Option<f64> {
        let in_second = turned(self.first, self.second, points.first)?.distance_squared(points.second);
        let in_first = turned(self.second, self.first, points.second)?.distance_squared(points.first);
        Some((0.5 * (in_first + in_second)).sqrt())
    }
}

/// Where one view sees what another one, from the same centre, sees at `pixel`.
fn turned(from: &View, into: &View, pixel: DVec2) -> Option<DVec2> {
    let ray = from.pixel_from_plane().inverse() * pixel.extend(1.0);
    let world = from.camera.camera_from_world.inverse().transform_vector(ray);
    let seen = into.pixel_from_plane() * into.camera.camera_from_world.transform_vector(world);
    (seen.z > 0.0).then(|| seen.truncate() / seen.z)
}

/// The overlap of [`FeatureCoverage::default`], for [`atsplat_protocol::overlap::OverlapEstimator::with_features`].
///
/// # Errors
/// As [`FeatureCoverage::coverage`].
pub fn feature_overlap(a: (&Camera, &ImageU8), b: (&Camera, &ImageU8)) -> Result<f64, ProtocolError> {
    FeatureCoverage::default().overlap(a, b)
}

#[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
fn failed(error: OpenCvError) -> ProtocolError {
    unusable(&error.to_string())
}

fn unusable(reason: &str) -> ProtocolError {
    ProtocolError::Overlap { estimator: "feature-coverage", reason: reason.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linked::test_images::{level, noise};
    use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;
    use glam::{DMat3, DVec3};

    const SIZE: u32 = 256;

    /// A plane at z = 1, painted with soft noise, seen by a camera shifted by (`x`, `y`) of the image's width.
    fn view(x: f64, y: f64) -> (Camera, ImageU8) {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, -y, 0.0)).unwrap();
        let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap());
        let mut samples = Vec::new();
        for row in 0..SIZE {
            for column in 0..SIZE {
                let place = DVec2::new(f64::from(column), f64::from(row)) + f64::from(SIZE) * DVec2::new(x, y);
                let noise = |cell: f64| noise(place.x / cell, place.y / cell);
                samples.extend([level(60.0 * noise(5.0) + 100.0 * noise(11.0)); 3]);
            }
        }
        (camera, ImageU8::new(SIZE, SIZE, samples).unwrap())
    }

    fn overlap(a: &(Camera, ImageU8), b: &(Camera, ImageU8)) -> f64 {
        FeatureCoverage::default().overlap((&a.0, &a.1), (&b.0, &b.1)).unwrap()
    }

    #[test]
    fn an_image_covers_itself_completely() {
        let here = view(0.0, 0.0);
        let coverage = FeatureCoverage::default().coverage((&here.0, &here.1), (&here.0, &here.1)).unwrap();
        Tolerance::EXACT.assert([coverage.first_in_second, coverage.second_in_first], [1.0, 1.0], "itself");
        assert_eq!(coverage.tentative, coverage.verified, "every match is verified");
    }

    #[test]
    fn coverage_decreases_with_the_shift_and_stays_below_the_true_overlap() {
        let here = view(0.0, 0.0);
        let mut before = 1.0;
        for eighths in [1.0, 2.0, 4.0, 6.0] {
            let there = overlap(&here, &view(eighths / 8.0, 0.0));
            let truth = 1.0 - eighths / 8.0;
            assert!(there <= truth + 1.0 / 8.0, "{there} where {truth} is shared: one column of cells at most is cut");
            assert!(there > truth - 0.3, "{there} where {truth} is shared");
            assert!(there < before, "{there} after {before}");
            before = there;
        }
    }

    #[test]
    fn swapping_the_views_swaps_the_directions() {
        let (here, there) = (view(0.0, 0.0), view(0.25, 0.125));
        let coverage = |a: &(Camera, ImageU8), b: &(Camera, ImageU8)| {
            FeatureCoverage::default().coverage((&a.0, &a.1), (&b.0, &b.1)).unwrap()
        };
        let (forth, back) = (coverage(&here, &there), coverage(&there, &here));
        Tolerance::EXACT.assert(
            [forth.first_in_second, forth.overlap()],
            [back.second_in_first, back.overlap()],
            "directions",
        );
    }

    /// Without its right half, a view has features in about half of the cells, and all of them are in the whole view.
    #[test]
    fn the_overlap_is_the_smaller_of_both_directions() {
        let whole = view(0.0, 0.0);
        let mut samples = whole.1.clone().into_samples();
        for row in samples.chunks_mut(3 * SIZE as usize) {
            let middle = row.len() / 2;
            row[middle..].fill(90);
        }
        let half = (whole.0, ImageU8::new(SIZE, SIZE, samples).unwrap());
        let coverage = FeatureCoverage::default().coverage((&half.0, &half.1), (&whole.0, &whole.1)).unwrap();
        assert!(coverage.second_in_first < coverage.first_in_second - 0.1, "{coverage:?}");
        Tolerance::absolute(0.15).assert([coverage.second_in_first], [0.5], "of the whole view's cells");
        Tolerance::EXACT.assert(
            [overlap(&half, &whole), overlap(&whole, &half)],
            [coverage.second_in_first; 2],
            "overlap",
        );
    }

    /// A pixel of the smaller image is two of the larger one: the same offsets agree, whichever comes first.
    #[test]
    fn agreement_does_not_depend_on_the_order_of_images_of_two_sizes() {
        let view_of =
            |x: f64, side: u32| View { camera: view(x, 0.0).0, size: ImageSize { width: side, height: side } };
        for x in [0.25, 0.0] {
            let (large, small) = (view_of(0.0, 2 * SIZE), view_of(x, SIZE));
            // The point (0.1, 0.05, 1), seen `offset` pixels too low in the smaller image.
            let agrees = |offset: f64| {
                let at = |place: DVec2, side: u32| f64::from(side) * (place + 0.5);
                let first = at(DVec2::new(0.1, 0.05), 2 * SIZE);
                let second = at(DVec2::new(0.1 - x, 0.05), SIZE) + DVec2::new(0.0, offset);
                let forth = Agreement::new(&large, &small, 0.005).fits(&PointMatch { first, second });
                let back = PointMatch { first: second, second: first };
                [forth, Agreement::new(&small, &large, 0.005).fits(&back)]
            };
            // The root mean squares are 2.06 and 3.16 pixels, the limit 2.72.
            assert_eq!([agrees(1.3), agrees(2.0)], [[true; 2], [false; 2]], "shifted by {x}");
        }
    }

    #[test]
    fn cameras_that_contradict_the_images_verify_nothing() {
        let (here, mut there) = (view(0.0, 0.0), view(0.25, 0.0));
        assert!(overlap(&here, &there) > 0.5);
        // The images moved sideways, the cameras upwards.
        there.0 = view(0.0, 0.25).0;
        assert!(overlap(&here, &there) < 0.1, "{}", overlap(&here, &there));
        // The cameras moved the opposite way: correct epipolar lines, wrong side.
        there.0 = view(-0.25, 0.0).0;
        assert!(overlap(&here, &there) < 0.1, "{}", overlap(&here, &there));
    }

    #[test]
    fn blank_images_and_empty_grids_are_errors() {
        let here = view(0.0, 0.0);
        let blank = ImageU8::new(64, 64, vec![90; 64 * 64 * 3]).unwrap();
        let outcome = FeatureCoverage::default().overlap((&here.0, &here.1), (&here.0, &blank));
        assert!(matches!(outcome, Err(ProtocolError::Overlap { .. })));
        let no_cells = FeatureCoverage { cells: 0, ..FeatureCoverage::default() };
        assert!(no_cells.overlap((&here.0, &here.1), (&here.0, &here.1)).is_err());
    }
}
