use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use atsplat_camera::{CameraFromWorld, Distortion};
use atsplat_numeric::Tolerance;

use crate::checks::image_mismatch::stretched_pixels;
use crate::checks::intrinsics_unit::{far_off_middle, wrong_unit};
use crate::checks::lens_end::LensEnds;
use crate::checks::outlier_cameras::outlier_cameras;
use crate::checks::still_cameras::one_pose;
use crate::{Frame, FrameImage, Scene, TimestampSource, WarningKind, Warnings};

/// pixelSplat's loader drops a scene whose field of view exceeds this (`dataset_re10k.py`), in degrees.
const WIDEST_FIELD_OF_VIEW: f64 = 100.0;

/// Coordinates beyond this are implausible: the Earth's radius is 6.4e6 m, and no dataset uses a unit below the metre.
const FARTHEST_COORDINATE: f64 = 1e9;

/// Largest entry of `R Rᵀ − I` of a rotation that was rounded to six decimals is 2e-6, to f32 or nine decimals far less. Of
/// a sheared rotation, or one stretched along one axis and compressed along another, the determinant can be 1.
const ROUNDED: Tolerance = Tolerance::absolute(1e-5);

/// How far the principal point may be from the centre, in image widths and heights.
const CENTRED: Tolerance = Tolerance::absolute(1e-3);

/// Warns about suspicious but usable cameras of a scene: at most one warning of each kind, with the number of affected
/// frames and the first of them.
///
/// Unusable intrinsics never get here: no `Camera` can be constructed from them, and the parser reports the error. A pose that is not
/// finite or not a rotation is a [`FrameImage::Unposed`].
pub(crate) fn report_cameras(scene: &Scene, times: TimestampSource, warnings: &mut Warnings) {
    let repeated = report_repeated_images(scene, times, warnings);
    report_timestamps(scene, times, &repeated, warnings);
    if let Some(detail) = outlier_cameras(scene, FARTHEST_COORDINATE) {
        warnings.push(WarningKind::OutlierCamera, &scene.key, detail);
    }
    if let Some(detail) = one_pose(scene) {
        warnings.push(WarningKind::RepeatedPose, &scene.key, detail);
    }
    let mut report = |kind, problem: &dyn Fn(&Frame) -> Option<String>| {
        if let Some(detail) = count_and_first(&scene.frames, "frames", problem) {
            warnings.push(kind, &scene.key, detail);
        }
    };
    report(WarningKind::BadCamera, &|frame| {
        if let FrameImage::Unposed { reason, image } = &frame.image {
            let of_image = image.listed_file().map(|path| format!(" of {}", path.display())).unwrap_or_default();
            return Some(format!("no usable pose{of_image}: {reason}"));
        }
        let centre = frame.camera.camera_from_world.inverse().centre();
        (!centre.is_finite()).then(|| format!("its centre overflows: {centre}"))
    });
    report(WarningKind::DistantCamera, &|frame| {
        let centre = frame.camera.camera_from_world.inverse().centre();
        let farthest = centre.abs().max_element();
        let is_distant = centre.is_finite() && farthest > FARTHEST_COORDINATE;
        is_distant
            .then(|| format!("expected coordinates of its centre within {FARTHEST_COORDINATE:e}, found {farthest:e}"))
    });
    report(WarningKind::ImperfectRotation, &|frame| imperfect_rotation(&frame.camera.camera_from_world));
    report(WarningKind::ImplausibleIntrinsics, &|frame| {
        let is_off = || far_off_middle(&frame.camera.intrinsics);
        let (k, size) = (&frame.camera.intrinsics, frame.stated_size);
        wrong_unit(k, size).or_else(is_off).or_else(|| stretched_pixels(k, size?))
    });
    let has_unit = |frame: &Frame| wrong_unit(&frame.camera.intrinsics, frame.stated_size).is_none();
    // For intrinsics in another unit or of another size, the next two warnings would name a consequence instead of the cause.
    let is_plausible = |frame: &Frame| has_unit(frame) && far_off_middle(&frame.camera.intrinsics).is_none();
    report(WarningKind::WideFieldOfView, &|frame| {
        let angles = frame.camera.intrinsics.field_of_view();
        let (x, y) = (angles.x.to_degrees(), angles.y.to_degrees());
        let fine = x <= WIDEST_FIELD_OF_VIEW && y <= WIDEST_FIELD_OF_VIEW;
        (!fine && is_plausible(frame)).then(|| format!("{x:.1}° × {y:.1}°"))
    });
    report(WarningKind::OffCentrePrincipalPoint, &|frame| {
        let (cx, cy) = (frame.camera.intrinsics.cx, frame.camera.intrinsics.cy);
        let fine = CENTRED.accepts(cx, 0.5) && CENTRED.accepts(cy, 0.5);
        (!fine && is_plausible(frame)).then(|| format!("cx {cx:.5}, cy {cy:.5}"))
    });
    report(WarningKind::LensDistortion, &|frame| {
        let distortion = frame.camera.distortion;
        (distortion != Distortion::None).then(|| distortion.to_string())
    });
    let ends = LensEnds::default();
    report(WarningKind::LensEndsInside, &|frame| if has_unit(frame) { ends.inside(frame) } else { None });
}

/// What distinguishes the rotation of a pose from a rounded one; `None` if nothing does.
pub(crate) fn imperfect_rotation(pose: &CameraFromWorld) -> Option<String> {
    let (determinant, residual) = (pose.determinant(), pose.orthonormality_residual());
    if !Tolerance::NUMPY_ALLCLOSE.accepts(determinant, 1.0) {
        return Some(format!("expected det(R) = 1, found {determinant}"));
    }
    (!ROUNDED.accepts(residual, 0.0))
        .then(|| format!("expected R Rᵀ = I, found a deviation of {residual:.1e}; det(R) is 1"))
}

/// How many items have a problem, and the problem of the first; `None` if there is none. `name` is what the items are called.
pub(crate) fn count_and_first<T>(items: &[T], name: &str, problem: impl Fn(&T) -> Option<String>) -> Option<String> {
    let mut offenders = items.iter().enumerate().filter_map(|(at, item)| Some((at, problem(item)?)));
    let (first, detail) = offenders.next()?;
    let count = offenders.count() + 1;
    Some(format!("{count} of {} {name}, first {first}: {detail}", items.len()))
}

/// The frames whose image is an earlier frame's. Frames that share a given timestamp are left to [`report_timestamps`]:
/// images named after it are the same too.
fn report_repeated_images(scene: &Scene, times: TimestampSource, warnings: &mut Warnings) -> BTreeSet<usize> {
    let mut first_with: BTreeMap<&Path, usize> = BTreeMap::new();
    let mut repeated = Vec::new();
    for (at, frame) in scene.frames.iter().enumerate() {
        let (FrameImage::File(path) | FrameImage::Missing(path)) = &frame.image else { continue };
        let earlier = *first_with.entry(path).or_insert(at);
        let has_this_time =
            |earlier: &Frame| earlier.timestamp_micros.is_some_and(|time| frame.timestamp_micros == Some(time));
        let shares_time = times == TimestampSource::Given && scene.frames.get(earlier).is_some_and(has_this_time);
        if earlier != at && !shares_time {
            repeated.push((earlier, at, path));
        }
    }
    if let Some((earlier, at, path)) = repeated.first() {
        let (count, frames) = (repeated.len(), scene.frames.len());
        let detail = format!(
            "{count} of {frames} frames repeat an earlier image, first frame {at} that of frame {earlier}: {}",
            path.display()
        );
        warnings.push(WarningKind::DuplicateImage, &scene.key, detail);
    }
    repeated.into_iter().map(|(_, at, _)| at).collect()
}

/// Of frames whose image is `repeated`, a number in its name says nothing more.
fn report_timestamps(scene: &Scene, times: TimestampSource, repeated: &BTreeSet<usize>, warnings: &mut Warnings) {
    let what = match times {
        TimestampSource::Given => "timestamps",
        TimestampSource::FromNames => "numbers at the end of images' names",
    };
    let frames = scene.frames.iter().enumerate();
    let counted = frames.filter(|(at, _)| times == TimestampSource::Given || !repeated.contains(at));
    let timestamps: Vec<i64> = counted.filter_map(|(_, frame)| frame.timestamp_micros).collect();
    let descents = timestamps.windows(2).filter(|pair| matches!(pair, [a, b] if b < a)).count();
    if descents > 0 {
        let detail = format!("{what} go backwards {descents} times in {} frames", scene.frames.len());
        warnings.push(WarningKind::UnorderedTimestamps, &scene.key, detail);
    }
    let mut sorted = timestamps;
    sorted.sort_unstable();
    let repeats = sorted.windows(2).filter_map(|pair| match pair {
        [a, b] if a == b => Some(*a),
        _ => None,
    });
    let repeated: Vec<i64> = repeats.collect();
    if let Some(first) = repeated.first() {
        let detail = format!("{} {what} repeat, the smallest is {first}", repeated.len());
        warnings.push(WarningKind::DuplicateTimestamp, &scene.key, detail);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::re10k::parse_trajectory;
    use glam::DMat3;
    use std::path::Path;

    fn warnings_of(rows: &[&str]) -> Warnings {
        let mut warnings = Warnings::new();
        let scene = parse_trajectory(rows.join("\n").as_bytes(), Path::new("clip.txt")).unwrap().to_scene("clip");
        report_cameras(&scene, TimestampSource::Given, &mut warnings);
        warnings
    }

    #[test]
    fn a_good_scene_has_no_warnings() {
        let rows =
            ["1 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0", "2 0.5 0.9 0.5009 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0"];
        assert_eq!(warnings_of(&rows).total(), 0);
    }

    /// Geodetic coordinates in metres are large but valid.
    #[test]
    fn geodetic_coordinates_are_not_distant() {
        let rows = ["1 0.5 0.9 0.5 0.5 0 0 1 0 0 -500000 0 1 0 5800000 0 0 1 120"];
        assert_eq!(warnings_of(&rows).total(), 0);
    }

    /// As structure from motion places an image that it could not register; one beyond 1e9 is reported as distant alone.
    #[test]
    fn a_camera_far_outside_the_others_is_counted() {
        for (x, kind) in [("-1e6", WarningKind::OutlierCamera), ("-1e30", WarningKind::DistantCamera)] {
            let row = |at: usize, x: &str| format!("{at} 0.5 0.9 0.5 0.5 0 0 1 0 0 {x} 0 1 0 0 0 0 1 0");
            let mut rows: Vec<String> = (0..9).map(|at| row(at, &format!("-0.{at}"))).collect();
            rows.push(row(9, x));
            let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
            let warnings = warnings_of(&rows);
            assert_eq!(warnings.counts().collect::<Vec<_>>(), [(kind, 1)]);
            assert!(warnings.kept()[0].detail.starts_with("1 of 10 frames, first 9: "), "{:?}", warnings.kept());
        }
    }

    /// As where poses were lost; a few still frames are those of a video.
    #[test]
    fn a_scene_with_one_pose_is_reported() {
        let row = |at: usize, x: &str| format!("{at} 0.5 0.9 0.5 0.5 0 0 1 0 0 {x} 0 1 0 0 0 0 1 0");
        for (last, reported) in [("-0.3", 1), ("-0.4", 0)] {
            let rows = [row(0, "-0.3"), row(1, "-0.3"), row(2, "-0.3"), row(3, last)];
            let warnings = warnings_of(&rows.each_ref().map(String::as_str));
            assert_eq!((warnings.count(WarningKind::RepeatedPose), warnings.total()), (reported, reported), "{last}");
        }
    }

    /// A scale changes the determinant, a shear does not; rounding to six decimals changes neither noticeably.
    #[test]
    fn the_warning_says_what_is_wrong_with_a_rotation() {
        let row = |rotation: DMat3| {
            let [x, y, z] = [0, 1, 2].map(|row| rotation.row(row)).map(|r| format!("{:.6} {:.6} {:.6}", r.x, r.y, r.z));
            format!("1 0.5 0.9 0.5 0.5 0 0 {x} 0 {y} 0 {z} 0")
        };
        let turned = |degrees: f64| {
            DMat3::from_rotation_z(degrees.to_radians()) * DMat3::from_rotation_x(0.7) * DMat3::from_rotation_y(-0.4)
        };
        for degrees in 0..360 {
            assert_eq!(warnings_of(&[&row(turned(f64::from(degrees)))]).total(), 0, "{degrees}°");
        }
        let shear = |by: f64| DMat3::from_cols_array(&[1.0, 0.0, 0.0, by, 1.0, 0.0, 0.0, 0.0, 1.0]);
        for (rotation, expected) in [
            (turned(20.0) * 1.0001, "expected det(R) = 1, found 1.0003"),
            (turned(20.0) * shear(2e-4), "expected R Rᵀ = I, found a deviation of "),
        ] {
            let warnings = warnings_of(&[&row(rotation)]);
            assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::ImperfectRotation, 1)]);
            assert!(warnings.kept()[0].detail.contains(expected), "{:?}", warnings.kept());
        }
    }

    #[test]
    fn each_problem_has_its_kind_and_is_counted_once_per_scene() {
        let cases = [
            (WarningKind::BadCamera, "5 0.5 0.9 0.5 0.5 0 0 0.8 0.6 0 1.7e308 -0.6 0.8 0 1.7e308 0 0 1 0"),
            (WarningKind::DistantCamera, "5 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 -1e30 0 0 1 0"),
            (WarningKind::ImperfectRotation, "5 0.5 0.9 0.5 0.5 0 0 1.0001 0 0 0 0 1 0 0 0 0 1 0"),
            (WarningKind::ImperfectRotation, "5 0.5 0.9 0.5 0.5 0 0 1.004 0 0 0 0 0.99601593625498 0 0 0 0 1 0"),
            (WarningKind::WideFieldOfView, "5 0.4 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0"),
            (WarningKind::ImplausibleIntrinsics, "5 53.9 95.8 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0"),
            (WarningKind::ImplausibleIntrinsics, "5 53.9 95.8 32 18 0 0 1 0 0 0 0 1 0 0 0 0 1 0"),
            (WarningKind::ImplausibleIntrinsics, "5 0.12 0.22 0.125 0.125 0 0 1 0 0 0 0 1 0 0 0 0 1 0"),
            (WarningKind::OffCentrePrincipalPoint, "5 0.5 0.9 0.5 0.502 0 0 1 0 0 0 0 1 0 0 0 0 1 0"),
            (WarningKind::UnorderedTimestamps, "0 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0"),
            (WarningKind::DuplicateTimestamp, "1 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0"),
        ];
        for (kind, row) in cases {
            let warnings = warnings_of(&["1 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0", row]);
            assert_eq!(warnings.counts().collect::<Vec<_>>(), [(kind, 1)]);
        }
    }
}
