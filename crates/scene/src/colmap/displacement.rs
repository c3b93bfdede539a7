use std::collections::HashMap;
use std::path::Path;

use atsplat_numeric::median;
use glam::DVec3;

use super::{model_file, parse_images};
use crate::files::{read_file, split_image_name};
use crate::nerfstudio::AppliedTransform;
use crate::{Scene, SceneError};

/// How far a model's cameras are from those of the same images in a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// Images of the model that are frames of the scene.
    pub images: usize,
    /// Median distance between the camera of an image and that of its frame, in diagonals of the box around these frames'
    /// cameras.
    pub distance: f64,
}

/// Compares the cameras of the model in `folder`, moved by what was `applied` to the scene's, with those of frames of the same
/// name: with its folder or, if no other image of the model has that name, without. `None` if the model has no images, if fewer
/// than two of them are frames, or if these frames' cameras are all in one place.
///
/// # Errors
/// [`SceneError::Io`] and the errors of [`parse_images`].
pub fn displacement(
    folder: &Path,
    scene: &Scene,
    applied: Option<AppliedTransform>,
) -> Result<Option<Displacement>, SceneError> {
    let (file, encoding) = model_file(folder, "images");
    if !file.is_file() {
        return Ok(None);
    }
    let images = parse_images(&read_file("reading COLMAP images", &file)?, encoding, &file)?;
    // A name that several frames have says nothing.
    let mut centres: HashMap<&str, Option<DVec3>> = HashMap::new();
    for frame in scene.frames.iter().filter(|frame| frame.has_pose()) {
        let centre = frame.camera.camera_from_world.inverse().centre();
        centres.entry(&frame.name).and_modify(|known| *known = None).or_insert(Some(centre));
    }
    let mut images_named: HashMap<&str, usize> = HashMap::new();
    for image in &images {
        *images_named.entry(path_and_name(&image.name).1).or_default() += 1;
    }
    let pairs: Vec<(DVec3, DVec3)> = images
        .iter()
        .filter_map(|image| {
            // Frames of a COLMAP model have their folder in their name, those of nerfstudio only where names repeat.
            let (path, name) = path_and_name(&image.name);
            let by_name = || centres.get(name).filter(|_| images_named.get(name) == Some(&1));
            let frame = (*centres.get(path).or_else(by_name)?)?;
            let centre = image.camera_from_world.as_ref().ok()?.inverse().centre();
            Some((applied.map_or(centre, |applied| applied.saved_point(centre)), frame))
        })
        .collect();
    let (low, high) = pairs
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (_, centre)| (low.min(*centre), high.max(*centre)));
    let extent = low.distance(high);
    if pairs.len() < 2 || extent <= 0.0 {
        return Ok(None);
    }
    let distance = median(pairs.iter().map(|(image, frame)| image.distance(*frame) / extent));
    Ok(distance.map(|distance| Displacement { images: pairs.len(), distance }))
}

/// An image's path without its extension, and the last part of that.
fn path_and_name(image: &str) -> (&str, &str) {
    let path = split_image_name(image).map_or(image, |(stem, _)| stem);
    (path, path.rsplit('/').next().unwrap_or(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colmap::{ColmapOptions, ColmapScenes};
    use crate::nerfstudio::{NerfstudioOptions, NerfstudioScenes};
    use crate::{SceneSource, Warnings};
    use atsplat_numeric::Tolerance;
    use serde_json::json;

    /// Cameras at the centres (1, 0, 0), (0, 2, 0) and (0, 0, 2); the last has no frame.
    const IMAGES: &str =
        "1 1 0 0 0 -1 0 0 1 left/a.png\n\n2 1 0 0 0 0 -2 0 1 right/b.png\n\n3 1 0 0 0 0 0 -2 1 c.png\n\n";

    fn model(images: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("cameras.txt"), "1 PINHOLE 4 3 4 4 2 1.5\n").unwrap();
        std::fs::write(folder.path().join("images.txt"), images).unwrap();
        folder
    }

    /// Frames `a` and `b` at these centres, and what was applied to them.
    fn saved(centres: [[f64; 3]; 2], scale: f64) -> (Scene, Option<AppliedTransform>) {
        let [a, b] = ["a", "b"].map(|name| format!("images/{name}.png"));
        let frame = |name: String, [x, y, z]: [f64; 3]| {
            let rows = [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]];
            json!({ "file_path": name, "transform_matrix": rows })
        };
        let frames = [frame(a, centres[0]), frame(b, centres[1])];
        let root = json!({ "w": 4, "h": 3, "fl_x": 4, "applied_scale": scale, "frames": frames });
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("transforms.json");
        std::fs::write(&file, root.to_string()).unwrap();
        let source = NerfstudioScenes::open(&file, NerfstudioOptions::default(), &mut Warnings::new()).unwrap();
        let key = &source.keys()[0];
        (source.load(key, &mut Warnings::new()).unwrap(), source.applied_transform(key).unwrap())
    }

    #[test]
    fn cameras_of_the_same_images_are_compared_in_the_scenes_world() {
        let folder = model(IMAGES);
        let (scene, applied) = saved([[3.0, 0.0, 0.0], [0.0, 6.0, 2.0]], 3.0);
        let found = displacement(folder.path(), &scene, applied).unwrap().unwrap();
        assert_eq!(found.images, 2, "the third is not a frame");
        // The cameras are 0 and 2 apart, in a box of 3 × 6 × 2.
        Tolerance::F64.assert([found.distance], [1.0 / 7.0], "median");
        let found = displacement(folder.path(), &scene, None).unwrap().unwrap();
        Tolerance::F64.assert([found.distance], [0.5 * (2.0 + 20.0_f64.sqrt()) / 7.0], "without the scale");
    }

    /// Frames of nerfstudio in three folders, as the model has them.
    #[test]
    fn images_of_one_name_have_their_folders_in_their_names() {
        let centres = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]];
        let frames: Vec<_> = ["left", "right", "top"]
            .iter()
            .zip(centres)
            .map(|(folder, [x, y, z])| {
                let rows = [[1.0, 0.0, 0.0, x], [0.0, -1.0, 0.0, y], [0.0, 0.0, -1.0, z], [0.0, 0.0, 0.0, 1.0]];
                json!({ "file_path": format!("./images/{folder}/frame_7.png"), "transform_matrix": rows })
            })
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("transforms.json");
        std::fs::write(&file, json!({ "w": 4, "h": 3, "fl_x": 4, "frames": frames }).to_string()).unwrap();
        let source = NerfstudioScenes::open(&file, NerfstudioOptions::default(), &mut Warnings::new()).unwrap();
        let scene = source.load(&source.keys()[0], &mut Warnings::new()).unwrap();
        let names: Vec<&str> = scene.frames.iter().map(|frame| frame.name.as_str()).collect();
        assert_eq!(names, ["left/frame_7", "right/frame_7", "top/frame_7"]);
        assert!(scene.frames.iter().all(|frame| frame.timestamp_micros == Some(7)));
        let images = "1 1 0 0 0 -1 0 0 1 left/frame_7.png\n\n2 1 0 0 0 0 -2 0 1 right/frame_7.png\n\n\
                      3 1 0 0 0 0 0 -2 1 top/frame_7.png\n\n";
        let found = displacement(model(images).path(), &scene, None).unwrap();
        assert_eq!(found, Some(Displacement { images: 3, distance: 0.0 }));
    }

    /// Of a rig, the file has the frames of one camera; which one, their names do not say.
    #[test]
    fn images_of_other_cameras_with_a_frames_name_are_not_compared() {
        let (scene, _) = saved([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], 1.0);
        let rig = |names: [&str; 4]| {
            let [a, b, c, d] = names;
            let images = format!(
                "1 1 0 0 0 -1 0 0 1 {a}.png\n\n2 1 0 0 0 0 -2 0 1 {b}.png\n\n\
                 3 1 0 0 0 -9 0 0 1 {c}.png\n\n4 1 0 0 0 0 -9 0 1 {d}.png\n\n"
            );
            displacement(model(&images).path(), &scene, None).unwrap()
        };
        assert_eq!(rig(["left/a", "left/b", "right/a", "right/b"]), None);
        let found = Some(Displacement { images: 2, distance: 0.0 });
        assert_eq!(rig(["left/a", "left/b", "right/c", "right/d"]), found);
        assert_eq!(rig(["a", "b", "right/a", "right/b"]), found, "with their folder, none");
    }

    #[test]
    fn fewer_than_two_frames_or_one_place_give_no_displacement() {
        let (apart, _) = saved([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], 1.0);
        let (together, _) = saved([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 1.0);
        let found = |images: &str, scene: &Scene| displacement(model(images).path(), scene, None).unwrap();
        assert!(found(IMAGES, &apart).is_some());
        assert_eq!(found(IMAGES, &together), None, "in one place");
        assert_eq!(found("1 1 0 0 0 -1 0 0 1 a.png\n\n3 1 0 0 0 0 0 -2 1 c.png\n\n", &apart), None, "one frame");
        let empty = tempfile::tempdir().unwrap();
        assert_eq!(displacement(empty.path(), &apart, None).unwrap(), None, "no images");
    }

    /// The last image has no pose, in the model and as a frame of it.
    #[test]
    fn images_without_a_pose_are_not_compared() {
        let images = "1 1 0 0 0 -1 0 0 1 a.png\n\n2 1 0 0 0 0 -2 0 1 b.png\n\n3 0 0 0 0 0 0 0 1 c.png\n\n";
        let folder = model(images);
        let source = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap();
        let scene = source.load(&source.keys()[0], &mut Warnings::new()).unwrap();
        assert_eq!(scene.frames.iter().map(crate::Frame::has_pose).collect::<Vec<_>>(), [true, true, false]);
        for images in [images.to_owned(), images.replace("3 0 0 0 0 0 0 0", "3 1 0 0 0 0 0 9")] {
            let found = displacement(model(&images).path(), &scene, None).unwrap();
            assert_eq!(found, Some(Displacement { images: 2, distance: 0.0 }), "{images}");
        }
    }

    #[test]
    fn a_model_is_where_its_own_frames_are() {
        // One name in two folders.
        let folder = model("1 1 0 0 0 -1 0 0 1 left/a.png\n\n2 1 0 0 0 0 -2 0 1 right/a.png\n\n");
        let source = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap();
        let scene = source.load(&source.keys()[0], &mut Warnings::new()).unwrap();
        let found = displacement(folder.path(), &scene, None).unwrap();
        assert_eq!(found, Some(Displacement { images: 2, distance: 0.0 }));
    }
}
