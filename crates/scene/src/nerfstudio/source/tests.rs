use std::f64::consts::FRAC_PI_2;
use std::fs;

use atsplat_camera::{Distortion, ImageSize};
use atsplat_numeric::Tolerance;
use atsplat_pixels::{ImageU8, encode_png};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::*;
use crate::camera_file::{self, LensOfPoses};
use crate::{FrameImage, SceneSource as _};

fn write_image(folder: &TempDir, name: &str, [width, height]: [u32; 2]) {
    let image = ImageU8::new(width, height, vec![7; (width * height * 3) as usize]).unwrap();
    atsplat_tests::write_file(&folder.path().join(name), encode_png(&image).unwrap());
}

/// A scene with these `global` fields, and a frame with these fields for each path.
fn capture(global: Value, frames: &[(&str, Value)]) -> TempDir {
    let mut root = global;
    let frames: Vec<Value> = (0..)
        .zip(frames)
        .map(|(at, (path, fields))| {
            let mut frame = fields.clone();
            frame["file_path"] = json!(path);
            frame["transform_matrix"] = json!([[1, 0, 0, at], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
            frame
        })
        .collect();
    root["frames"] = json!(frames);
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("transforms.json"), root.to_string()).unwrap();
    folder
}

fn open(folder: &TempDir, images: ImageFolder) -> NerfstudioScenes {
    let options = NerfstudioOptions { images, ..NerfstudioOptions::default() };
    NerfstudioScenes::open(folder.path(), options, &mut Warnings::new()).unwrap()
}

fn load(folder: &TempDir, images: ImageFolder) -> Result<(Scene, Warnings), SceneError> {
    let (source, mut warnings) = (open(folder, images), Warnings::new());
    let scene = source.load(&source.keys()[0], &mut warnings)?;
    Ok((scene, warnings))
}

/// Paths below the scene, of missing images too.
fn paths(folder: &TempDir, scene: &Scene) -> Vec<String> {
    let below = |path: &Path| path.strip_prefix(folder.path()).unwrap().display().to_string();
    let path = |frame: &Frame| match &frame.image {
        FrameImage::File(path) => below(path),
        FrameImage::Missing(path) => format!("no {}", below(path)),
        other => format!("{other:?}"),
    };
    scene.frames.iter().map(path).collect()
}

/// The number is a camera's, not a factor: another camera's image of the same name would be used instead of the frame's.
#[test]
fn numbered_cameras_are_not_scaled_copies_of_each_other() {
    let frames = [("cam_1/0.png", json!({})), ("cam_2/0.png", json!({}))];
    let folder = capture(json!({ "w": 16, "h": 12, "fl_x": 16 }), &frames);
    for (name, size) in [("cam_1/0.png", [16, 12]), ("cam_2/0.png", [16, 12]), ("cam_2_2/0.png", [8, 6])] {
        write_image(&folder, name, size);
    }
    let (scene, warnings) = load(&folder, ImageFolder::Downscaled(2)).unwrap();
    assert_eq!(paths(&folder, &scene), ["no cam_1_2/0.png", "cam_2_2/0.png"]);
    assert_eq!(warnings.count(WarningKind::MissingImage), 1);
    fs::remove_dir_all(folder.path().join("cam_1")).unwrap();
    let (scene, warnings) = load(&folder, ImageFolder::Listed).unwrap();
    assert_eq!(paths(&folder, &scene), ["no cam_1/0.png", "cam_2/0.png"]);
    assert_eq!((warnings.count(WarningKind::MissingImage), warnings.count(WarningKind::ImageAtOtherPath)), (1, 0));
}

/// Nothing but the size that a protocol expects says which copy is meant.
#[test]
fn without_the_listed_folder_the_copy_of_the_expected_size_is_used() {
    let frames = [("images/a.png", json!({})), ("images/b.png", json!({}))];
    let folder = capture(json!({ "w": 64, "h": 40, "fl_x": 60 }), &frames);
    for (copy, size) in [("images_2", [32, 20]), ("images_4", [16, 10]), ("images_8", [8, 5])] {
        for name in ["a", "b"] {
            write_image(&folder, &format!("{copy}/{name}.png"), size);
        }
    }
    let found = |images: ImageFolder, [width, height]: [u32; 2]| {
        let expected_size = Some(ImageSize { width, height });
        let options = NerfstudioOptions { images, expected_size, ..NerfstudioOptions::default() };
        let source = NerfstudioScenes::open(folder.path(), options, &mut Warnings::new()).unwrap();
        let mut warnings = Warnings::new();
        let scene = source.load(&source.keys()[0], &mut warnings).unwrap();
        (paths(&folder, &scene).swap_remove(1), warnings.count(WarningKind::ImageAtOtherPath))
    };
    let copy = |name: &str, warnings: u64| (format!("{name}/b.png"), warnings);
    assert_eq!(found(ImageFolder::Listed, [16, 10]), copy("images_4", 2));
    assert_eq!(found(ImageFolder::Listed, [8, 5]), copy("images_8", 2));
    assert_eq!(found(ImageFolder::Listed, [64, 40]), copy("images_2", 2), "no copy has this size");
    assert_eq!(found(ImageFolder::Downscaled(2), [16, 10]), copy("images_2", 0), "as chosen");
    for name in ["a", "b"] {
        write_image(&folder, &format!("images/{name}.png"), [64, 40]);
    }
    assert_eq!(found(ImageFolder::Listed, [16, 10]), copy("images", 0), "as listed");
}

/// The camera of the second frame, and its image, are half as large.
#[test]
fn without_sizes_a_frames_own_lengths_are_in_pixels_of_its_own_image() {
    let [large, small] = [[160, 96], [80, 48]];
    let frames = [
        ("images/a.png", json!({}), Some(large), large),
        ("images/b.png", json!({ "fl_x": 60 }), Some(small), small),
        ("images/c.png", json!({}), Some(large), large),
        ("images/d.png", json!({ "fl_x": 120 }), None, large),
        ("images/e.png", json!({ "fl_x": 60, "cx": 40, "cy": 20 }), Some(small), small),
    ];
    let listed = frames.clone().map(|(path, fields, _, _)| (path, fields));
    let folder = capture(json!({ "fl_x": 120, "cx": 80, "cy": 40 }), &listed);
    for (path, _, size, _) in &frames {
        if let Some(size) = size {
            write_image(&folder, path, *size);
        }
    }
    let (scene, _) = load(&folder, ImageFolder::Listed).unwrap();
    for (frame, (path, _, _, [width, height])) in scene.frames.iter().zip(frames) {
        let k = frame.camera.intrinsics;
        Tolerance::F64.assert([k.fx, k.fy, k.cx, k.cy], [0.75, 1.25, 0.5, 40.0 / 96.0], path);
        assert_eq!(frame.stated_size, Some(ImageSize { width, height }), "{path}");
    }
}

/// Of a scaled copy, or of another camera: nothing says which. Angles are the same for both, and a frame's `fl_x` is that of its image.
#[test]
fn images_of_several_sizes_need_stated_ones_for_shared_lengths_in_pixels() {
    let sizes = [None, Some([160, 96]), Some([160, 96]), Some([80, 48]), Some([40, 24])];
    let outcome = |global: Value, fields: Value| {
        let frames = ["a", "b", "c", "d", "e"].map(|name| format!("images/{name}.png"));
        let listed: Vec<(&str, Value)> = frames.iter().map(|path| (path.as_str(), fields.clone())).collect();
        let folder = capture(global, &listed);
        for (path, size) in frames.iter().zip(sizes) {
            if let Some(size) = size {
                write_image(&folder, path, size);
            }
        }
        load(&folder, ImageFolder::Listed).map(|_| ()).map_err(|error| error.to_string())
    };
    for global in [json!({ "fl_x": 120 }), json!({ "camera_angle_x": 1.0, "cx": 80, "cy": 48 })] {
        let error = outcome(global, json!({})).unwrap_err();
        assert!(error.contains("w, h: expected the size") && error.contains("transforms.json"), "{error}");
        assert!(
            error.contains("images of 160×96 in frame 1 (") && error.contains(" and 80×48 in frame 3 ("),
            "{error}"
        );
        assert!(error.contains("b.png) and") && error.contains("d.png"), "{error}");
    }
    for (global, fields) in [
        (json!({ "camera_angle_x": 1.0 }), json!({})),
        (json!({ "fl_x": 120, "w": 160, "h": 96 }), json!({})),
        (json!({ "fl_x": 120 }), json!({ "fl_x": 100 })),
    ] {
        assert_eq!(outcome(global.clone(), fields), Ok(()), "{global}");
    }
}

/// Coefficients of a fisheye mean something else in a perspective lens.
#[test]
fn a_frame_of_another_model_does_not_inherit_coefficients() {
    let lenses = |model: Value, frames: [Value; 4]| {
        let mut global = json!({ "w": 16, "h": 12, "fl_x": 16, "k1": 0.1, "k2": 0.05 });
        global["camera_model"] = model;
        let folder = capture(global, &frames.map(|fields| ("images/a.png", fields)));
        let (scene, _) = load(&folder, ImageFolder::Listed).unwrap();
        scene.frames.iter().map(|frame| frame.camera.distortion).collect::<Vec<_>>()
    };
    let frames = || {
        [
            json!({}),
            json!({ "camera_model": "PINHOLE" }),
            json!({ "camera_model": "OPENCV", "k1": 0.2 }),
            json!({ "is_fisheye": true }),
        ]
    };
    let open_cv = |k1, k2| Distortion::OpenCv { k1, k2, k3: 0.0, p1: 0.0, p2: 0.0 };
    let fisheye = |k1, k2| Distortion::Fisheye { k: [k1, k2, 0.0, 0.0] };
    let inherited = [fisheye(0.1, 0.05), Distortion::None, open_cv(0.2, 0.0), fisheye(0.1, 0.05)];
    assert_eq!(lenses(json!("OPENCV_FISHEYE"), frames()), inherited);
    for perspective in [json!("OPENCV"), Value::Null] {
        let inherited = [open_cv(0.1, 0.05), open_cv(0.1, 0.05), open_cv(0.2, 0.0), fisheye(0.0, 0.0)];
        assert_eq!(lenses(perspective, frames()), inherited);
    }
}

/// Both coordinates or neither, which is the centre.
#[test]
fn half_a_principal_point_is_an_error() {
    let principal = |fields: Value| {
        let mut global = json!({ "w": 16, "h": 12, "fl_x": 9.0 });
        global.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        let folder = capture(global, &[("a.png", json!({}))]);
        load(&folder, ImageFolder::Listed).map(|(scene, _)| {
            let intrinsics = scene.frames[0].camera.intrinsics;
            [intrinsics.cx, intrinsics.cy]
        })
    };
    Tolerance::F64.assert(principal(json!({})).unwrap(), [0.5, 0.5], "the centre");
    Tolerance::F64.assert(principal(json!({ "cx": 4.0, "cy": 9.0 })).unwrap(), [0.25, 0.75], "as stated");
    let expected = [
        (json!({ "cx": 4.0 }), "cy: expected both cx and cy, or neither, found only cx"),
        (json!({ "cy": 9.0 }), "cx: expected both cx and cy, or neither, found only cy"),
    ];
    for (fields, field) in expected {
        let error = principal(fields).unwrap_err().to_string();
        assert!(error.contains(field), "{error}");
    }
}

/// As instant-ngp reads such files, and Blender's, which state a field of view.
#[test]
fn a_principal_point_that_is_assumed_is_counted() {
    let said = |lens: Value, frames: [Value; 3]| {
        let folder = capture(lens, &frames.map(|fields| ("images/a.png", fields)));
        write_image(&folder, "images/a.png", [16, 12]);
        let (_, warnings) = load(&folder, ImageFolder::Listed).unwrap();
        let of_kind = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::AssumedPrincipalPoint);
        let file = format!(" ({})", folder.path().join("transforms.json").display());
        of_kind.map(|warning| warning.detail.replace(&file, "")).collect::<Vec<_>>()
    };
    let none = || [json!({}), json!({}), json!({})];
    let all = "3 of 3 frames, first 0: cx and cy are not stated; the centre is used";
    assert_eq!(said(json!({ "w": 16, "h": 12, "fl_x": 9 }), none()), [all]);
    assert_eq!(said(json!({ "w": 16, "h": 12, "fl_y": 9 }), none()), [all]);
    let of_frames = [json!({ "cx": 8, "cy": 6 }), json!({}), json!({ "fl_x": 8 })];
    let later = "1 of 3 frames, first 2: cx and cy are not stated; the centre is used";
    assert_eq!(said(json!({ "w": 16, "h": 12, "camera_angle_x": 1.0 }), of_frames), [later]);
    for stated in [json!({ "fl_x": 9, "cx": 8, "cy": 6 }), json!({ "camera_angle_x": 1.0 })] {
        assert_eq!(said(stated, none()), [""; 0]);
    }
}

/// A fisheye's angle belongs to no one definition of the focal length.
#[test]
fn a_fisheye_needs_a_focal_length_in_pixels() {
    let fisheye = |fields: Value| {
        let mut global = json!({ "w": 16, "h": 12, "camera_model": "OPENCV_FISHEYE", "fl_x": 9.0, "fl_y": 8.0 });
        global["camera_angle_x"] = json!(2.6);
        let folder = capture(global, &[("a.png", json!({})), ("a.png", fields)]);
        load(&folder, ImageFolder::Listed).map(|(scene, _)| scene.frames[1].camera.intrinsics.fx)
    };
    Tolerance::F64.assert([fisheye(json!({})).unwrap()], [9.0 / 16.0], "the angle that is also stated is not used");
    for (fields, field) in [
        (json!({ "camera_angle_x": 2.6 }), "frames[1]: fl_x: expected a focal length in pixels"),
        (json!({ "y_fov": 90.0 }), "frames[1]: fl_y: expected a focal length in pixels"),
        (json!({ "fl_x": 9.0, "camera_angle_y": 1.5 }), "frames[1]: fl_y: expected a focal length in pixels"),
    ] {
        let error = fisheye(fields).unwrap_err().to_string();
        assert!(error.contains(field) && error.contains("found only a field of view"), "{error}");
    }
    let perspective = json!({ "camera_model": "OPENCV", "camera_angle_x": FRAC_PI_2 });
    Tolerance::F64.assert([fisheye(perspective).unwrap()], [0.5], "tan 45°");
}

/// The error that names a TIFF's format is worth more than a missing file; next to a JPEG, it is as a PNG is.
#[test]
fn images_in_formats_that_are_not_decoded_are_found() {
    let frames =
        ["images/a.tif", "images/b.HEIC", "images/c.tif", "images/d.jpg", "images/e"].map(|path| (path, json!({})));
    let folder = capture(json!({ "w": 16, "h": 12, "fl_x": 16, "cx": 8, "cy": 6 }), &frames);
    for name in ["a.jpg", "c.jpg"] {
        write_image(&folder, &format!("images/{name}"), [16, 12]);
    }
    for name in ["a.tif", "b.HEIC", "d.tif", "e.bmp"] {
        fs::write(folder.path().join("images").join(name), b"II*\0\x08\0\0\0").unwrap();
    }
    let (scene, warnings) = load(&folder, ImageFolder::Listed).unwrap();
    let expected = ["images/a.tif", "images/b.HEIC", "images/c.jpg", "no images/d.jpg", "images/e.bmp"];
    assert_eq!(paths(&folder, &scene), expected);
    let counts = [(WarningKind::MissingImage, 1), (WarningKind::ImageAtOtherPath, 1)];
    assert_eq!(warnings.counts().collect::<Vec<_>>(), counts);
    assert_eq!((scene.frames[0].name.as_str(), scene.frames[1].name.as_str()), ("a", "b"));
    let error = scene.frames[0].size("s", 0).unwrap_err().to_string();
    assert!(error.contains("frame 0 of scene \"s\"") && error.contains("a.tif"), "{error}");
}

/// As Blender and instant-ngp list images; a path with its extension is clear.
#[test]
fn a_name_without_extension_that_fits_two_images_is_counted() {
    let frames = ["images/a", "images/b", "images/c.png"].map(|path| (path, json!({})));
    let folder = capture(json!({ "w": 16, "h": 12, "fl_x": 16, "cx": 8, "cy": 6 }), &frames);
    for name in ["a.jpg", "a.png", "b.png", "c.jpg", "c.png"] {
        write_image(&folder, &format!("images/{name}"), [16, 12]);
    }
    let (scene, warnings) = load(&folder, ImageFolder::Listed).unwrap();
    assert_eq!(paths(&folder, &scene), ["images/a.jpg", "images/b.png", "images/c.png"]);
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::AmbiguousNumbering, 1)]);
    let detail = &warnings.kept()[0].detail;
    assert_eq!(detail, "1 listed paths fit several images, first: images/a: a.jpg is used, not a.png");
}

/// The copy's size is not the one that lengths in pixels refer to; that of the listed folder is.
#[test]
fn the_size_for_a_scaled_copy_is_that_of_the_listed_images() {
    for (lens, fx) in
        [(json!({ "camera_angle_x": FRAC_PI_2 }), 0.5), (json!({ "fl_x": 120, "cx": 80, "cy": 48 }), 0.75)]
    {
        let folder = capture(lens, &[("images/a.png", json!({}))]);
        write_image(&folder, "images_4/a.png", [40, 24]);
        let error = load(&folder, ImageFolder::Downscaled(4)).unwrap_err().to_string();
        assert!(error.contains("size of the images"), "{error}");
        write_image(&folder, "images/a.png", [160, 96]);
        let (scene, warnings) = load(&folder, ImageFolder::Downscaled(4)).unwrap();
        assert_eq!((paths(&folder, &scene), warnings.total()), (vec!["images_4/a.png".to_owned()], 0));
        let (frame, size) = (&scene.frames[0], ImageSize { width: 160, height: 96 });
        Tolerance::F64.assert([frame.camera.intrinsics.fx, frame.camera.intrinsics.fy], [fx, fx / 0.6], "normalised");
        assert_eq!((frame.stated_size, frame.size("s", 0).unwrap().width), (Some(size), 40));
    }
}

/// Such numbers are not JSON; in an ignored field they do not matter.
#[test]
fn a_pose_that_is_not_finite_is_an_error_of_its_frame() {
    let parsed = |matrix: &str| {
        let text = format!(
            r#"{{"w": 8, "h": 6, "fl_x": 8, "aabb": [-Infinity], "frames": [
                {{"file_path": "a.png", "transform_matrix": {matrix}}},
                {{"file_path": "b.png", "transform_matrix": [[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0]], "t": NaN}}]}}"#
        );
        let Transforms { frames, .. } = parse_transforms(text.as_bytes(), Path::new("t.json")).unwrap();
        assert_eq!(frames[1].world_from_camera.as_ref().unwrap().centre(), DVec3::new(5.0, 0.0, 0.0));
        frames[0].world_from_camera.clone().unwrap_err().to_string()
    };
    let row = "[0, 1, 0, 0], [0, 0, 1, 0]";
    for (matrix, expected) in [
        (format!("[[1, 0, 0, NaN], {row}]"), "pose: expected a finite number, found NaN"),
        (format!("[[1, 0, 0, null], {row}]"), "pose: expected a finite number, found NaN"),
        (format!("[[-Infinity, 0, 0, 0], {row}]"), "pose: expected a finite number, found -inf"),
        (format!("[[1, 0, 0, 0], {row}, [NaN, NaN, NaN, NaN]]"), "pose: expected a finite number, found NaN"),
        (format!("[[-1, 0, 0, 0], {row}]"), "rotation: expected orthonormal rows and determinant 1"),
    ] {
        let message = parsed(&matrix);
        assert!(message.starts_with(expected), "{matrix}: {message}");
    }
}

/// A folder with what `write` puts into it, and the name of one in it whose path is longer than 4095 bytes, which no user can
/// open: renaming a folder above makes it so.
#[cfg(target_os = "linux")]
fn with_a_folder_that_cannot_be_listed(root: &Path, write: impl FnOnce(&Path)) -> (PathBuf, String) {
    let (short, long) = (root.join("a"), root.join("a".repeat(250)));
    let mut data = short.clone();
    while data.as_os_str().len() < 3700 {
        data.push("b".repeat(50));
    }
    let lost = "z".repeat(250);
    fs::create_dir_all(data.join(&lost)).unwrap();
    write(&data);
    fs::rename(&short, &long).unwrap();
    (long.join(data.strip_prefix(&short).unwrap()), lost)
}

#[cfg(target_os = "linux")]
#[test]
fn a_capture_that_cannot_be_listed_is_counted_next_to_colmap_models() {
    let folder = tempfile::tempdir().unwrap();
    let (data, lost) = with_a_folder_that_cannot_be_listed(folder.path(), |data| {
        for scene in ["x", "y"] {
            let model = data.join(scene).join("sparse/0");
            fs::create_dir_all(&model).unwrap();
            fs::write(model.join("cameras.txt"), "1 PINHOLE 4 3 4 4 2 1.5\n").unwrap();
            fs::write(model.join("images.txt"), "1 1 0 0 0 0 0 0 1 a.png\n\n").unwrap();
        }
    });
    let mut warnings = Warnings::new();
    assert_eq!(crate::open(&data, &mut warnings).unwrap().keys(), ["x", "y"]);
    assert_eq!(warnings.count(WarningKind::UnreadableScene), 1);
    assert!(
        warnings.kept().iter().any(|warning| warning.scene == lost && warning.detail.contains("listing a folder: "))
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_subset_that_cannot_be_listed_leaves_the_others_usable() {
    let transforms = capture(json!({ "w": 16, "h": 12, "fl_x": 16 }), &[("images/a.png", json!({}))]);
    let folder = tempfile::tempdir().unwrap();
    let (data, lost) = with_a_folder_that_cannot_be_listed(folder.path(), |data| {
        for scene in ["1K/x", "2K/y"] {
            fs::create_dir_all(data.join(scene)).unwrap();
            fs::copy(transforms.path().join("transforms.json"), data.join(scene).join("transforms.json")).unwrap();
        }
    });
    let mut warnings = Warnings::new();
    let dataset = crate::open(&data, &mut warnings).unwrap();
    assert_eq!(dataset.keys(), ["dl3dv_x", "dl3dv_y"]);
    assert_eq!(dataset.load("dl3dv_y", &mut Warnings::new()).unwrap().url.as_deref(), Some("2K"));
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnreadableScene, 1)]);
    let warning = &warnings.kept()[0];
    assert!(warning.scene == lost && warning.detail.contains("listing a folder: "), "{warning}");
    for subset in ["1K", "2K"] {
        fs::remove_dir_all(data.join(subset)).unwrap();
    }
    let error = crate::open(&data, &mut Warnings::new()).unwrap_err().to_string();
    assert!(error.contains("a folder without these; listing a folder: "), "{error}");
}

/// Two captures of one name are two scenes, of which one is lost: an ignored scene fails under `--strict`.
#[test]
fn a_scene_whose_name_another_subset_has_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let file = |scene: &str| folder.path().join(scene).join("transforms.json");
    for (scene, focal) in [("2K/a", 8), ("1K/a", 16), ("2K/b", 16)] {
        let transforms = capture(json!({ "w": 16, "h": 12, "fl_x": focal }), &[("images/a.png", json!({}))]);
        fs::create_dir_all(folder.path().join(scene)).unwrap();
        fs::copy(transforms.path().join("transforms.json"), file(scene)).unwrap();
    }
    let mut warnings = Warnings::new();
    let dataset = crate::open(folder.path(), &mut warnings).unwrap();
    assert_eq!(dataset.keys(), ["dl3dv_a", "dl3dv_b"]);
    let read = dataset.load("dl3dv_a", &mut Warnings::new()).unwrap();
    Tolerance::F64.assert([read.frames[0].camera.intrinsics.fx], [1.0], "that of 1K");
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::IgnoredScene, 1)]);
    let [read, left] = ["1K/a", "2K/a"].map(|scene| file(scene).display().to_string());
    let expected = format!("dl3dv_a: {left} is not read, because {read} has the same key: rename the folder of one");
    assert_eq!(warnings.kept()[0].to_string(), expected);
}

/// The time of day and milliseconds of Pixel phones: as microseconds, a walk of 0.3 s.
#[test]
fn numbers_in_names_are_not_times() {
    let names = ["PXL_20230704_153012345", "PXL_20230704_153112345", "PXL_20230704_153312345"];
    let paths = names.map(|name| format!("images/{name}.jpg"));
    let frames = paths.each_ref().map(|path| (path.as_str(), json!({})));
    let folder = capture(json!({ "w": 16, "h": 12, "fl_x": 16 }), &frames);
    let mut warnings = Warnings::new();
    let dataset = crate::open(folder.path(), &mut warnings).unwrap();
    let scene = dataset.load(&dataset.keys()[0], &mut warnings).unwrap();
    let numbers: Vec<Option<i64>> = scene.frames.iter().map(|frame| frame.timestamp_micros).collect();
    assert_eq!(numbers, [Some(153_012_345), Some(153_112_345), Some(153_312_345)], "as stored in chunks");
    assert_eq!(dataset.times(), TimestampSource::FromNames);
    assert!(!scene.has_times(dataset.times()));
    assert!(scene.has_times(TimestampSource::Given), "as timestamps of a trajectory they would be times");
    let cameras = camera_file::read(folder.path(), None, LensOfPoses::default(), &mut warnings).unwrap();
    assert_eq!(cameras.len(), 3);
    assert!(cameras.iter().all(|camera| camera.timestamp_micros.is_none()));
}

/// Of the third frame there is only the mask; that of `d` belongs to no frame.
#[test]
fn masks_of_instant_ngp_are_counted() {
    let frames = ["images/a.jpg", "images/b", "images/c.png"].map(|path| (path, json!({})));
    let folder = capture(json!({ "w": 16, "h": 12, "fl_x": 16 }), &frames);
    for name in ["a.jpg", "b.jpg", "dynamic_mask_b.png", "dynamic_mask_c.png", "dynamic_mask_d.png"] {
        write_image(&folder, &format!("images/{name}"), [16, 12]);
    }
    let of_masks = |warnings: &Warnings| -> Vec<String> {
        let unread = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::UnreadField);
        unread.map(|warning| warning.detail.clone()).collect()
    };
    let (scene, warnings) = load(&folder, ImageFolder::Listed).unwrap();
    assert_eq!(paths(&folder, &scene), ["images/a.jpg", "images/b.jpg", "no images/c.png"]);
    let expected =
        "2 of 3 frames, first 1: dynamic_mask_<name>.png next to the image is not read; whole images are compared";
    assert_eq!(of_masks(&warnings), [expected]);
    for name in ["b", "c"] {
        fs::remove_file(folder.path().join(format!("images/dynamic_mask_{name}.png"))).unwrap();
    }
    assert_eq!(of_masks(&load(&folder, ImageFolder::Listed).unwrap().1), [""; 0]);
}
