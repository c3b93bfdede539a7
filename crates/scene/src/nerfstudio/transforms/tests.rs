use super::*;
use crate::nerfstudio::{Focal, NerfstudioOptions, NerfstudioScenes};
use crate::{FrameImage, ImageFolder, Scene, SceneSource, WarningKind, Warnings};
use atsplat_camera::{Distortion, ImageSize};
use atsplat_numeric::Tolerance;
use glam::DVec3;
use proptest::prelude::*;
use serde_json::json;
use std::fs;

const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]];

fn frame(file_path: &str) -> Value {
    json!({ "file_path": file_path, "transform_matrix": IDENTITY })
}

fn transforms(change: impl FnOnce(&mut Value)) -> Value {
    let mut root = json!({ "w": 200, "h": 100, "fl_x": 100, "fl_y": 110, "cx": 100, "cy": 50, "frames": [frame("images/f_1.png")] });
    change(&mut root);
    root
}

fn parse(root: &Value) -> Result<Transforms, SceneError> {
    parse_transforms(root.to_string().as_bytes(), Path::new("transforms.json"))
}

fn message(root: &Value) -> String {
    parse(root).unwrap_err().to_string()
}

#[test]
fn errors_name_the_file_that_was_read() {
    let broken = transforms(|root| root["frames"][0]["w"] = json!(0)).to_string();
    let error = parse_transforms(broken.as_bytes(), Path::new("b2.json")).unwrap_err().to_string();
    let expected = "nerfstudio cameras: frames[0].w: expected an image size in pixels, found 0 (b2.json)";
    assert_eq!(error, expected);
}

/// Loads `root` as a scene in a folder with `files`.
fn load(root: &Value, files: &[&str], images: ImageFolder) -> Result<(Scene, Warnings), SceneError> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("transforms.json"), root.to_string()).unwrap();
    let image = atsplat_pixels::encode_png(&atsplat_pixels::ImageU8::new(8, 6, vec![7; 144]).unwrap()).unwrap();
    for file in files {
        atsplat_tests::write_file(&folder.path().join(file), &image);
    }
    let options = NerfstudioOptions { images, ..NerfstudioOptions::default() };
    let source = NerfstudioScenes::open(folder.path(), options, &mut Warnings::new()).unwrap();
    let mut warnings = Warnings::new();
    let scene = source.load(&source.keys()[0], &mut warnings)?;
    Ok((scene, warnings))
}

fn file_name(image: &FrameImage) -> &str {
    match image {
        FrameImage::File(path) | FrameImage::Missing(path) => path.file_name().unwrap().to_str().unwrap(),
        _ => "",
    }
}

#[test]
fn opengl_axes_are_converted_and_the_world_is_unchanged() {
    let scene = parse(&transforms(|_| ())).unwrap();
    let pose = scene.frames[0].world_from_camera.clone().unwrap();
    assert_eq!(pose.centre(), DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(pose.forward(), DVec3::NEG_Z);
    assert_eq!(pose.down(), DVec3::NEG_Y);
}

#[test]
fn intrinsics_are_divided_by_the_stated_size_for_any_copy_of_the_images() {
    let root = transforms(|root| root["w"] = json!(200.0));
    for images in [ImageFolder::Listed, ImageFolder::Downscaled(8)] {
        let (scene, warnings) = load(&root, &["images/f_1.png", "images_8/f_1.png"], images).unwrap();
        let frame = &scene.frames[0];
        let k = frame.camera.intrinsics;
        Tolerance::F64.assert([k.fx, k.fy, k.cx, k.cy], [0.5, 1.1, 0.5, 0.5], "normalised");
        assert_eq!(
            frame.stated_size,
            Some(ImageSize { width: 200, height: 100 }),
            "what the intrinsics are stated for"
        );
        assert_eq!(frame.timestamp_micros, Some(1));
        assert_eq!(warnings.total(), 0, "{:?}", warnings.kept());
    }
}

#[test]
fn intrinsics_of_a_frame_override_the_global_ones() {
    let root = transforms(|root| {
        root["frames"] = json!([frame("images/a.png"), frame("images/b.png")]);
        root["frames"][1]["fl_x"] = json!(50);
        root["frames"][1]["cx"] = json!(80);
    });
    let (scene, _) = load(&root, &[], ImageFolder::Listed).unwrap();
    let [a, b] = [0, 1].map(|at: usize| scene.frames[at].camera.intrinsics);
    Tolerance::F64.assert([a.fx, a.fy, a.cx], [0.5, 1.1, 0.5], "global");
    Tolerance::F64.assert(
        [b.fx, b.fy, b.cx],
        [0.25, 0.5, 0.4],
        "the frame's fl_x for both axes, the frame's cx, global cy",
    );
}

#[test]
fn the_last_row_of_a_pose_may_be_rounded() {
    let root = transforms(|root| root["frames"][0]["transform_matrix"][3] = json!([0, 3e-8, 0, 0.999_999_94]));
    let (scene, _) = load(&root, &[], ImageFolder::Listed).unwrap();
    assert!(scene.frames[0].has_pose());
}

#[test]
fn nerfstudios_list_of_coefficients_is_read() {
    let listed = |list: Value| transforms(|root| root["distortion_params"] = list);
    let lens = |root: &Value| load(root, &[], ImageFolder::Listed).unwrap().0.frames[0].camera.distortion;
    let list = json!([0.1, 0.02, 0.003, 0.0, 0.001, -0.002]);
    let expected = Distortion::OpenCv { k1: 0.1, k2: 0.02, k3: 0.003, p1: 0.001, p2: -0.002 };
    assert_eq!(lens(&listed(list.clone())), expected);
    let of_frame = transforms(|root| {
        root["k1"] = json!(0.5);
        root["frames"][0]["distortion_params"] = list.clone();
    });
    assert_eq!(lens(&of_frame), expected, "the frame's coefficients");
    for (wrong, found) in [(json!([0.1, 0.2]), "a list of 2"), (json!([0, 0, 0, 0, 0, "x"]), "\"x\"")] {
        let error = message(&listed(wrong));
        assert!(error.contains("distortion_params") && error.contains(found), "{error}");
    }
    let twice = transforms(|root| {
        root["distortion_params"] = list;
        root["p2"] = json!(0.0);
    });
    assert!(message(&twice).contains("distortion_params: expected either this list or k1"), "{}", message(&twice));
}

#[test]
fn angles_are_converted_to_focal_lengths() {
    let root = json!({ "camera_angle_x": std::f64::consts::FRAC_PI_2, "frames": [frame("./train/r_0")] });
    let (scene, warnings) = load(&root, &["train/r_0.png"], ImageFolder::Listed).unwrap();
    let frame = &scene.frames[0];
    let k = frame.camera.intrinsics;
    Tolerance::F64.assert([k.fx, k.fy, k.cx, k.cy], [0.5, 0.5 * 8.0 / 6.0, 0.5, 0.5], "square pixels of an 8×6 image");
    assert_eq!((file_name(&frame.image), frame.name.as_str()), ("r_0.png", "r_0"));
    assert_eq!(warnings.total(), 0, "names without extension are allowed: {:?}", warnings.kept());

    let degrees = transforms(|root| {
        let fields = root.as_object_mut().unwrap();
        fields.remove("fl_x");
        fields.remove("fl_y");
        fields.insert("x_fov".to_owned(), json!(90.0));
        fields.insert("camera_angle_y".to_owned(), json!(std::f64::consts::FRAC_PI_2));
    });
    let (scene, _) = load(&degrees, &[], ImageFolder::Listed).unwrap();
    let k = scene.frames[0].camera.intrinsics;
    Tolerance::F64.assert([k.fx, k.fy], [0.5, 0.5], "instant-ngp's two notations");
}

#[test]
fn focal_lengths_in_pixels_override_angles() {
    let root = transforms(|root| root["camera_angle_x"] = json!(1.0));
    assert_eq!(parse(&root).unwrap().lens.focal_x, Some(Focal::Pixels(100.0)));
}

#[test]
fn an_unknown_image_size_is_an_error() {
    let root = json!({ "camera_angle_x": 1.0, "frames": [frame("train/r_0")] });
    let error = load(&root, &[], ImageFolder::Listed).unwrap_err().to_string();
    assert!(error.contains("frames[0]") && error.contains("size of the images"), "{error}");
    let downscaled = load(&root, &["train_8/r_0.png"], ImageFolder::Downscaled(8));
    assert!(downscaled.is_err(), "a downscaled image does not have the listed size");
}

/// The height in the image's file may be that of a scaled copy of the width that is stated.
#[test]
fn half_a_size_is_not_completed_from_an_image() {
    for (side, missing) in [("w", "frames[0]: h: expected both w and h"), ("h", "frames[0]: w: expected both w and h")]
    {
        let root = json!({ side: 640, "fl_x": 500, "frames": [frame("images/a.png")] });
        let error = load(&root, &["images/a.png"], ImageFolder::Listed).unwrap_err().to_string();
        assert!(error.contains(missing), "{error}");
    }
}

#[test]
fn camera_models_convert_to_lenses_or_are_unsupported() {
    let lens = |fields: Value| {
        let root = transforms(|root| root.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone()));
        load(&root, &[], ImageFolder::Listed).map(|(scene, _)| scene.frames[0].camera.distortion)
    };
    let open_cv = |k1, k2, k3, p1, p2| Distortion::OpenCv { k1, k2, k3, p1, p2 };
    assert_eq!(lens(json!({ "camera_model": "OPENCV", "k1": 0, "p1": 0 })).unwrap(), Distortion::None);
    assert_eq!(
        lens(json!({ "k1": 0.1, "k2": 0.2, "k3": 0.3, "p1": 0.4, "p2": 0.5 })).unwrap(),
        open_cv(0.1, 0.2, 0.3, 0.4, 0.5)
    );
    assert_eq!(lens(json!({ "camera_model": "SIMPLE_RADIAL", "k1": 0.1 })).unwrap(), open_cv(0.1, 0.0, 0.0, 0.0, 0.0));
    assert_eq!(lens(json!({ "camera_model": "PINHOLE", "k1": 0.1 })).unwrap(), open_cv(0.1, 0.0, 0.0, 0.0, 0.0));
    let fisheye = Distortion::Fisheye { k: [0.1, 0.2, 0.3, 0.4] };
    let k = json!({ "k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4 });
    let with = |mut fields: Value, name: &str, value: Value| {
        fields[name] = value;
        fields
    };
    assert_eq!(lens(with(k.clone(), "camera_model", json!("OPENCV_FISHEYE"))).unwrap(), fisheye);
    assert_eq!(lens(with(k.clone(), "is_fisheye", json!(true))).unwrap(), fisheye);
    for (fields, model) in [
        (k, "OPENCV"),
        (json!({ "camera_model": "EQUIRECTANGULAR" }), "EQUIRECTANGULAR"),
        (json!({ "camera_model": "OPENCV_FISHEYE", "p1": 0.1 }), "OPENCV_FISHEYE"),
        (json!({ "ftheta_p0": 0.0 }), "FTheta"),
    ] {
        let error = lens(fields).unwrap_err();
        assert!(matches!(&error, SceneError::UnsupportedCameraModel { model: found, .. } if found == model), "{error}");
    }
}

#[test]
fn a_model_and_a_flag_that_contradict_each_other_are_an_error() {
    for (model, fisheye) in [("OPENCV", false), ("OPENCV_FISHEYE", true)] {
        let with = |flag: bool| {
            transforms(|root| {
                root["frames"][0]["camera_model"] = json!(model);
                root["frames"][0]["is_fisheye"] = json!(flag);
            })
        };
        assert_eq!(parse(&with(fisheye)).unwrap().frames[0].lens.fisheye, Some(fisheye));
        let error = message(&with(!fisheye));
        let expected = format!("frames[0].is_fisheye: expected {fisheye}, as camera_model states, found {}", !fisheye);
        assert!(error.contains(&expected), "{error}");
    }
}

#[test]
fn images_with_another_extension_are_found_and_missing_ones_keep_their_position() {
    let root =
        transforms(|root| root["frames"] = json!(["a", "b", "c"].map(|name| frame(&format!("images/{name}.png")))));
    let (scene, warnings) = load(&root, &["images/a.png", "images/c.JPG"], ImageFolder::Listed).unwrap();
    assert!(matches!(scene.frames[0].image, FrameImage::File(_)));
    assert!(matches!(scene.frames[1].image, FrameImage::Missing(_)));
    assert_eq!(file_name(&scene.frames[2].image), "c.JPG");
    let counts: Vec<_> = warnings.counts().collect();
    let kinds = [WarningKind::MissingImage, WarningKind::ImageAtOtherPath, WarningKind::RepeatedPose];
    assert_eq!(counts, kinds.map(|kind| (kind, 1)));
}

#[test]
fn without_the_listed_folder_the_largest_copy_is_used_and_reported() {
    let (scene, warnings) =
        load(&transforms(|_| ()), &["images_8/f_1.png", "images_4/f_1.png"], ImageFolder::Listed).unwrap();
    let FrameImage::File(path) = &scene.frames[0].image else { panic!("{:?}", scene.frames[0].image) };
    assert!(path.ends_with("images_4/f_1.png"), "{}", path.display());
    assert_eq!(warnings.count(WarningKind::ImageAtOtherPath), 1);
    assert_eq!(scene.frames[0].stated_size, Some(ImageSize { width: 200, height: 100 }));
}

#[test]
fn paths_outside_the_scene_are_errors() {
    for path in ["../../etc/passwd", "/etc/passwd", "images/../../x.png", r"..\x.png", ""] {
        let root = transforms(|root| root["frames"][0]["file_path"] = json!(path));
        let error = load(&root, &[], ImageFolder::Listed).unwrap_err();
        assert!(matches!(error, SceneError::OutsideScene { .. }), "{path:?}: {error}");
    }
}

#[test]
fn messages_name_the_field() {
    type Change = fn(&mut Value);
    let cases: [(&str, Change); 11] = [
        ("frames[0].file_path: expected an image's path, found nothing", |r| {
            r["frames"][0].as_object_mut().unwrap().remove("file_path");
        }),
        ("frames[0].file_path: expected text, found 7", |r| r["frames"][0]["file_path"] = json!(7)),
        ("frames[0].transform_matrix: expected 3 or 4 rows, found 2", |r| {
            r["frames"][0]["transform_matrix"] = json!([[1, 0, 0, 0], [0, 1, 0, 0]]);
        }),
        ("frames[0].transform_matrix[1]: expected a row of 4 numbers, found a list of 3", |r| {
            r["frames"][0]["transform_matrix"][1] = json!([1, 2, 3]);
        }),
        ("frames[0].transform_matrix[2][3]: expected a number, found \"x\"", |r| {
            r["frames"][0]["transform_matrix"][2][3] = json!("x");
        }),
        ("frames[0].transform_matrix[3]: expected the row 0 0 0 1, found 0 0 0 2", |r| {
            r["frames"][0]["transform_matrix"][3][3] = json!(2);
        }),
        ("frames: expected at least one frame", |r| r["frames"] = json!([])),
        ("frames: expected a list, found an object", |r| r["frames"] = json!({})),
        ("frames[0]: expected an object, found 3", |r| r["frames"] = json!([3])),
        ("w: expected an image size in pixels, found 0", |r| r["w"] = json!(0)),
        ("frames[0].camera_angle_x: expected an angle between 0 and 180°", |r| {
            r["frames"][0]["camera_angle_x"] = json!(4);
        }),
    ];
    for (expected, change) in cases {
        let message = message(&transforms(change));
        assert!(message.contains(expected), "{message}\ndoes not contain {expected}");
    }
    let zero_focal = load(&transforms(|r| r["fl_x"] = json!(0)), &[], ImageFolder::Listed).unwrap_err();
    assert!(matches!(zero_focal, SceneError::Camera { .. }), "{zero_focal}");
}

#[test]
fn errors_of_invalid_json_name_the_line() {
    for text in ["", "{\n\"frames\": [NaN]}", "{\"frames\"", "[[[[", "\u{0}", "{\n\n \"w\": 1e999}"] {
        let error = parse_transforms(text.as_bytes(), Path::new("t.json")).unwrap_err().to_string();
        assert!(error.contains("line ") || error.contains("top level"), "{error}");
    }
    let deep = "[".repeat(100_000);
    assert!(parse_transforms(deep.as_bytes(), Path::new("t.json")).is_err());
}

#[test]
fn errors_of_invalid_json_name_their_cause() {
    let whole = transforms(|_| ()).to_string();
    let message = |text: &str| parse_transforms(text.as_bytes(), Path::new("t.json")).unwrap_err().to_string();
    let cut = message(&whole[..whole.len() / 2]);
    assert!(cut.contains("expected complete JSON, found the end of the file") && !cut.contains("keys"), "{cut}");
    let nan = message(&whole.replacen("110", "NaN", 1));
    assert!(nan.contains("expected JSON, found \"NaN,") && !nan.contains("keys"), "{nan}");
    let repeated = message(&whole.replacen('{', "{\"w\":1,", 1));
    assert!(repeated.contains("expected each key once, found \"w\" a second time"), "{repeated}");
}

#[test]
fn two_focal_lengths_are_an_error() {
    let text = transforms(|_| ()).to_string().replace("\"w\"", "\n\"fl_x\":999,\"w\"");
    let error = parse_transforms(text.as_bytes(), Path::new("t.json")).unwrap_err().to_string();
    assert!(
        error.contains("line 2") && error.contains("\"fl_x\" a second time") && error.contains("t.json"),
        "{error}"
    );
}

/// `w` and `h` are 200 and 100: scaled images fit, cropped, rotated or stretched ones do not.
#[test]
fn an_image_of_another_shape_is_not_decoded() {
    let decoded = |width: u32, height: u32, elsewhere: &str| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("transforms.json"), transforms(|_| ()).to_string()).unwrap();
        let image = atsplat_pixels::ImageU8::new(width, height, vec![7; (width * height * 3) as usize]).unwrap();
        atsplat_tests::write_file(
            &folder.path().join(format!("images{elsewhere}/f_1.png")),
            atsplat_pixels::encode_png(&image).unwrap(),
        );
        let source = NerfstudioScenes::open(folder.path(), NerfstudioOptions::default(), &mut Warnings::new()).unwrap();
        let scene = source.load(&source.keys()[0], &mut Warnings::new()).unwrap();
        scene.decode(0, &atsplat_pixels::DecodeLimits::default()).map(|image| (image.width(), image.height()))
    };
    assert_eq!(decoded(200, 100, "").unwrap(), (200, 100));
    assert_eq!(decoded(50, 25, "").unwrap(), (50, 25));
    for (width, height) in [(100, 100), (100, 200), (200, 120)] {
        let error = decoded(width, height, "").unwrap_err();
        assert!(matches!(error, SceneError::ImageMismatch { frame: 0, .. }), "{error}");
        let message = error.to_string();
        assert!(message.contains("200×100") && message.contains(&format!("{width}×{height}")), "{message}");
    }
    assert_eq!(decoded(100, 50, "_2").unwrap(), (100, 50));
    for (width, height) in [(100, 200), (100, 52)] {
        let error = decoded(width, height, "_2").unwrap_err().to_string();
        assert!(error.contains("200×100") && error.contains(&format!("{width}×{height}")), "a cropped copy: {error}");
    }
}

#[test]
fn the_applied_transform_is_told_and_not_undone() {
    let applied = json!([[0, 1, 0, 5], [0, 0, 1, 6], [1, 0, 0, 7]]);
    let root = transforms(|root| {
        root["applied_transform"] = applied;
        root["applied_scale"] = json!(2.0);
    });
    let kept = parse(&root).unwrap().applied_transform.unwrap();
    Tolerance::EXACT.assert([kept[3], kept[7], kept[11]], [5.0, 6.0, 7.0], "kept");
    let (scene, _) = load(&root, &[], ImageFolder::Listed).unwrap();
    let centre = scene.frames[0].camera.camera_from_world.inverse().centre();
    Tolerance::F64.assert(centre.to_array(), [1.0, 2.0, 3.0], "as in the papers");

    let applied = |root: &Value| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("transforms.json");
        fs::write(&file, root.to_string()).unwrap();
        let source = NerfstudioScenes::open(&file, NerfstudioOptions::default(), &mut Warnings::new()).unwrap();
        source.applied_transform(&source.keys()[0])
    };
    let found = applied(&root).unwrap().unwrap();
    // saved = 2 · (A · original + a).
    Tolerance::F64.assert(found.saved_point(DVec3::new(1.0, 2.0, 3.0)).to_array(), [14.0, 18.0, 16.0], "a point moves");
    assert_eq!(applied(&transforms(|_| ())).unwrap(), None, "nothing is applied");
    let mirrored = transforms(|root| root["applied_transform"] = json!([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]));
    let error = applied(&mirrored).unwrap_err().to_string();
    assert!(error.contains("applied_transform"), "{error}");
}

proptest! {
    #[test]
    fn any_bytes_give_a_value_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        parse_transforms(&bytes, Path::new("t.json")).ok();
    }

    #[test]
    fn any_truncation_and_byte_give_a_value_or_an_error(cut in 0usize..400, at in 0usize..400, byte: u8) {
        let mut text = transforms(|_| ()).to_string().into_bytes();
        text.truncate(cut);
        if let Some(slot) = text.get_mut(at) {
            *slot = byte;
        }
        parse_transforms(&text, Path::new("t.json")).ok();
    }
}

/// The frame is the same image at half size: the global lens applies to it, scaled to its pixels.
#[test]
fn the_global_lens_is_scaled_to_a_frame_of_another_size() {
    let root = transforms(|root| {
        root["cy"] = json!(48);
        root["frames"][0]["w"] = json!(100);
        root["frames"][0]["h"] = json!(50);
    });
    let (scene, _) = load(&root, &["images/f_1.png"], ImageFolder::default()).unwrap();
    let k = scene.frames[0].camera.intrinsics;
    Tolerance::F64.assert([k.fx, k.fy, k.cx, k.cy], [0.5, 1.1, 0.5, 0.48], "normalised intrinsics");
}

/// What the warnings of a scene without images say, besides that those are missing.
fn warned(change: impl FnOnce(&mut Value)) -> Vec<(WarningKind, String)> {
    let root = transforms(|root| {
        root["fl_y"] = json!(100);
        change(root);
    });
    let (_, warnings) = load(&root, &["images/f_1.png"], ImageFolder::Listed).unwrap();
    warnings.kept().iter().map(|warning| (warning.kind, warning.detail.clone())).collect()
}

/// 90° over 200 pixels is a focal length of 100.
#[test]
fn a_field_of_view_that_contradicts_the_focal_length_is_counted() {
    let right = std::f64::consts::FRAC_PI_2;
    assert_eq!(warned(|root| root["camera_angle_x"] = json!(right)), []);
    assert_eq!(warned(|root| root["x_fov"] = json!(91.0)), [], "rounded");
    assert_eq!(warned(|root| root["camera_angle_y"] = json!(2.0 * 0.5f64.atan())), [], "of the height");
    for (field, value, shown) in [("camera_angle_x", 2.5, "is 143.24°"), ("x_fov", 45.0, "is 45.00°")] {
        let found = warned(|root| root[field] = json!(value));
        let [(WarningKind::ContradictoryFieldOfView, detail)] = found.as_slice() else { panic!("{found:?}") };
        assert!(detail.starts_with("1 of 1 frames, first 0: ") && detail.contains(shown), "{detail}");
        assert!(detail.contains("fl_x 100.00 for 200 pixels is 90.00°"), "{detail}");
    }
    let of_frame = warned(|root| {
        root["camera_angle_x"] = json!(right);
        root["frames"] = json!([frame("images/f_1.png"), frame("images/g_2.png")]);
        root["frames"][1]["fl_x"] = json!(60);
        root["frames"][1]["camera_angle_x"] = json!(right);
    });
    assert!(of_frame.iter().any(|(_, detail)| detail.starts_with("1 of 2 frames, first 1: ")), "{of_frame:?}");
    let angles = warned(|root| {
        root["fl_x"] = Value::Null;
        root["x_fov"] = json!(90);
        root["camera_angle_x"] = json!(0.5);
    });
    let [(WarningKind::ContradictoryFieldOfView, detail)] = angles.as_slice() else { panic!("{angles:?}") };
    assert!(detail.ends_with("camera_angle_x is 28.65°, x_fov is 90.00°; x_fov is used"), "{detail}");
}

#[test]
fn normalised_numbers_and_impossible_pixels_are_counted() {
    let normalised = warned(|root| {
        for (name, value) in [("fl_x", 0.5), ("fl_y", 1.0), ("cx", 0.5), ("cy", 0.5)] {
            root[name] = json!(value);
        }
    });
    let [(WarningKind::ImplausibleIntrinsics, detail)] = normalised.as_slice() else { panic!("{normalised:?}") };
    assert!(detail.contains("fx 0.500, fy 1.000") && detail.contains("200×100"), "{detail}");
    let tenfold = warned(|root| root["fl_x"] = json!(1000));
    let [(WarningKind::ImplausibleIntrinsics, detail)] = tenfold.as_slice() else { panic!("{tenfold:?}") };
    assert!(detail.contains("10.00 : 1"), "{detail}");
}
