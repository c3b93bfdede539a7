//! Replays the corpora of the fuzz targets: each input gives a value or a typed error, never a panic.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use atsplat_camera::ImageSize;
use atsplat_scene::camera_file::{LensOfPoses, read};
use atsplat_scene::colmap::{Encoding, parse_cameras, parse_images, parse_points};
use atsplat_scene::nerfstudio::{NerfstudioOptions, NerfstudioScenes, parse_transforms};
use atsplat_scene::re10k::{parse_trajectory, write_trajectory};
use atsplat_scene::{SceneSource as _, Warnings};

/// Runs a parser on each input of one target; returns how many were accepted and rejected.
fn replay(target: &str, accepts: impl Fn(&[u8], &Path) -> bool) -> (usize, usize) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let mut inputs: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    inputs.sort();
    let accepted = inputs.iter().filter(|path| accepts(&std::fs::read(path).unwrap(), path)).count();
    (accepted, inputs.len() - accepted)
}

/// The corpora contain valid and invalid inputs: a parser that accepts or rejects everything is broken.
fn assert_both(target: &str, (accepted, rejected): (usize, usize)) {
    assert!(accepted >= 3 && rejected >= 2, "{target}: {accepted} accepted, {rejected} rejected");
}

/// Lists of poses are cameras with a lens, and other files without one.
#[test]
fn camera_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cameras.json");
    let of_poses = LensOfPoses { fov: Some(60.0), size: Some(ImageSize { width: 64, height: 48 }) };
    for lens in [LensOfPoses::default(), of_poses] {
        let counts = replay("camera_file", |bytes, _| {
            std::fs::write(&file, bytes).unwrap();
            read(&file, None, lens, &mut Warnings::new()).is_ok_and(|cameras| !cameras.is_empty())
        });
        assert!(counts.0 >= 2 && counts.1 >= 2, "camera_file: {counts:?}");
    }
}

#[test]
fn re10k_trajectory() {
    let counts = replay("re10k_trajectory", |bytes, path| {
        let Ok(mut trajectory) = parse_trajectory(bytes, path) else { return false };
        trajectory.header = None;
        let mut text = Vec::new();
        write_trajectory(&trajectory, &mut text).unwrap();
        assert_eq!(parse_trajectory(&text, path).unwrap(), trajectory, "{}", path.display());
        true
    });
    assert_both("re10k_trajectory", counts);
}

#[test]
fn transforms_json() {
    assert_both("transforms_json", replay("transforms_json", |bytes, path| parse_transforms(bytes, path).is_ok()));
    // No input has images, so a camera needs a size in the file.
    let (cameras, _) = replay("transforms_json", |_, path| {
        let scenes = NerfstudioScenes::open(path, NerfstudioOptions::default(), &mut Warnings::new()).unwrap();
        scenes.load(&scenes.keys()[0], &mut Warnings::new()).is_ok()
    });
    assert!(cameras >= 6, "transforms_json: {cameras} with cameras");
}

#[test]
fn colmap_text_and_binary() {
    for (target, encoding) in [("colmap_text", Encoding::Text), ("colmap_binary", Encoding::Binary)] {
        let counts = replay(target, |bytes, path| {
            let Some((file, bytes)) = bytes.split_first() else { return false };
            match file % 3 {
                0 => parse_cameras(bytes, encoding, path)
                    .is_ok_and(|cameras| cameras.values().all(|camera| camera.lens("replay", path).is_ok())),
                1 => parse_images(bytes, encoding, path).is_ok(),
                _ => parse_points(bytes, encoding, path).is_ok(),
            }
        });
        assert!(counts.0 >= 3 && counts.1 >= 1, "{target}: {counts:?}");
    }
}
