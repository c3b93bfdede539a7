//! The times that a dataset records for its cameras.

use std::path::Path;

use anyhow::bail;
use atsplat_rooms::has_times;
use atsplat_scene::camera_file::FileCamera;
use atsplat_scene::{SceneSource as _, Warnings, open, scene_key};

/// Microseconds from the first of these cameras of a file to each of them.
///
/// # Errors
/// If the file records no times, or they do not increase from each camera to the next.
pub(super) fn micros(file: &Path, scene: Option<&str>, cameras: &[FileCamera]) -> anyhow::Result<Vec<f64>> {
    let Some(times) = recorded(file, scene, cameras) else {
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

/// The times of these cameras, if the file has all of them. It was read, and warned of, before.
fn recorded(file: &Path, scene: Option<&str>, cameras: &[FileCamera]) -> Option<Vec<i64>> {
    let mut known = Warnings::new();
    // Camera files that are no datasets have no times.
    let dataset = open(file, &mut known).ok()?;
    let mut scene = dataset.load(scene_key(&dataset, scene).ok()?, &mut known).ok()?;
    let time = |camera: &FileCamera| {
        scene.frames.get(camera.number).filter(|frame| frame.name == camera.name)?.timestamp_micros
    };
    let times = cameras.iter().map(time).collect::<Option<Vec<i64>>>()?;
    scene.frames.retain(|frame| frame.timestamp_micros.is_some());
    has_times(&scene).then_some(times)
}
