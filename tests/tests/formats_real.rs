//! The formats on real captures: what each holds is counted by eye or by an independent reader once, and
//! written down here.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use atsplat_camera::{Distortion, ImageSize};
use atsplat_numeric::Tolerance;
use atsplat_pixels::DecodeLimits;
use atsplat_scene::nerfstudio::NerfstudioOptions;
use atsplat_scene::re10k::{read_trajectory, write_trajectory};
use atsplat_scene::{
    Dataset, Format, FrameImage, ImageFolder, OpenOptions, Scene, SceneError, SceneSource, WarningKind, Warnings,
    load_scenes, open, open_with,
};
use atsplat_tests::shared_data;

const KEY: &str = "000c3ab189999a83";

fn opened(path: &Path) -> Dataset {
    open(path, &mut Warnings::new()).unwrap()
}

fn loaded(dataset: &Dataset) -> (Scene, Warnings) {
    let mut warnings = Warnings::new();
    let scene = dataset.load(&dataset.keys()[0], &mut warnings).unwrap();
    (scene, warnings)
}

fn found(scene: &Scene) -> usize {
    scene.frames.iter().filter(|frame| matches!(frame.image, FrameImage::File(_))).count()
}

fn counts(warnings: &Warnings) -> Vec<(WarningKind, u64)> {
    warnings.counts().collect()
}

#[test]
fn re10k_scene_with_numbered_frames() {
    let Some(data) = shared_data("re10k_scene_with_numbered_frames") else { return };
    let dataset = opened(&data.join("re10k").join(KEY));
    assert_eq!((dataset.format, dataset.keys()), (Format::Re10k, &[KEY.to_owned()][..]));
    let (scene, warnings) = loaded(&dataset);
    assert_eq!((scene.frames.len(), found(&scene)), (279, 279));
    assert_eq!(scene.url, None, "the first line is a comment");
    assert_eq!(counts(&warnings), [], "{:?}", warnings.kept());
    let last = &scene.frames[278];
    let FrameImage::File(path) = &last.image else { panic!("{:?}", last.image) };
    assert!(path.ends_with("images/00278.png"), "row n is image n: {}", path.display());
    assert_eq!(scene.frames[0].timestamp_micros, Some(45_979_267));
    let size = ImageSize { width: 256, height: 256 };
    assert_eq!(last.size(KEY, 278).unwrap(), size);
    let image = scene.decode_any_shape(278, &DecodeLimits::default()).unwrap();
    assert_eq!((image.width(), image.height()), (256, 256));
    let crop = scene.decode(278, &DecodeLimits::default());
    assert!(
        matches!(crop, Err(SceneError::ImageMismatch { frame: 278, .. })),
        "cameras of 16:9, images of 1:1: {crop:?}"
    );
}

/// The same capture's `cameras.json`, from another project, holds camera-to-world quaternions (x, y, z, w)
/// and centres: an independent reading of the rows' direction and axes.
#[test]
fn re10k_rows_are_world_to_camera() {
    let Some(data) = shared_data("re10k_rows_are_world_to_camera") else { return };
    let folder = data.join("re10k").join(KEY);
    let (scene, _) = loaded(&opened(&folder));
    let cameras: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("cameras.json")).unwrap()).unwrap();
    let cameras = cameras.as_array().unwrap();
    assert_eq!(cameras.len(), scene.frames.len());
    for (frame, camera) in scene.frames.iter().zip(cameras) {
        let numbers = |name: &str| -> Vec<f64> {
            camera[name].as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
        };
        let pose = frame.camera.camera_from_world.inverse();
        Tolerance::F32_ROUND_TRIP.assert(pose.centre().to_array(), numbers("cam_trans"), &frame.name);
        let [x, y, z, w]: [f64; 4] = numbers("cam_quat").try_into().unwrap();
        let forward = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)];
        Tolerance::F32_ROUND_TRIP.assert(pose.forward().to_array(), forward, &frame.name);
        assert_eq!(camera["timestamp"].as_i64(), frame.timestamp_micros);
    }
}

#[test]
fn chunk_and_text_hold_the_same_cameras() {
    let Some(data) = shared_data("chunk_and_text_hold_the_same_cameras") else { return };
    let (text, _) = loaded(&opened(&data.join("re10k").join(KEY)));
    let dataset = opened(&data.join("re10k/chunk"));
    assert_eq!(dataset.format, Format::TorchChunks);
    let (chunk, warnings) = loaded(&dataset);
    assert_eq!((&chunk.key, chunk.frames.len(), warnings.total()), (&text.key, text.frames.len(), 0));
    for (a, b) in text.frames.iter().zip(&chunk.frames) {
        assert_eq!(a.timestamp_micros, b.timestamp_micros);
        let rows = |frame: &atsplat_scene::Frame| frame.camera.camera_from_world.to_rows();
        Tolerance::F32_ROUND_TRIP.assert(rows(b), rows(a), &a.name);
    }
}

#[test]
fn cameractrl_trajectories_alone() {
    let Some(data) = shared_data("cameractrl_trajectories_alone") else { return };
    let folder = data.join("trajectories/cameractrl_16f");
    let dataset = opened(&folder);
    assert_eq!((dataset.format, dataset.keys().len()), (Format::Re10k, 10));
    let (mut warnings, keys) = (Warnings::new(), dataset.keys());
    let scenes = load_scenes(&dataset, keys, &mut warnings, &|_| ());
    assert_eq!(counts(&warnings), [], "{:?}", warnings.kept());
    for scene in &scenes {
        assert_eq!(scene.frames.len(), 16, "{}", scene.key);
        assert!(scene.url.as_deref().is_some_and(|url| url.starts_with("https://www.youtube.com/")), "{:?}", scene.url);
        assert!(scene.frames.iter().all(|frame| matches!(frame.image, FrameImage::Absent)));
    }
}

#[test]
fn official_trajectories_are_written_back_byte_for_byte() {
    let Some(data) = shared_data("official_trajectories_are_written_back_byte_for_byte") else { return };
    let folder = data.join("trajectories/cameractrl_16f");
    let mut compared = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let mut text = Vec::new();
        write_trajectory(&read_trajectory(&path).unwrap(), &mut text).unwrap();
        let original = String::from_utf8(std::fs::read(&path).unwrap()).unwrap();
        let trimmed: String = original.lines().flat_map(|line| [line.trim_end(), "\n"]).collect();
        assert_eq!(String::from_utf8(text).unwrap(), trimmed, "{}", path.display());
        compared += 1;
    }
    assert_eq!(compared, 10);
}

#[test]
fn fox_misses_images_and_keeps_its_lens() {
    let Some(data) = shared_data("fox_misses_images_and_keeps_its_lens") else { return };
    let dataset = opened(&data.join("fox"));
    assert_eq!((dataset.format, dataset.keys()), (Format::Nerfstudio, &["fox".to_owned()][..]));
    let (scene, warnings) = loaded(&dataset);
    assert_eq!((scene.frames.len(), found(&scene)), (67, 50));
    assert_eq!(warnings.count(WarningKind::MissingImage), 17);
    assert_eq!(warnings.count(WarningKind::LensDistortion), 1);
    let frame = &scene.frames[0];
    let lens = Distortion::OpenCv { k1: 0.057_842_1, k2: -0.080_509_9, k3: 0.0, p1: -0.000_980_296, p2: 0.000_155_75 };
    assert_eq!(frame.camera.distortion, lens);
    assert_eq!((frame.name.as_str(), frame.timestamp_micros), ("0001", Some(1)));
    let stated = ImageSize { width: 1080, height: 1920 };
    assert_eq!((frame.stated_size, frame.size("fox", 0).unwrap()), (Some(stated), stated));
    let k = frame.camera.intrinsics.pixel_from_normalized(stated);
    Tolerance::relative(1e-12).assert([k.fx, k.fy, k.cx, k.cy], [1375.52, 1374.49, 554.558, 965.268], "pixels");
}

#[test]
fn desk_comes_in_two_sizes() {
    let Some(data) = shared_data("desk_comes_in_two_sizes") else { return };
    let folder = data.join("dl3dv_like/desk");
    for (factor, images, elsewhere, size) in [(8, 80, 0, (480, 270)), (4, 120, 120, (960, 540))] {
        let nerfstudio = NerfstudioOptions { images: ImageFolder::Downscaled(factor), ..NerfstudioOptions::default() };
        let options = OpenOptions { nerfstudio, ..OpenOptions::default() };
        let dataset = open_with(&folder, &options, &mut Warnings::new()).unwrap();
        assert_eq!(dataset.keys(), ["desk"]);
        let (scene, warnings) = loaded(&dataset);
        assert_eq!((scene.frames.len(), found(&scene)), (120, images), "images_{factor}");
        assert_eq!(warnings.count(WarningKind::MissingImage), 120 - images as u64);
        assert_eq!(warnings.count(WarningKind::ImageAtOtherPath), elsewhere, "the file says .png");
        assert_eq!(scene.frames[7].timestamp_micros, Some(8));
        let found = scene.frames[0].size("desk", 0).unwrap();
        assert_eq!((found.width, found.height), size);
        let k = scene.frames[0].camera.intrinsics;
        let expected = [1_658.434_163_349_556_7 / 1920.0, 1_660.650_683_901_539_7 / 1080.0];
        Tolerance::relative(1e-14).assert([k.fx, k.fy], expected, "w and h are the file's, not the image's");
    }
}

#[test]
fn desk_poses_are_opengl() {
    let Some(data) = shared_data("desk_poses_are_opengl") else { return };
    let (scene, _) = loaded(&opened(&data.join("dl3dv_like/desk")));
    let pose = scene.frames[0].camera.camera_from_world.inverse();
    let close = |found: [f64; 3], expected: [f64; 3], what| Tolerance::F64.assert(found, expected, what);
    close(pose.centre().to_array(), [3.577_711_240_988_237_7, -5.126_751_599_046_221, 2.917_440_443_050_852], "centre");
    close(
        pose.right().to_array(),
        [0.074_740_426_176_177_14, 0.997_150_379_421_979_7, 0.010_246_439_069_526_072],
        "right",
    );
    close(
        pose.forward().to_array(),
        [0.115_514_072_663_839_55, 0.001_548_677_556_735_585_6, -0.993_304_636_360_083_3],
        "forward is minus the file's third column",
    );
}

/// Phone images are taken upright in a world with +z up: were the OpenGL axes taken for OpenCV's, `down`
/// would point to the sky.
#[test]
fn fox_cameras_stand_upright() {
    let Some(data) = shared_data("fox_cameras_stand_upright") else { return };
    let (scene, _) = loaded(&opened(&data.join("fox")));
    let downs: Vec<f64> = scene.frames.iter().map(|frame| frame.camera.camera_from_world.inverse().down().z).collect();
    assert!(downs.iter().all(|down| *down < -0.5), "{downs:?}");
}

#[test]
fn threads_change_nothing() {
    let Some(data) = shared_data("threads_change_nothing") else { return };
    let load = || {
        let dataset = opened(&data.join("trajectories/cameractrl_16f"));
        let mut warnings = Warnings::new();
        let mut keys = dataset.keys().to_vec();
        keys.push("no such scene".to_owned());
        let scenes = load_scenes(&dataset, &keys, &mut warnings, &|_| ());
        format!("{scenes:?} {warnings:?}")
    };
    let expected = load();
    assert!(expected.contains("UnreadableScene"), "an unknown key is counted, not fatal");
    for _ in 0..5 {
        assert_eq!(load(), expected);
    }
}
