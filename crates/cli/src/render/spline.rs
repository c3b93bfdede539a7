//! A smooth path through the cameras of a file.

use std::path::Path;

use anyhow::bail;
use atsplat_camera::{Camera, CameraSpline, Spacing};
use atsplat_eval::rendering::PathSpacing;
use atsplat_scene::camera_file::FileCamera;

use super::views::same_aspect_ratio;

/// Samples `count` cameras along the path.
///
/// # Errors
/// If the cameras have several aspect ratios, times are needed and missing, or no path goes through these cameras.
pub(super) fn sample(
    file: &Path,
    cameras: &[FileCamera],
    spacing: PathSpacing,
    closed: bool,
    count: usize,
) -> anyhow::Result<Vec<Camera>> {
    require_same_aspect_ratio(cameras)?;
    let keys: Vec<Camera> = cameras.iter().map(|key| key.camera).collect();
    let spline = match spacing {
        PathSpacing::Time => CameraSpline::timed(micros(file, cameras)?, keys)?,
        _ if closed => CameraSpline::closed(keys)?,
        _ => CameraSpline::open(keys)?,
    };
    let spacing = if spacing == PathSpacing::ArcLength { Spacing::ArcLength } else { Spacing::Time };
    Ok(spline.resampled(count, spacing)?)
}

/// Rejects key cameras with different aspect ratios: the path has one image size, and normalised intrinsics would be stretched.
fn require_same_aspect_ratio(keys: &[FileCamera]) -> anyhow::Result<()> {
    let mut sized = keys.iter().filter_map(|key| Some((key, key.size?)));
    let Some((first, shape)) = sized.next() else { return Ok(()) };
    match sized.find(|(_, size)| !same_aspect_ratio(*size, shape)) {
        Some((other, size)) => bail!(
            "expected cameras of one aspect ratio, found {size} of {:?} and {shape} of {:?}; choose cameras with --frames",
            other.name,
            first.name
        ),
        None => Ok(()),
    }
}

/// Microseconds from the first of these cameras of a file to each of them.
fn micros(file: &Path, cameras: &[FileCamera]) -> anyhow::Result<Vec<f64>> {
    let Some(times) = cameras.iter().map(|camera| camera.timestamp_micros).collect::<Option<Vec<i64>>>() else {
        bail!(
            "--spacing time: {} records no times of its cameras (frame numbers are not times); use --spacing distance, or \
             --spacing even for as many views between any two cameras",
            file.display()
        )
    };
    for (pair, cameras) in times.windows(2).zip(cameras.windows(2)) {
        if let ([before, found], [previous, camera]) = (pair, cameras)
            && found <= before
        {
            bail!(
                "--spacing time: expected times that increase from camera to camera, found {found} µs of frame {} ({:?}) \
                 after {before} µs of frame {} ({:?}); choose cameras in the order of their times with --frames, or use \
                 --spacing distance or even",
                camera.number,
                camera.name,
                previous.number,
                previous.name
            );
        }
    }
    let first = times.first().copied().unwrap_or(0);
    Ok(times.iter().map(|time| time.abs_diff(first) as f64).collect())
}
