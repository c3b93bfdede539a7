use std::cell::LazyCell;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use atsplat_camera::{Camera, ImageSize};
use atsplat_files::AtomicFile;
use atsplat_pixels::{DecodeLimits, ImageU8, encode_png};
use atsplat_scene::{Frame, Scene, WarningKind, Warnings, is_plain_name};
use serde_json::{Value, json};

use super::{OpenCvError, UndistortMode, Undistorter};

/// Frames of an undistorted scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UndistortedFrames {
    /// Images written.
    pub written: u64,
    /// Frames without a readable image. They keep their place in the list, with an image that is missing.
    pub skipped: u64,
}

/// Writes a scene's undistorted images as `<folder>/images/<frame>.png`, and their pinhole cameras as
/// `<folder>/transforms.json`. `progress` is called for each frame; images that cannot be read are in `warnings`. Their frames stay
/// in the list, because indices of protocols are positions in it. If no frame has a size, no list is written: readers reject one
/// without frames.
///
/// # Errors
/// [`OpenCvError::Lens`] if a frame's lens has no pinhole camera for `mode`, [`OpenCvError::Io`] and [`OpenCvError::Pixels`] if a
/// file cannot be written, and as [`Undistorter::new`]. Images may then remain, but no list, not even that of an earlier call.
pub fn undistort_scene(
    scene: &Scene,
    mode: UndistortMode,
    folder: &Path,
    warnings: &mut Warnings,
    progress: &dyn Fn(),
) -> Result<UndistortedFrames, OpenCvError> {
    let images = folder.join("images");
    std::fs::create_dir_all(&images).map_err(OpenCvError::io("creating a folder for images", &images))?;
    let list = folder.join("transforms.json");
    let list_file = AtomicFile::create(&list).map_err(OpenCvError::io("writing cameras", &list))?;
    // An earlier list must not stand next to images that are replaced one by one.
    atsplat_files::remove_if_exists(&list).map_err(OpenCvError::io("removing earlier cameras", &list))?;
    let mut recent = RecentMaps::default();
    let common = LazyCell::new(|| common_size(scene));
    let (mut frames, mut names, mut count) = (Vec::new(), BTreeSet::new(), UndistortedFrames::default());
    for (position, frame) in scene.frames.iter().enumerate() {
        progress();
        let image = readable_image(scene, position, frame, warnings);
        let size = image.as_ref().map(|image| ImageSize { width: image.width(), height: image.height() });
        // The intrinsics of a frame without an image are written for the stated or the common size.
        let Some(size) = size.or(frame.stated_size).or_else(|| *common) else {
            // No frame of the scene has a size.
            count.skipped += 1;
            continue;
        };
        let map = recent.map(frame.camera, size, mode)?;
        let mut name = format!("{}.png", unique_name(frame, position, &mut names));
        if let Some(image) = image {
            name = format!("images/{name}");
            let (path, straight) = (folder.join(&name), map.undistorter.undistort(&image)?);
            atsplat_files::write(&path, &encode_png(&straight)?).map_err(OpenCvError::io("writing an image", &path))?;
            count.written += 1;
        } else {
            // Never written, so that no image of an earlier run stands in.
            name = format!("missing/{name}");
            count.skipped += 1;
        }
        frames.push(frame_json(frame, &name, size, &map.undistorter));
    }
    if frames.is_empty() {
        return Ok(count);
    }
    let transforms = json!({ "camera_model": "PINHOLE", "frames": frames });
    let outcome = serde_json::to_writer_pretty(list_file.writer(), &transforms).map_err(std::io::Error::from);
    outcome.and_then(|()| list_file.commit()).map_err(OpenCvError::io("writing cameras", &list))?;
    Ok(count)
}

/// The files that [`undistort_scene`] writes if every image can be read.
pub fn undistorted_files(scene: &Scene, folder: &Path) -> Vec<PathBuf> {
    let mut names = BTreeSet::new();
    let frames = scene.frames.iter().enumerate();
    let images = frames.map(|(position, frame)| format!("images/{}.png", unique_name(frame, position, &mut names)));
    images.chain(["transforms.json".to_owned()]).map(|name| folder.join(name)).collect()
}

/// An undistorter, and the camera and image size that it was made for.
struct LensMap {
    camera: Camera,
    size: ImageSize,
    undistorter: Undistorter,
}

impl LensMap {
    fn new(camera: Camera, size: ImageSize, mode: UndistortMode) -> Result<Self, OpenCvError> {
        Ok(Self { camera, size, undistorter: Undistorter::new(&camera, size, mode)? })
    }

    fn fits(&self, camera: &Camera, size: ImageSize) -> bool {
        self.camera.intrinsics == camera.intrinsics && self.camera.distortion == camera.distortion && self.size == size
    }
}

/// The maps of the lenses of the frames before, the last one first: frames with the same lens share a map, and the cameras of a rig
/// take turns.
#[derive(Default)]
struct RecentMaps(Vec<Rc<LensMap>>);

impl RecentMaps {
    /// A map is as large as several images, and each frame may have a lens of its own.
    const MAX: usize = 4;

    fn map(&mut self, camera: Camera, size: ImageSize, mode: UndistortMode) -> Result<Rc<LensMap>, OpenCvError> {
        let map = match self.0.iter().position(|map| map.fits(&camera, size)) {
            Some(at) => self.0.remove(at),
            None => Rc::new(LensMap::new(camera, size, mode)?),
        };
        self.0.truncate(Self::MAX - 1);
        self.0.insert(0, Rc::clone(&map));
        Ok(map)
    }
}

/// The frame's image; one that is there and cannot be read is counted.
fn readable_image(scene: &Scene, position: usize, frame: &Frame, warnings: &mut Warnings) -> Option<ImageU8> {
    if !frame.image.is_available() {
        return None;
    }
    let image = frame.decode(&scene.key, position, &DecodeLimits::default());
    image.map_err(|error| warnings.push(WarningKind::UnreadableImage, &scene.key, error.to_string())).ok()
}

/// The size of the scene's first image that has one, otherwise the first that is stated. It may read a header for every frame.
fn common_size(scene: &Scene) -> Option<ImageSize> {
    let mut of_images = scene.frames.iter().enumerate().map(|(at, frame)| frame.size(&scene.key, at));
    of_images.find_map(Result::ok).or_else(|| scene.frames.iter().find_map(|frame| frame.stated_size))
}

/// The frame's name, with its position if the name is taken or is not a file name.
fn unique_name(frame: &Frame, position: usize, taken: &mut BTreeSet<String>) -> String {
    let mut name = if is_plain_name(&frame.name) { frame.name.clone() } else { "frame".to_owned() };
    while !taken.insert(name.clone()) {
        name = format!("{name}_{position:06}");
    }
    name
}

/// A frame in nerfstudio's format: OpenGL camera-to-world, pinhole intrinsics in pixels.
fn frame_json(frame: &Frame, name: &str, size: ImageSize, undistorter: &Undistorter) -> Value {
    let pose = frame.camera.camera_from_world.inverse().opengl_from_opencv().to_rows();
    let mut matrix: Vec<Vec<f64>> = pose.chunks(4).map(<[f64]>::to_vec).collect();
    matrix.push(vec![0.0, 0.0, 0.0, 1.0]);
    let k = undistorter.intrinsics().pixel_from_normalized(size);
    json!({
        "file_path": name,
        "w": size.width, "h": size.height,
        "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
        "transform_matrix": matrix,
    })
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{CameraFromWorld, Distortion, NormalizedIntrinsics};
    use atsplat_scene::{FrameImage, SceneSource as _, SharedBytes};
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::linked::test_images::shifted_noise;

    fn frame(at: usize, image: FrameImage) -> Frame {
        let camera_from_world = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-(at as f64), 0.0, 0.0)).unwrap();
        let intrinsics = NormalizedIntrinsics::new(0.9, 1.2, 0.5, 0.5).unwrap();
        let distortion = Distortion::OpenCv { k1: -0.1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        let camera = Camera { camera_from_world, intrinsics, distortion };
        Frame { name: format!("f_{at}"), timestamp_micros: None, camera, stated_size: None, image }
    }

    /// The size of the first frame, which is stated nowhere, is that of the images.
    #[test]
    fn frames_without_a_readable_image_keep_their_position() {
        let folder = tempfile::tempdir().unwrap();
        let whole = || encode_png(&shifted_noise(32, 24, 0, 0)).unwrap();
        let images = [
            FrameImage::Missing("f_0.png".into()),
            FrameImage::Encoded(SharedBytes::new(whole())),
            FrameImage::Encoded(SharedBytes::new(b"no image".to_vec())),
            FrameImage::Encoded(SharedBytes::new(whole())),
        ];
        let frames = images.into_iter().enumerate().map(|(at, image)| frame(at, image)).collect();
        let scene = Scene { key: "scene".to_owned(), url: None, frames };
        // As an earlier run left it, when it could still be read.
        std::fs::create_dir(folder.path().join("images")).unwrap();
        std::fs::write(folder.path().join("images/f_2.png"), whole()).unwrap();
        let mut warnings = Warnings::new();
        let count = undistort_scene(&scene, UndistortMode::KeepK, folder.path(), &mut warnings, &|| ()).unwrap();
        assert_eq!(count, UndistortedFrames { written: 2, skipped: 2 });
        let files = ["images/f_0.png", "images/f_1.png", "images/f_2.png", "images/f_3.png", "transforms.json"];
        assert_eq!(undistorted_files(&scene, folder.path()), files.map(|name| folder.path().join(name)));
        assert_eq!((warnings.total(), warnings.count(WarningKind::UnreadableImage)), (1, 1), "{:?}", warnings.kept());

        let mut found = Warnings::new();
        let dataset = atsplat_scene::open(folder.path(), &mut found).unwrap();
        let read = dataset.load(&dataset.keys()[0], &mut found).unwrap();
        let has_image: Vec<bool> = read.frames.iter().map(|frame| frame.image.is_available()).collect();
        assert_eq!(has_image, [false, true, false, true]);
        assert_eq!((found.total(), found.count(WarningKind::MissingImage)), (2, 2), "{:?}", found.kept());
        for (read, original) in read.frames.iter().zip(&scene.frames) {
            assert_eq!((&read.name, read.camera.distortion), (&original.name, Distortion::None));
            let centres = [read, original].map(|frame| frame.camera.camera_from_world.inverse().centre());
            assert!(centres[0].distance(centres[1]) < 1e-9, "{centres:?}");
            assert!((read.camera.intrinsics.fx - original.camera.intrinsics.fx).abs() < 1e-9, "{}", read.name);
        }
    }

    /// Only the second of three states a size, and no image has one.
    #[test]
    fn frames_without_any_size_have_that_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let images = [FrameImage::Absent, FrameImage::Missing("f_1.png".into()), FrameImage::Missing("f_2.png".into())];
        let mut frames: Vec<Frame> = images.into_iter().enumerate().map(|(at, image)| frame(at, image)).collect();
        frames[1].stated_size = Some(ImageSize { width: 32, height: 24 });
        let scene = Scene { key: "scene".to_owned(), url: None, frames };
        let count = undistort_scene(&scene, UndistortMode::KeepK, folder.path(), &mut Warnings::new(), &|| ()).unwrap();
        assert_eq!(count, UndistortedFrames { written: 0, skipped: 3 });
        let list = std::fs::read(folder.path().join("transforms.json")).unwrap();
        let list: Value = serde_json::from_slice(&list).unwrap();
        let paths: Vec<&Value> = list["frames"].as_array().unwrap().iter().map(|frame| &frame["file_path"]).collect();
        assert_eq!(paths, ["missing/f_0.png", "missing/f_1.png", "missing/f_2.png"]);
        assert_eq!((&list["frames"][0]["w"], &list["frames"][2]["h"]), (&json!(32), &json!(24)));
    }

    #[test]
    fn a_scene_whose_sizes_are_unknown_has_no_list() {
        let folder = tempfile::tempdir().unwrap();
        let images = [FrameImage::Absent, FrameImage::Missing("f_1.png".into())];
        let frames = images.into_iter().enumerate().map(|(at, image)| frame(at, image)).collect();
        let scene = Scene { key: "scene".to_owned(), url: None, frames };
        let list = folder.path().join("transforms.json");
        std::fs::write(&list, "an earlier one").unwrap();
        let count = undistort_scene(&scene, UndistortMode::KeepK, folder.path(), &mut Warnings::new(), &|| ()).unwrap();
        assert_eq!(count, UndistortedFrames { written: 0, skipped: 2 });
        assert!(!list.exists());
    }

    #[test]
    fn lenses_that_take_turns_keep_their_maps() {
        let (mode, size) = (UndistortMode::KeepK, ImageSize { width: 16, height: 16 });
        let lens = |k1: f64| {
            let distortion = Distortion::OpenCv { k1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
            Camera { distortion, ..frame(0, FrameImage::Absent).camera }
        };
        let mut recent = RecentMaps::default();
        let [left, right, again] = [0.01, 0.02, 0.01].map(|k1| recent.map(lens(k1), size, mode).unwrap());
        assert!(Rc::ptr_eq(&left, &again) && !Rc::ptr_eq(&left, &right));
        let other_size = recent.map(lens(0.01), ImageSize { width: 16, height: 8 }, mode).unwrap();
        assert!(!Rc::ptr_eq(&left, &other_size));
        for k1 in [0.03, 0.04, 0.05, 0.06] {
            recent.map(lens(k1), size, mode).unwrap();
        }
        assert_eq!(recent.0.len(), RecentMaps::MAX, "a lens for each frame");
        assert!(!Rc::ptr_eq(&left, &recent.map(lens(0.01), size, mode).unwrap()));
    }

    /// The second lens has no new camera matrix.
    #[test]
    fn images_that_were_replaced_in_part_have_no_list() {
        let folder = tempfile::tempdir().unwrap();
        let png = encode_png(&shifted_noise(16, 16, 0, 0)).unwrap();
        let undistorted = |mode, second: (f64, f64)| {
            let frames = [(0.01, 0.0), second].into_iter().enumerate().map(|(at, (k1, p1))| {
                let mut frame = frame(at, FrameImage::Encoded(SharedBytes::new(png.clone())));
                frame.camera.intrinsics = NormalizedIntrinsics::new(0.5, 0.5, 0.5, 0.5).unwrap();
                frame.camera.distortion = Distortion::OpenCv { k1, k2: 0.0, k3: 0.0, p1, p2: 0.0 };
                frame
            });
            let scene = Scene { key: "scene".to_owned(), url: None, frames: frames.collect() };
            undistort_scene(&scene, mode, folder.path(), &mut Warnings::new(), &|| ())
        };
        undistorted(UndistortMode::KeepK, (0.01, 0.0)).unwrap();
        let cameras = folder.path().join("transforms.json");
        assert!(cameras.is_file());
        let error = undistorted(UndistortMode::LongLrm, (0.0, 1.5)).unwrap_err();
        assert!(matches!(error, OpenCvError::Lens { .. }), "{error}");
        assert!(!cameras.exists() && folder.path().join("images/f_0.png").is_file());
    }
}
