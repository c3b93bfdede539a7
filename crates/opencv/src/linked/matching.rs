use std::collections::BTreeSet;

use atsplat_pixels::ImageU8;
use atsplat_scene::geometry::PointMatch;
use glam::DVec2;

use ::opencv::calib3d::{USAC_MAGSAC, find_fundamental_mat};
use ::opencv::core::{DMatch, KeyPoint, Mat, NORM_L2, Point2d, Vector, no_array};
use ::opencv::features2d::{BFMatcher, SIFT};
use ::opencv::imgproc::{COLOR_RGB2GRAY, cvt_color_def};
use ::opencv::prelude::*;

use super::{OpenCvError, called, mat_from_image};

/// Offset from OpenCV's key point coordinates to pixels with centres at + 0.5.
///
/// OpenCV's origin is the centre of the first pixel, which is + 0.5 here; and its SIFT upscales the image by two
/// without correcting the resulting shift of a quarter pixel (OpenCV 4.8 fixed it behind `enable_precise_upscale`, off
/// by default).
const PIXEL_FROM_KEYPOINT: f64 = 0.5 - 0.25;

/// With fewer matches, a fundamental matrix fits them too easily to identify outliers.
const MIN_FOR_FUNDAMENTAL: usize = 12;
const CONFIDENCE: f64 = 0.9999;
const MAX_ITERATIONS: i32 = 10_000;

/// How features are found and matched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatchOptions {
    /// Number of an image's strongest features to use.
    pub max_features: usize,
    /// Ratio test: a match's descriptor distance is below this fraction of the second best's, in (0, 1] (Lowe 2004 §7.1
    /// uses 0.8).
    pub ratio: f64,
    /// Maximum distance of inliers of the fundamental matrix, in pixels.
    pub inlier_px: f64,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self { max_features: 4000, ratio: 0.8, inlier_px: 1.5 }
    }
}

/// SIFT features of one image (Lowe 2004, as OpenCV computes them).
#[derive(Debug)]
pub struct Features {
    points: Vec<DVec2>,
    descriptors: Mat,
}

impl Features {
    /// Positions of the features in pixels, with the centre of the top left pixel at (0.5, 0.5), strongest first.
    pub fn points(&self) -> &[DVec2] {
        &self.points
    }
}

/// Finds the strongest SIFT features of an image.
///
/// # Errors
/// [`OpenCvError::Call`].
pub fn detect(image: &ImageU8, options: &MatchOptions) -> Result<Features, OpenCvError> {
    let mut sift = called("creating SIFT", SIFT::create_def())?;
    if image.samples().is_empty() {
        return Ok(Features { points: Vec::new(), descriptors: Mat::default() });
    }
    let mut grey = Mat::default();
    called("converting an image to grey", cvt_color_def(&mat_from_image(image)?, &mut grey, COLOR_RGB2GRAY))?;
    let mut keypoints = Vector::<KeyPoint>::new();
    called("detecting features", sift.detect(&grey, &mut keypoints, &no_array()))?;
    if keypoints.is_empty() {
        // For tiny images OpenCV's `compute` fails without key points.
        return Ok(Features { points: Vec::new(), descriptors: Mat::default() });
    }
    let mut strongest: Vec<KeyPoint> = keypoints.to_vec();
    strongest.sort_by(|a, b| {
        let place = |k: &KeyPoint| (k.pt().y, k.pt().x, k.size(), k.angle());
        let (a_place, b_place) = (place(a), place(b));
        b.response().total_cmp(&a.response()).then(a_place.partial_cmp(&b_place).unwrap_or(std::cmp::Ordering::Equal))
    });
    strongest.truncate(options.max_features);
    let mut keypoints: Vector<KeyPoint> = strongest.into_iter().collect();
    let mut descriptors = Mat::default();
    called("describing features", sift.compute(&grey, &mut keypoints, &mut descriptors))?;
    let pixel = |k: KeyPoint| DVec2::new(f64::from(k.pt().x), f64::from(k.pt().y)) + PIXEL_FROM_KEYPOINT;
    Ok(Features { points: keypoints.iter().map(pixel).collect(), descriptors })
}

/// Pairs of features that are each other's best match and pass the ratio test in both directions, in the order of the
/// first image's features.
///
/// # Errors
/// [`OpenCvError::Call`].
pub fn match_mutual(first: &Features, second: &Features, ratio: f64) -> Result<Vec<PointMatch>, OpenCvError> {
    if first.points.len() < 2 || second.points.len() < 2 {
        return Ok(Vec::new());
    }
    let forward = nearest(first, second, ratio)?;
    let backward = nearest(second, first, ratio)?;
    // A feature with several orientations would give the same match several times.
    let mut seen = BTreeSet::new();
    let mut is_new =
        move |m: &PointMatch| seen.insert([m.first.x, m.first.y, m.second.x, m.second.y].map(f64::to_bits));
    let agreed = forward.into_iter().enumerate().filter_map(|(from, to)| {
        let to = to?;
        let is_mutual = backward.get(to).copied().flatten() == Some(from);
        let points = || Some(PointMatch { first: *first.points.get(from)?, second: *second.points.get(to)? });
        is_mutual.then(points).flatten().filter(&mut is_new)
    });
    Ok(agreed.collect())
}

/// For each feature of `from`, the one of `to` that passes the ratio test.
fn nearest(from: &Features, to: &Features, ratio: f64) -> Result<Vec<Option<usize>>, OpenCvError> {
    let matcher = called("creating a matcher", BFMatcher::new(NORM_L2, false))?;
    let mut candidates = Vector::<Vector<DMatch>>::new();
    called("matching features", matcher.knn_train_match_def(&from.descriptors, &to.descriptors, &mut candidates, 2))?;
    let mut best = vec![None; from.points.len()];
    for two in &candidates {
        let (Ok(one), Ok(other)) = (two.get(0), two.get(1)) else { continue };
        let is_distinct = f64::from(one.distance) < ratio * f64::from(other.distance);
        let (Ok(query), Ok(train)) = (usize::try_from(one.query_idx), usize::try_from(one.train_idx)) else { continue };
        if let Some(slot) = best.get_mut(query).filter(|_| is_distinct) {
            *slot = Some(train);
        }
    }
    Ok(best)
}

/// Which matches are inliers of one fundamental matrix, estimated from the matches alone (MAGSAC++, Barath et al. 2020,
/// as OpenCV's `USAC_MAGSAC`), independent of the cameras. All `false` if there are fewer than 12 matches.
///
/// # Errors
/// [`OpenCvError::Call`].
pub fn epipolar_inliers(matches: &[PointMatch], inlier_px: f64) -> Result<Vec<bool>, OpenCvError> {
    if matches.len() < MIN_FOR_FUNDAMENTAL {
        return Ok(vec![false; matches.len()]);
    }
    let points = |of: fn(&PointMatch) -> DVec2| -> Vector<Point2d> {
        matches.iter().map(|points| Point2d::new(of(points).x, of(points).y)).collect()
    };
    let (first, second) = (points(|m| m.first), points(|m| m.second));
    let mut mask = Vector::<u8>::new();
    let method = USAC_MAGSAC;
    called(
        "fitting a fundamental matrix",
        find_fundamental_mat(&first, &second, method, inlier_px, CONFIDENCE, MAX_ITERATIONS, &mut mask),
    )?;
    Ok((0..matches.len()).map(|index| mask.get(index).is_ok_and(|kept| kept > 0)).collect())
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics, WorldFromCamera};
    use atsplat_numeric::median;
    use glam::{DMat3, DQuat, DVec3, EulerRot};

    use super::*;
    use crate::linked::test_images::{blobs, shifted_noise};

    #[test]
    fn features_are_at_the_centres_of_blobs() {
        let (image, centres) = blobs(320, 240);
        let features = detect(&image, &MatchOptions::default()).unwrap();
        let offsets: Vec<DVec2> = centres
            .iter()
            .filter_map(|centre| {
                let distance = |point: &&DVec2| point.distance(*centre);
                let nearest = features.points().iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
                (nearest.distance(*centre) < 1.0).then_some(*nearest - *centre)
            })
            .collect();
        assert!(offsets.len() > centres.len() / 2, "{} of {} blobs found", offsets.len(), centres.len());
        let dx = median(offsets.iter().map(|o| o.x)).unwrap();
        let dy = median(offsets.iter().map(|o| o.y)).unwrap();
        assert!(dx.abs() < 0.05 && dy.abs() < 0.05, "biased by ({dx:.3}, {dy:.3}) px");
    }

    #[test]
    fn a_shift_is_matched_with_subpixel_accuracy() {
        let (first, second) = (shifted_noise(300, 200, 0, 0), shifted_noise(300, 200, 7, 4));
        let features = |image| detect(image, &MatchOptions::default()).unwrap();
        let matches = match_mutual(&features(&first), &features(&second), 0.8).unwrap();
        assert!(matches.len() > 50, "{} matches", matches.len());
        let errors = matches.iter().map(|m| (m.first - m.second - DVec2::new(7.0, 4.0)).length());
        let error = median(errors).unwrap();
        assert!(error < 0.05, "median error {error} px");
    }

    #[test]
    fn matching_is_deterministic_and_symmetric() {
        let (first, second) = (shifted_noise(200, 150, 0, 0), shifted_noise(200, 150, 5, -3));
        let options = MatchOptions::default();
        let features = |image| detect(image, &options).unwrap();
        let forth = match_mutual(&features(&first), &features(&second), 0.8).unwrap();
        assert_eq!(forth, match_mutual(&features(&first), &features(&second), 0.8).unwrap());
        let back = match_mutual(&features(&second), &features(&first), 0.8).unwrap();
        let swapped = |m: &PointMatch| PointMatch { first: m.second, second: m.first };
        assert_eq!(forth.len(), back.len());
        assert!(forth.iter().all(|m| back.contains(&swapped(m))));
    }

    /// A pinhole camera at `centre`.
    fn camera(rotation: DQuat, centre: DVec3) -> Camera {
        let pose = WorldFromCamera::new(DMat3::from_quat(rotation), centre).unwrap();
        Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.8, 0.8 * 640.0 / 480.0, 0.5, 0.5).unwrap())
    }

    #[test]
    fn wrong_matches_are_outliers() {
        let first = camera(DQuat::from_rotation_y(0.1), DVec3::ZERO);
        let second = camera(DQuat::from_euler(EulerRot::YXZ, -0.1, 0.1, 0.0), DVec3::new(1.0, 0.2, 0.0));
        let pixel = |camera: &Camera, point: DVec3| {
            let seen = camera.camera_from_world.transform_point(point);
            let k = camera.intrinsics.pixel_from_normalized(ImageSize { width: 640, height: 480 });
            DVec2::new(k.fx * seen.x / seen.z + k.cx, k.fy * seen.y / seen.z + k.cy)
        };
        let unit = |index: u32, step: f64| (f64::from(index) * step).fract();
        let points = (0..200u32).map(|i| {
            let depth = 4.0 + 12.0 * unit(i, 0.618_034);
            DVec3::new((unit(i, 0.754_878) - 0.5) * depth, (unit(i, 0.569_84) - 0.5) * 0.8 * depth, depth)
        });
        let matched = |point| PointMatch { first: pixel(&first, point), second: pixel(&second, point) };
        let mut matches: Vec<PointMatch> = points.map(matched).collect();
        let right = matches.len();
        let wrong: Vec<PointMatch> = matches
            .iter()
            .zip(matches.iter().skip(17))
            .take(60)
            .map(|(one, other)| PointMatch { first: one.first, second: other.second })
            .collect();
        matches.extend(wrong);
        let kept = epipolar_inliers(&matches, 1.5).unwrap();
        assert!(kept[..right].iter().all(|k| *k), "every true match stays");
        let wrong = kept[right..].iter().filter(|k| **k).count();
        assert!(wrong < 10, "{wrong} of 60 wrong matches stay: only those close to their epipolar line may");
    }

    #[test]
    fn flat_and_tiny_images_have_no_matches() {
        let flat = ImageU8::new(64, 64, vec![128; 64 * 64 * 3]).unwrap();
        let dot = ImageU8::new(1, 1, vec![0; 3]).unwrap();
        let none = ImageU8::new(0, 0, vec![]).unwrap();
        let features = |image| detect(image, &MatchOptions::default()).unwrap();
        for image in [&flat, &dot, &none] {
            assert_eq!(match_mutual(&features(image), &features(&flat), 0.8).unwrap(), vec![]);
        }
    }
}
