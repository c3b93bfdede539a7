use super::*;
use atsplat_camera::{Distortion, ImageSize};
use atsplat_numeric::Tolerance;
use proptest::prelude::*;

use crate::{SceneSource, WarningKind, Warnings};

fn cameras_text(text: &str) -> Result<BTreeMap<u32, ColmapCamera>, SceneError> {
    parse_cameras(text.as_bytes(), Encoding::Text, Path::new("cameras.txt"))
}

fn images_text(text: &str) -> Result<Vec<ColmapImage>, SceneError> {
    parse_images(text.as_bytes(), Encoding::Text, Path::new("images.txt"))
}

fn points_text(text: &str) -> Result<Vec<ColmapPoint>, SceneError> {
    parse_points(text.as_bytes(), Encoding::Text, Path::new("points3D.txt"))
}

fn binary(fields: &[&[u8]]) -> Vec<u8> {
    fields.concat()
}

#[test]
fn every_model_has_its_number_name_and_count() {
    // From colmap's src/colmap/sensor/models.h, where the parameter lists are written out.
    let lists = [
        ("SIMPLE_PINHOLE", "f, cx, cy"),
        ("PINHOLE", "fx, fy, cx, cy"),
        ("SIMPLE_RADIAL", "f, cx, cy, k"),
        ("RADIAL", "f, cx, cy, k1, k2"),
        ("OPENCV", "fx, fy, cx, cy, k1, k2, p1, p2"),
        ("OPENCV_FISHEYE", "fx, fy, cx, cy, k1, k2, k3, k4"),
        ("FULL_OPENCV", "fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6"),
        ("FOV", "fx, fy, cx, cy, omega"),
        ("SIMPLE_RADIAL_FISHEYE", "f, cx, cy, k"),
        ("RADIAL_FISHEYE", "f, cx, cy, k1, k2"),
        ("THIN_PRISM_FISHEYE", "fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1"),
        ("RAD_TAN_THIN_PRISM_FISHEYE", "fx, fy, cx, cy, k0, k1, k2, k3, k4, k5, p0, p1, s0, s1, s2, s3"),
        ("SIMPLE_DIVISION", "f, cx, cy, k"),
        ("DIVISION", "fx, fy, cx, cy, k"),
        ("SIMPLE_FISHEYE", "f, cx, cy"),
        ("FISHEYE", "fx, fy, cx, cy"),
        ("EUCM", "fx, fy, cx, cy, alpha, beta"),
        ("EQUIRECTANGULAR", "w, h"),
    ];
    for (number, (name, list)) in lists.into_iter().enumerate() {
        let model = ColmapCameraModel::from_name(name).unwrap();
        assert_eq!(ColmapCameraModel::from_number(i32::try_from(number).unwrap()), Some(model), "{name}");
        assert_eq!((model.name(), model.parameter_count()), (name, list.split(',').count()));
    }
    assert_eq!(ColmapCameraModel::from_number(18), None);
    assert_eq!(ColmapCameraModel::from_number(-1), None);
}

#[test]
fn models_convert_to_lenses_or_are_unsupported() {
    let lens = |line: &str| cameras_text(&format!("1 {line}")).unwrap()[&1].lens("camera 1", Path::new("cameras.txt"));
    let distortion = |line: &str| lens(line).unwrap().1;
    let open_cv = |k1, k2, k3, p1, p2| Distortion::OpenCv { k1, k2, k3, p1, p2 };
    let k = lens("PINHOLE 200 100 100 110 100 40").unwrap().0;
    Tolerance::F64.assert([k.fx, k.fy, k.cx, k.cy], [0.5, 1.1, 0.5, 0.4], "normalised by its size");
    assert_eq!(distortion("SIMPLE_PINHOLE 200 100 100 100 50"), Distortion::None);
    assert_eq!(distortion("SIMPLE_RADIAL 200 100 100 100 50 0.1"), open_cv(0.1, 0.0, 0.0, 0.0, 0.0));
    assert_eq!(distortion("SIMPLE_RADIAL 200 100 100 100 50 0"), Distortion::None);
    assert_eq!(distortion("RADIAL 200 100 100 100 50 0.1 0.2"), open_cv(0.1, 0.2, 0.0, 0.0, 0.0));
    assert_eq!(distortion("OPENCV 200 100 100 100 100 50 0.1 0.2 0.3 0.4"), open_cv(0.1, 0.2, 0.0, 0.3, 0.4));
    assert_eq!(
        distortion("FULL_OPENCV 200 100 100 100 100 50 0.1 0.2 0.3 0.4 0.5 0 0 0"),
        open_cv(0.1, 0.2, 0.5, 0.3, 0.4)
    );
    let fisheye = |k| Distortion::Fisheye { k };
    assert_eq!(distortion("OPENCV_FISHEYE 200 100 100 100 100 50 0.1 0.2 0.3 0.4"), fisheye([0.1, 0.2, 0.3, 0.4]));
    assert_eq!(distortion("SIMPLE_RADIAL_FISHEYE 200 100 100 100 50 0.1"), fisheye([0.1, 0.0, 0.0, 0.0]));
    assert_eq!(distortion("RADIAL_FISHEYE 200 100 100 100 50 0.1 0.2"), fisheye([0.1, 0.2, 0.0, 0.0]));
    assert_eq!(distortion("SIMPLE_FISHEYE 200 100 100 100 50"), fisheye([0.0; 4]), "no coefficients, still no pinhole");
    for line in [
        "FULL_OPENCV 200 100 100 100 100 50 0 0 0 0 0 0.1 0 0",
        "FOV 200 100 100 100 100 50 0.9",
        "THIN_PRISM_FISHEYE 200 100 100 100 100 50 0 0 0 0 0 0 0 0",
        "EQUIRECTANGULAR 200 100 200 100",
    ] {
        let error = lens(line).unwrap_err();
        let name = line.split(' ').next().unwrap();
        assert!(matches!(&error, SceneError::UnsupportedCameraModel { model, .. } if model == name), "{error}");
    }
    for line in ["PINHOLE 200 100 0 110 100 40", "OPENCV 200 100 100 100 100 50 nan 0 0 0"] {
        assert!(matches!(lens(line), Err(SceneError::Camera { .. })), "{line}");
    }
}

#[test]
fn an_image_without_keypoints_is_followed_by_an_empty_line() {
    let text = "# comment\n2 1 0 0 0 0 0 5 1 b c.png\n\n1 2 0 0 0 1 2 3 1 a.png\n10 20 -1 30 40 7\n";
    let images = images_text(text).unwrap();
    let names: Vec<_> = images.iter().map(|image| (image.id, image.name.as_str())).collect();
    assert_eq!(names, [(2, "b c.png"), (1, "a.png")]);
    let rotation = images[1].camera_from_world.as_ref().unwrap().rotation();
    assert_eq!(rotation, DMat3::IDENTITY, "quaternions are normalised");
    assert_eq!(images_text(&text.replace('\n', "\r\n")).unwrap(), images);
    assert_eq!(
        images_text(text.strip_suffix("\n10 20 -1 30 40 7\n").unwrap()).unwrap(),
        images,
        "truncated after an image"
    );
}

/// COLMAP writes a line of keypoints after each image, possibly empty. Other tools omit the line.
#[test]
fn image_lines_are_not_mistaken_for_keypoints() {
    let image = |id: u32| format!("{id} 1 0 0 0 0 0 {id} 1 frame_{id:05}.png\n");
    let names = |text: &str| images_text(text).unwrap().iter().map(|image| image.id).collect::<Vec<_>>();
    let all = [1, 2, 3, 4, 5];
    for between in ["", "\n", "10.5 20 -1 30 40.25 7\n", "# a comment\n", "\n# a comment\n"] {
        assert_eq!(names(&all.map(|id| image(id) + between).concat()), all, "{between:?} between images");
    }
    // Images without a line of keypoints among images with one.
    let mixed = [image(1), "1 2 3\n".to_owned(), image(2), image(3), "\n".to_owned(), image(4), image(5)];
    assert_eq!(names(&mixed.concat()), all);
    let broken = images_text(&[&image(1), "10 20 -1 30\n", &image(2)].concat()).unwrap_err().to_string();
    assert!(broken.contains("line 2, "), "truncated keypoints are an error with their line: {broken}");
}

/// Its numbers could be three keypoints. Those are preferred where the file has keypoints, unless the ids of their points
/// would not be whole.
#[test]
fn an_image_without_its_name_is_not_mistaken_for_keypoints() {
    let [first, last] = [(1, "a"), (3, "c")].map(|(id, name)| format!("{id} 1 0 0 0 0 0 {id} 1 {name}.png\n"));
    let nameless = |pose: &str, other: &str| format!("{first}2 {pose} 1\n{other}{last}");
    let (whole, fraction) = ("1 0 0 0 1 0 0", "0.8 0 -0.6 0 0.5 0 0");
    let (keypoints, header) = ("4 1 0 0 0 3 0 0 1 d.png\n10 20 -1\n", "#   POINTS2D[] as (X, Y, POINT3D_ID)\n");
    for text in [nameless(whole, ""), nameless(whole, "# by hand\n"), nameless(fraction, keypoints)] {
        let error = images_text(&text).unwrap_err().to_string();
        assert!(error.contains("line 2, NAME: expected a UTF-8 name"), "{text}{error}");
    }
    for (text, expected) in [
        (nameless(whole, keypoints), vec![1, 4, 3]),
        (nameless(whole, header), vec![1, 3]),
        (nameless("20.5 -1 30 40.5 7 50 60.5", ""), vec![1, 3]),
    ] {
        let ids: Vec<u32> = images_text(&text).unwrap().iter().map(|image| image.id).collect();
        assert_eq!(ids, expected, "{text}");
    }
}

#[test]
fn a_file_with_another_number_of_images_than_its_header_states_is_an_error() {
    let image = |id: u32| format!("{id} 1 0 0 0 0 0 {id} 1 {id}.png\n\n");
    let read = |comment: &str| images_text(&format!("# Images\n#{comment}\n{}{}", image(1), image(2)));
    let stated = |count: &str| format!(" Number of images: {count}, mean observations per image: 3.5");
    for fitting in [stated("2").as_str(), "Number of images: 2\r", " Number of images"] {
        assert_eq!(read(fitting).unwrap().len(), 2, "{fitting}");
    }
    for wrong in ["3", "1", "0", "20"] {
        let error = read(&stated(wrong)).unwrap_err().to_string();
        let expected = format!("line 2: expected {wrong} images, as the comment states, found 2");
        assert!(error.contains(&expected), "{error}");
    }
}

/// As when a copy was interrupted: Gaussians would start from a part of the points.
#[test]
fn a_file_with_fewer_points_than_its_header_states_is_an_error() {
    let text = "# 3D point list\n# Number of points: 2, mean track length: 0\n7 0 0 1 1 2 3 -1\n8 0 0 2 1 2 3 -1\n";
    assert_eq!(points_text(text).unwrap().len(), 2);
    let cut = text.split_inclusive('\n').take(3).collect::<String>();
    let error = points_text(&cut).unwrap_err().to_string();
    assert!(error.contains("points3D.txt") && error.contains("line 2: expected 2 points"), "{error}");
    let no_comment = cut.replace("Number of points", "Number of images");
    assert_eq!(points_text(&no_comment).unwrap().len(), 1, "a count of something else");
}

#[test]
fn a_file_with_fewer_cameras_than_its_header_states_is_an_error() {
    let text = "# Number of cameras: 2\n1 SIMPLE_PINHOLE 8 6 5 4 3\n2 SIMPLE_PINHOLE 8 6 5 4 3\n";
    assert_eq!(cameras_text(text).unwrap().len(), 2);
    let cut = text.strip_suffix("2 SIMPLE_PINHOLE 8 6 5 4 3\n").unwrap();
    let error = cameras_text(cut).unwrap_err().to_string();
    assert!(error.contains("line 1: expected 2 cameras, as the comment states, found 1"), "{error}");
}

#[test]
fn an_image_id_twice_is_an_error() {
    let image = |id: u32, name: &str| format!("{id} 1 0 0 0 0 0 0 1 {name}\n\n");
    let error = images_text(&[image(7, "a.png"), image(8, "b.png"), image(7, "c.png")].concat()).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("line 5, IMAGE_ID: expected a unique image id, found 7 a second time"), "{message}");
    let stored = |id: u32| {
        let pose = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0f64].map(f64::to_le_bytes);
        binary(&[&id.to_le_bytes(), pose.as_flattened(), &1u32.to_le_bytes(), b"a.png\0", &0u64.to_le_bytes()])
    };
    let both = |second| {
        let bytes = binary(&[&2u64.to_le_bytes(), &stored(7), &stored(second)]);
        parse_images(&bytes, Encoding::Binary, Path::new("images.bin"))
    };
    assert_eq!(both(8).unwrap().len(), 2);
    let message = both(7).unwrap_err().to_string();
    assert!(message.contains("expected a unique image id, found 7 a second time"), "{message}");
}

/// The counted warnings of a capture, each with its text.
fn warned(folder: &Path) -> Vec<(WarningKind, String)> {
    let source = ColmapScenes::open(folder, ColmapOptions::default()).unwrap();
    let mut warnings = Warnings::new();
    for key in source.keys() {
        source.load(key, &mut warnings).unwrap();
    }
    warnings.kept().iter().map(|warning| (warning.kind, warning.detail.clone())).collect()
}

/// The names are sorted, so the frames of `b.png` are 1 and 2.
#[test]
fn one_image_under_two_poses_and_scaled_quaternions_are_counted() {
    let images = "1 2 0 0 0 0 0 0 1 b.png\n\n2 1 0 0 0 5 0 0 1 a.png\n\n3 1.0004 0 0 0 0 3 0 1 b.png\n\n";
    let folder = capture(images, &["images/a.png", "images/b.png"]);
    let found = warned(folder.path());
    let [(rotation, scaled), (duplicate, repeated)] = found.as_slice() else { panic!("{found:?}") };
    assert_eq!((*rotation, *duplicate), (WarningKind::ImperfectRotation, WarningKind::DuplicateImage));
    assert!(scaled.contains("1 of 3 images, first b.png") && scaled.contains("found 2;"), "{scaled}");
    assert!(repeated.contains("1 of 3 frames") && repeated.contains("first frame 2 that of frame 1"), "{repeated}");
}

#[test]
fn further_models_of_a_capture_are_counted() {
    let folder = capture("1 1 0 0 0 0 0 0 1 a.png\n\n", &["images/a.png"]);
    let sparse = folder.path().join("sparse");
    std::fs::create_dir(sparse.join("2")).unwrap();
    assert_eq!(warned(folder.path()), [], "a folder without a model");
    for name in ["1", "aligned"] {
        std::fs::create_dir(sparse.join(name)).unwrap();
        for file in ["cameras.txt", "images.txt"] {
            std::fs::copy(sparse.join("0").join(file), sparse.join(name).join(file)).unwrap();
        }
    }
    let found = warned(folder.path());
    let [(WarningKind::IgnoredScene, detail)] = found.as_slice() else { panic!("{found:?}") };
    assert!(detail.contains("model 0 is used") && detail.contains("are not: 1 ("), "{detail}");
    assert_eq!(warned(&sparse.join("0")), [], "this model was chosen");
}

/// `f` is the horizontal focal length, of images 200 pixels wide; the vertical one is 100.
#[test]
fn implausible_focal_lengths_are_counted() {
    for (f, expected) in
        [("100", None), ("1000", Some("10.00 : 1")), ("160", Some("1.60 : 1")), ("0.5", Some("multiples"))]
    {
        let folder = capture("1 1 0 0 0 0 0 0 1 a.png\n\n", &["images/a.png"]);
        let camera = format!("1 PINHOLE 200 100 {f} 100 100 50\n");
        std::fs::write(folder.path().join("sparse/0/cameras.txt"), camera).unwrap();
        let found = warned(folder.path());
        match (expected, found.as_slice()) {
            (None, []) => {}
            (Some(text), [(WarningKind::ImplausibleIntrinsics, detail)]) => {
                assert!(detail.contains(text) && detail.contains("200×100"), "{detail}");
            }
            _ => panic!("{f}: {found:?}"),
        }
    }
}

#[test]
fn quaternions_of_any_length_are_normalised() {
    for scale in [1e-300, 1.0, 1e300] {
        let half = std::f64::consts::FRAC_1_SQRT_2 * scale;
        // A quarter turn about z takes x to y.
        let pose = pose_from([half, 0.0, 0.0, half], [0.0; 3]).unwrap().unwrap();
        Tolerance::F64.assert(pose.transform_vector(DVec3::X).to_array(), [0.0, 1.0, 0.0], "quarter turn");
        Tolerance::ORTHONORMAL.assert([pose.orthonormality_residual()], [0.0], "rotation");
    }
    for broken in [[0.0; 4], [f64::NAN, 0.0, 0.0, 1.0], [f64::INFINITY, 0.0, 0.0, 0.0]] {
        assert!(pose_from(broken, [0.0; 3]).is_none(), "{broken:?}");
    }
}

#[test]
fn points_have_colour_and_error() {
    let points =
        points_text("# header\n63390 1.67 0.29 -1.5 115 121 122 1.33 16 6542 15 7345\n7 0 0 0 1 2 3 -1\n").unwrap();
    assert_eq!((points[0].id, points[0].color, points[0].position.x), (63390, [115, 121, 122], 1.67));
    assert_eq!((points[0].error, points[1].error), (1.33, -1.0));
    let half = points_text("7 0 0 0 1 2 3 -1 16 6542 15\n").unwrap_err().to_string();
    assert!(half.contains("POINT2D_IDX"), "{half}");
}

#[test]
fn messages_name_line_and_field() {
    let error = |result: Result<(), SceneError>| result.unwrap_err().to_string();
    let no_pose = |line: &str| images_text(line).unwrap()[0].camera_from_world.clone().unwrap_err();
    for (found, expected) in [
        (
            error(cameras_text("\n1 PINHOLE 200 100 1 2 3").map(drop)),
            "line 2, PARAMS: expected 4 parameters of PINHOLE, found 3",
        ),
        (
            error(cameras_text("1 CATADIOPTRIC 200 100 1").map(drop)),
            "line 1, MODEL: camera model \"CATADIOPTRIC\" is not supported",
        ),
        (error(cameras_text("1 PINHOLE 0 100 1 2 3 4").map(drop)), "line 1, WIDTH: expected a length above 0"),
        (
            error(cameras_text("1 PINHOLE 9 9 1 2 3 4\n1 PINHOLE 9 9 1 2 3 4").map(drop)),
            "line 2, CAMERA_ID: expected a unique camera id",
        ),
        (error(images_text("1 1 0 0 x 0 0 0 1 a.png").map(drop)), "line 1, QZ: expected a number, found \"x\""),
        (no_pose("1 0 0 0 0 0 0 0 1 a.png"), "line 1, QW: expected a quaternion"),
        (no_pose("1 1 0 0 0 nan 0 0 1 a.png"), "line 1, TX: translation x: expected a finite number"),
        (error(images_text("1 1 0 0 0 0 0 0 1").map(drop)), "line 1, NAME: expected a UTF-8 name"),
        (error(points_text("1 0 0 inf 1 2 3 0").map(drop)), "line 1, Z: expected a finite number, found inf"),
        (
            error(points_text("1 0 0 0 1 2 300 0").map(drop)),
            "line 1, B: expected a whole number of 8 bits, found \"300\"",
        ),
        (error(points_text("1 0 0 0 1 2 3 0 16").map(drop)), "line 1, POINT2D_IDX: expected a value, found the end"),
    ] {
        assert!(found.contains(expected), "{found}\ndoes not contain {expected}");
    }
}

#[test]
fn counts_that_exceed_the_file_are_errors_before_allocation() {
    let huge = u64::MAX.to_le_bytes();
    let path = Path::new("x.bin");
    assert!(parse_cameras(&huge, Encoding::Binary, path).is_err());
    assert!(parse_images(&huge, Encoding::Binary, path).is_err());
    assert!(parse_points(&huge, Encoding::Binary, path).is_err());
    let one = 1u64.to_le_bytes();
    let point = binary(&[&one, &one, &[0; 24], &[0; 3], &[0; 8], &huge]);
    let error = parse_points(&point, Encoding::Binary, path).unwrap_err().to_string();
    assert!(
        error.contains("track: expected at most 0, which the file has room for, found 18446744073709551615"),
        "{error}"
    );
    let image =
        binary(&[&one, &[0; 4], &1f64.to_le_bytes(), &[0; 48], &[0; 4], b"a.png\0", &(1u64 << 61).to_le_bytes()]);
    assert!(parse_images(&image, Encoding::Binary, path).unwrap_err().to_string().contains("points2D"));
}

#[test]
fn trailing_bytes_are_an_error() {
    let bytes = binary(&[&0u64.to_le_bytes(), b"x"]);
    assert!(
        parse_points(&bytes, Encoding::Binary, Path::new("x.bin")).unwrap_err().to_string().contains("byte 8, end")
    );
}

/// The same model written by COLMAP in both encodings, with its content as COLMAP reads it; see
/// `tests/fixtures/make_colmap_models.py`.
#[test]
fn reads_models_written_by_colmap_as_colmap_does() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/colmap");
    let expected: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("expected.json")).unwrap()).unwrap();
    let items = |name: &str| expected[name].as_array().unwrap().clone();
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    for encoding in ["text", "binary"] {
        let model = folder.join(encoding);
        let read = |name| {
            let (file, encoding) = model_file(&model, name);
            (std::fs::read(&file).unwrap(), encoding, file)
        };
        let (bytes, kind, file) = read("cameras");
        let cameras = parse_cameras(&bytes, kind, &file).unwrap();
        assert_eq!(cameras.len(), items("cameras").len());
        for camera in items("cameras") {
            let found = &cameras[&u32::try_from(camera["id"].as_u64().unwrap()).unwrap()];
            assert_eq!(found.model.name(), camera["model"]);
            assert_eq!((found.size.width, found.size.height), (640, 480));
            Tolerance::EXACT.assert(found.parameters.clone(), numbers(&camera["params"]), encoding);
            found.lens("camera", &file).unwrap();
        }

        let (bytes, kind, file) = read("images");
        let mut images = parse_images(&bytes, kind, &file).unwrap();
        images.sort_by_key(|image| image.id);
        assert_eq!(images.len(), items("images").len());
        for (found, image) in images.iter().zip(items("images")) {
            assert_eq!(
                (u64::from(found.id), found.name.as_str()),
                (image["id"].as_u64().unwrap(), image["name"].as_str().unwrap())
            );
            assert_eq!(u64::from(found.camera_id), image["camera"].as_u64().unwrap());
            let rows = found.camera_from_world.as_ref().unwrap().to_rows();
            Tolerance::ORTHONORMAL.assert(rows, numbers(&image["rows"]), encoding);
        }

        let mut points = read_points(&model).unwrap();
        points.sort_by_key(|point| point.id);
        assert_eq!(points.len(), items("points").len());
        for (found, point) in points.iter().zip(items("points")) {
            assert_eq!(found.id, point["id"].as_u64().unwrap());
            Tolerance::EXACT.assert(found.position.to_array(), numbers(&point["xyz"]), encoding);
            Tolerance::EXACT.assert(found.color.map(f64::from), numbers(&point["rgb"]), encoding);
            Tolerance::EXACT.assert([found.error], [point["error"].as_f64().unwrap()], encoding);
        }
    }
}

/// A capture in a temporary folder, with `files` as empty images.
fn capture(images: &str, files: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |path: PathBuf, bytes: &[u8]| {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    };
    write(folder.path().join("sparse/0/cameras.txt"), b"1 PINHOLE 200 100 100 110 100 50\n");
    write(folder.path().join("sparse/0/images.txt"), images.as_bytes());
    for file in files {
        write(folder.path().join(file), b"");
    }
    folder
}

#[test]
fn frames_are_sorted_by_name_and_find_their_images() {
    let images = "1 1 0 0 0 0 0 0 1 left/b.png\n\n2 1 0 0 0 5 0 0 1 left/a.png\n\n3 1 0 0 0 0 3 0 1 c.png\n\n";
    let folder = capture(images, &["images/left/a.png", "images/left/b.jpg", "images_4/left/a.png"]);
    let mut warnings = Warnings::new();
    let source = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap();
    let scene = source.load(&source.keys()[0], &mut warnings).unwrap();
    let names: Vec<_> = scene.frames.iter().map(|frame| frame.name.as_str()).collect();
    assert_eq!(names, ["c", "left/a", "left/b"]);
    let counts: Vec<_> = warnings.counts().collect();
    assert_eq!(counts, [(WarningKind::MissingImage, 1), (WarningKind::ImageAtOtherPath, 1)]);

    let options = ColmapOptions { images: crate::ImageFolder::Downscaled(4), ..ColmapOptions::default() };
    let source = ColmapScenes::open(folder.path(), options).unwrap();
    let scene = source.load(&source.keys()[0], &mut Warnings::new()).unwrap();
    let crate::FrameImage::File(path) = &scene.frames[1].image else { panic!("{:?}", scene.frames[1].image) };
    assert!(path.ends_with("images_4/left/a.png"), "{}", path.display());
    let frame = &scene.frames[1];
    assert_eq!(frame.stated_size, Some(ImageSize { width: 200, height: 100 }));
    assert!(frame.mismatch(ImageSize { width: 50, height: 25 }).is_none());
    let cropped = frame.mismatch(ImageSize { width: 50, height: 27 }).unwrap();
    assert!(cropped.is_fatal() && cropped.to_string().contains("200×100"), "{cropped}");
}

/// Cameras and images of two encodings may be of two models.
#[test]
fn one_model_has_one_encoding() {
    let folder = capture("1 1 0 0 0 0 0 0 1 a.png\n", &[]);
    let model = folder.path().join("sparse/0");
    let lens = [50.0f64, 50.0, 100.0, 50.0].map(f64::to_le_bytes).concat();
    let [one, width, height] = [1u64, 200, 100].map(u64::to_le_bytes);
    let cameras = binary(&[&one, &1u32.to_le_bytes(), &1i32.to_le_bytes(), &width, &height, &lens]);
    std::fs::write(model.join("cameras.bin"), cameras).unwrap();
    let source = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap();
    let scene = source.load(&source.keys()[0], &mut Warnings::new()).unwrap();
    Tolerance::F64.assert([scene.frames[0].camera.intrinsics.fx], [0.5], "100 of 200 pixels, as in cameras.txt");
    std::fs::remove_file(model.join("cameras.txt")).unwrap();
    let error = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap_err().to_string();
    assert!(error.contains("both .bin or both .txt"), "{error}");
}

#[test]
fn names_outside_the_capture_and_unknown_cameras_are_errors() {
    let load = |images: &str| {
        let folder = capture(images, &[]);
        let source = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap();
        source.load(&source.keys()[0], &mut Warnings::new()).unwrap_err()
    };
    for name in ["../../etc/passwd", "../x.png", "/etc/passwd"] {
        let error = load(&format!("1 1 0 0 0 0 0 0 1 {name}\n"));
        assert!(matches!(error, SceneError::OutsideScene { .. }), "{name}: {error}");
    }
    assert!(load("1 1 0 0 0 0 0 0 9 a.png\n").to_string().contains("image 1: expected a camera"));
    assert!(load("# none\n").to_string().contains("expected at least one image"));
}

proptest! {
    #[test]
    fn any_bytes_give_a_value_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300), items in 0u64..4) {
        let counted = [items.to_le_bytes().as_slice(), &bytes].concat();
        for encoding in [Encoding::Text, Encoding::Binary] {
            for bytes in [&bytes, &counted] {
                parse_cameras(bytes, encoding, Path::new("x")).ok();
                parse_images(bytes, encoding, Path::new("x")).ok();
                parse_points(bytes, encoding, Path::new("x")).ok();
            }
        }
    }
}

#[test]
fn points_are_found_wherever_models_are() {
    assert_eq!(model_folders_in_words(), "the folder itself, sparse/0, sparse and colmap/sparse/0");
    for place in MODEL_FOLDERS {
        let capture = tempfile::tempdir().unwrap();
        let folder = capture.path().join(place);
        std::fs::create_dir_all(&folder).unwrap();
        assert_eq!(points_folder(capture.path()), None);
        std::fs::write(folder.join("points3D.bin"), b"").unwrap();
        let found = points_folder(capture.path()).unwrap();
        assert_eq!(found.canonicalize().unwrap(), folder.canonicalize().unwrap());
    }
}
