//! The times that a dataset records for its cameras.

use std::path::Path;

use anyhow::bail;
use atsplat_scene::camera_file::FileCamera;

/// Microseconds from the first of these cameras of a file to each of them.
///
/// # Errors
/// If the file records no times, or they do not increase from each camera to the next.
pub(super) fn micros(file: &Path, cameras: &[FileCamera]) -> anyhow::Result<Vec<f64>> {
    let Some(times) = cameras.iter().map(|camera| camera.timestamp_micros).collect::<Option<Vec<i64>>>() else {
        bail!(
            "--spacing time: {} records no times of its cameras (numbers of frames are none): use --spacing distance, or \
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
                 after {before} µs of frame {} ({:?}): choose cameras in the order of their times with --frames, or use \
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
