use super::*;
use crate::torch;
use std::fs;

use atsplat_numeric::Tolerance;
use glam::DVec3;

const TRAJECTORY: &str = "https://youtu.be/x\n1 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n";
const TRANSFORMS: &str = r#"{"w": 4, "h": 3, "fl_x": 4, "frames": [{"file_path": "images/a_7.png",
    "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;

fn folder_of(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        atsplat_tests::write_file(&folder.path().join(name), bytes);
    }
    folder
}

fn opened(files: &[(&str, &[u8])], below: &str) -> Result<(Format, Vec<String>), SceneError> {
    let folder = folder_of(files);
    let dataset = open(folder.path().join(below), &mut Warnings::new())?;
    Ok((dataset.format, dataset.keys().to_vec()))
}

fn expect(files: &[(&str, &[u8])], below: &str, format: Format, keys: &[&str]) {
    let (found, found_keys) = opened(files, below).unwrap();
    assert_eq!(
        (found, found_keys),
        (format, keys.iter().map(|key| (*key).to_owned()).collect()),
        "{files:?} {below:?}"
    );
}

#[test]
fn trajectories_are_distinguished_from_other_text() {
    let text = TRAJECTORY.as_bytes();
    expect(&[("b.txt", text), ("a.txt", text)], "", Format::Re10k, &["a", "b"]);
    expect(&[("b/b.txt", text), ("a/a.txt", text)], "", Format::Re10k, &["a", "b"]);
    expect(&[("b.txt", text)], "b.txt", Format::Re10k, &["b"]);
    expect(&[("trajectory.csv", text)], "trajectory.csv", Format::Re10k, &["trajectory"]);
    assert!(matches!(opened(&[("notes.txt", b"hello world")], ""), Err(SceneError::Unrecognized { .. })));
    assert!(matches!(opened(&[("notes.txt", b"hello world")], "notes.txt"), Err(SceneError::Unrecognized { .. })));
}

#[test]
fn transforms_are_found_at_every_depth() {
    let json = TRANSFORMS.as_bytes();
    expect(&[("scene/transforms.json", json)], "scene", Format::Nerfstudio, &["scene"]);
    expect(&[("scene/transforms.json", json)], "scene/transforms.json", Format::Nerfstudio, &["scene"]);
    expect(&[("scene/poses.json", json)], "scene/poses.json", Format::Nerfstudio, &["scene"]);
    expect(&[("h/nerfstudio/transforms.json", json)], "h", Format::Nerfstudio, &["h"]);
    expect(&[("h/nerfstudio/transforms.json", json)], "h/nerfstudio", Format::Nerfstudio, &["h"]);
    let two = [("b/gaussian_splat/transforms.json", json), ("a/nerfstudio/transforms.json", json)];
    expect(&two, "", Format::Nerfstudio, &["a", "b"]);
    expect(
        &[("1K/a/transforms.json", json), ("2K/b/transforms.json", json)],
        "",
        Format::Nerfstudio,
        &["dl3dv_a", "dl3dv_b"],
    );
}

#[test]
fn the_variant_of_a_dl3dv_scene_is_an_option() {
    let undistorted = TRANSFORMS.replace("a_7", "a_8");
    let folder = folder_of(&[
        ("g/transforms.json", TRANSFORMS.as_bytes()),
        ("g/gaussian_splat/transforms.json", undistorted.as_bytes()),
        ("h/nerfstudio/transforms.json", TRANSFORMS.as_bytes()),
        ("h/gaussian_splat/transforms.json", undistorted.as_bytes()),
        ("i/nerfstudio/transforms.json", TRANSFORMS.as_bytes()),
    ]);
    let opened = |below: &str, prefer_gaussian_splat| {
        let nerfstudio = NerfstudioOptions { prefer_gaussian_splat, ..NerfstudioOptions::default() };
        let options = OpenOptions { nerfstudio, ..OpenOptions::default() };
        open_with(folder.path().join(below), &options, &mut Warnings::new())
    };
    for (prefer_gaussian_splat, names) in [(false, ["a_7"; 3]), (true, ["a_8", "a_8", "a_7"])] {
        let dataset = opened("", prefer_gaussian_splat).unwrap();
        for (key, name) in ["g", "h", "i"].into_iter().zip(names) {
            assert_eq!(dataset.load(key, &mut Warnings::new()).unwrap().frames[0].name, name, "{key}");
        }
    }
    for below in ["g", "g/gaussian_splat", "g/gaussian_splat/transforms.json"] {
        assert_eq!(opened(below, true).unwrap().keys(), ["g"], "{below}");
    }
    let error = opened("i", true).unwrap_err().to_string();
    assert!(error.contains("gaussian_splat/transforms.json"), "only distorted captures: {error}");
}

#[test]
fn a_dataset_tells_what_was_applied_to_the_world_of_its_scenes() {
    let scaled = TRANSFORMS.replacen('{', r#"{"applied_scale": 3, "#, 1);
    let folder = folder_of(&[("a/transforms.json", scaled.as_bytes()), ("b/transforms.json", TRANSFORMS.as_bytes())]);
    let dataset = open(folder.path(), &mut Warnings::new()).unwrap();
    let applied = dataset.applied_transform("a").unwrap().unwrap();
    let saved = applied.saved_point(DVec3::new(1.0, 2.0, -4.0));
    Tolerance::F64.assert(saved.to_array(), [3.0, 6.0, -12.0], "a point of structure from motion");
    assert_eq!(dataset.applied_transform("b").unwrap(), None);
}

#[test]
fn colmap_models_are_found_in_all_capture_layouts() {
    let model = |folder: &str| -> Vec<(String, &[u8])> {
        vec![
            (format!("{folder}/cameras.txt"), b"1 PINHOLE 4 3 4 4 2 1.5\n"),
            (format!("{folder}/images.txt"), b"1 1 0 0 0 0 0 0 1 a.png\n\n"),
        ]
    };
    for (folder, below, key) in [
        ("desk/sparse/0", "desk", "desk"),
        ("desk/sparse/0", "desk/sparse/0", "desk"),
        ("desk/sparse/0", "desk/sparse/0/images.txt", "desk"),
        ("desk/sparse/0", "", "desk"),
        ("desk/colmap/sparse/0", "desk", "desk"),
        ("desk/sparse", "desk", "desk"),
        ("desk", "desk", "desk"),
    ] {
        let files = model(folder);
        let files: Vec<_> = files.iter().map(|(name, bytes)| (name.as_str(), *bytes)).collect();
        expect(&files, below, Format::Colmap, &[key]);
    }
}

#[test]
fn missing_and_unknown_content_are_errors() {
    assert!(matches!(open("/nowhere/at/all", &mut Warnings::new()), Err(SceneError::Io(_))));
    assert!(matches!(opened(&[], ""), Err(SceneError::Unrecognized { .. })));
    assert!(matches!(opened(&[("x.bin", &[0; 64])], "x.bin"), Err(SceneError::Unrecognized { .. })));
}

#[test]
fn errors_describe_unsupported_json() {
    for (text, expected) in [
        ("[[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]]", "found a list of 1 camera matrices without intrinsics"),
        ("[{\"img_name\": \"a\", \"position\": [], \"rotation\": []}]", "is a camera of 3DGS' cameras.json"),
        (
            r#"{"5aca": {"context": [58, 133], "target": [93]}}"#,
            "of which \"5aca\" is an entry of an evaluation index, which --index takes (",
        ),
        (r#"{"w": 4, "h": "#, "expected complete JSON, found the end of the file: it is cut off ("),
    ] {
        let error = opened(&[("poses.json", text.as_bytes())], "poses.json").unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("poses.json"), "{error}");
    }
}

/// Keys may be in any order, and as far from the start as the others' values are long.
#[test]
fn a_transforms_json_of_any_name_is_known_by_its_keys() {
    let long = format!("{:?}", "x".repeat(1 << 17));
    let frames_last = TRANSFORMS.replacen('{', &format!(r#"{{"notes": {long}, "#), 1);
    for text in [TRANSFORMS, &frames_last, r#"{"camera_angle_x": 0.7}"#] {
        expect(&[("s/poses.json", text.as_bytes())], "s/poses.json", Format::Nerfstudio, &["s"]);
    }
    // An index of thousands of scenes, one of which is named like a key.
    let entry = r#"{"context": [58, 133], "target": [93]}"#;
    let index: Vec<String> = (0..3000).map(|scene| format!(r#""{scene:04}": {entry}"#)).collect();
    let index = format!(r#"{{{}, "last": {{"frames": []}}}}"#, index.join(", "));
    let error = opened(&[("index.json", index.as_bytes())], "index.json").unwrap_err().to_string();
    assert!(index.len() > 1 << 16 && error.contains("a table of 3001 entries, of which "), "{error}");
}

#[test]
fn every_format_is_tried_and_named_where_none_is_found() {
    let mut tried = TRIED;
    tried.sort();
    assert_eq!(tried, Format::ALL);
    let error = opened(&[], "").unwrap_err().to_string();
    let expected = "expected RE10K trajectories, .torch chunks, a transforms.json or a COLMAP model, found ";
    assert!(error.starts_with(expected), "{error}");
}

/// Images of any format, and what no format reads, are not among them.
#[test]
fn files_of_formats_are_known_by_their_names() {
    let chunks = folder_of(&[("000.torch", b"")]);
    let index_of_chunks = chunks.path().join("index.json");
    let formats = |path: &Path| Format::ALL.map(|format| format.reads_file(path));
    for (path, expected) in [
        ("a/b.txt", [true, false, false, false]),
        ("sparse/0/images.txt", [true, false, false, true]),
        ("points3D.bin", [false, false, false, true]),
        ("a/transforms.json", [false, false, true, false]),
        ("a/dslr/nerfstudio/transforms_undistorted.json", [false, false, true, false]),
        ("b.torch", [false, true, false, false]),
        ("a/index.json", [false; 4]),
        ("a/b.bin", [false; 4]),
        ("images.png", [false; 4]),
        ("transforms_train.json", [false; 4]),
    ] {
        assert_eq!(formats(Path::new(path)), expected, "{path}");
    }
    assert_eq!(formats(&index_of_chunks), [false, true, false, false]);
}

#[test]
fn names_match_serde() {
    for format in Format::ALL {
        assert_eq!(serde_json::to_string(&format).unwrap(), format!("{:?}", format.name()));
    }
}

#[test]
fn errors_explain_why_text_is_not_a_trajectory() {
    let short = b"https://youtu.be/x\n1 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1\n";
    for below in ["", "a.txt"] {
        let message = opened(&[("a.txt", short)], below).unwrap_err().to_string();
        assert!(message.contains("line 2") && message.contains("19 columns, found 18"), "{message}");
    }
}

#[test]
fn errors_say_what_a_colmap_model_lacks() {
    let [cameras, images] = MODEL.map(|(_, bytes)| bytes);
    let without_cameras = [("room/images/a.png", &b""[..]), ("room/sparse/0/images.txt", images)];
    let points = [("room/images/a.png", &b""[..]), ("room/sparse/0/points3D.bin", b"")];
    let without_images = [("room/sparse/0/cameras.bin", cameras), points[1]];
    let mixed = [("room/sparse/0/cameras.bin", cameras), ("room/sparse/0/images.txt", images)];
    let separate = "images.txt without cameras.txt, and cameras.bin without images.bin";
    for (files, below, expected) in [
        (&without_cameras, "room", "images.txt without cameras.txt"),
        (&without_cameras, "room/sparse/0", "images.txt without cameras.txt"),
        (&without_cameras, "room/sparse/0/images.txt", "images.txt without cameras.txt"),
        (&without_cameras, "", "images.txt without cameras.txt"),
        (&without_images, "room", "cameras.bin and points3D.bin without images.bin"),
        (&points, "room", "points3D.bin without cameras.bin and images.bin"),
        (&mixed, "room", separate),
    ] {
        let message = opened(files, below).unwrap_err().to_string();
        let expected = format!(", found a part of a COLMAP model, {expected} in ");
        assert!(message.contains(&expected) && message.contains("sparse/0"), "{below:?}: {message}");
        assert!(!message.contains("19 columns"), "{message}");
    }
}

/// As `data simulate` writes them, and as a set of captures whose folder was not given.
#[test]
fn errors_name_datasets_below_a_folder() {
    let (json, rows) = (TRANSFORMS.as_bytes(), TRAJECTORY.as_bytes());
    let files = [
        ("test/a.txt", rows),
        ("images/1.png", b""),
        ("train/images.txt", b"hello"),
        ("val/b.txt", rows),
        ("LICENSE.txt", b""),
    ];
    let message = opened(&files, "").unwrap_err().to_string();
    let [test, val] = ["/test (re10k), ", "/val (re10k) ("];
    assert!(message.contains("but with datasets below it: ") && message.contains(test), "{message}");
    assert!(message.contains(val) && !message.contains("a part of"), "{message}");
    let deep = opened(&[("all/dl3dv/1K/h/transforms.json", json)], "").unwrap_err().to_string();
    assert!(deep.contains("found a folder without these ("), "only one level: {deep}");
}

/// Renders are photos of some commands and no dataset.
#[test]
fn errors_name_the_record_of_renders() {
    let message = opened(&[("render.json", b"{}".as_slice()), ("000000.png", b"")], "").unwrap_err().to_string();
    assert!(
        message.contains("but with the render.json of `atsplat render`: `reconstruct` and `fit` read"),
        "{message}"
    );
    let dataset = [("render.json", b"{}".as_slice()), ("a.txt", TRAJECTORY.as_bytes())];
    assert!(opened(&dataset, "").is_ok(), "next to a dataset");
}

/// The number at the end of a name is not a timestamp, neither of one image under three poses nor of two cameras' images.
#[test]
fn repeated_images_and_numbers_of_names_are_told_apart() {
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
    let frame = |path: &str| format!(r#"{{"file_path": "{path}", "transform_matrix": {pose}}}"#);
    let frames = ["l/a_7.png", "l/a_7.png", "r/a_7.png", "l/a_6.png", "l/a_7.png"].map(frame).join(",");
    let json = format!(r#"{{"w": 4, "h": 3, "fl_x": 4, "frames": [{frames}]}}"#);
    let folder =
        folder_of(&[("room/transforms.json", json.as_bytes()), ("room/l/a_7.png", b""), ("room/r/a_7.png", b"")]);
    let mut warnings = Warnings::new();
    let dataset = open(folder.path().join("room"), &mut warnings).unwrap();
    dataset.load("room", &mut warnings).unwrap();
    let detail = |kind| {
        let of_kind: Vec<_> = warnings.kept().iter().filter(|warning| warning.kind == kind).collect();
        assert_eq!(of_kind.len(), 1, "{kind}");
        of_kind[0].detail.as_str()
    };
    let image = folder.path().join("room/l/a_7.png");
    let twice = "2 of 5 frames repeat an earlier image, first frame 1 that of frame 0";
    assert_eq!(detail(crate::WarningKind::DuplicateImage), format!("{twice}: {}", image.display()));
    let numbers = "1 numbers at the end of images' names repeat, the smallest is 7";
    assert_eq!(detail(crate::WarningKind::DuplicateTimestamp), numbers);
    let order = "numbers at the end of images' names go backwards 1 times in 5 frames";
    assert_eq!(detail(crate::WarningKind::UnorderedTimestamps), order);
}

#[test]
fn a_second_trajectory_of_one_key_is_skipped_with_a_warning() {
    let second = TRAJECTORY.replace("\n1 ", "\n2 ");
    let folder = folder_of(&[
        ("clip.txt", TRAJECTORY.as_bytes()),
        ("clip/clip.txt", second.as_bytes()),
        ("other/other.txt", second.as_bytes()),
    ]);
    let mut warnings = Warnings::new();
    let dataset = open(folder.path(), &mut warnings).unwrap();
    assert_eq!(dataset.keys(), ["clip", "other"]);
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(crate::WarningKind::DuplicateScene, 1)]);
    let [used, left] = ["clip.txt", "clip/clip.txt"].map(|name| folder.path().join(name).display().to_string());
    assert_eq!(warnings.kept()[0].to_string(), format!("clip: {used} is used, not {left}"));
    let read = |key: &str| dataset.load(key, &mut Warnings::new()).unwrap().frames[0].timestamp_micros;
    assert_eq!([read("clip"), read("other")], [Some(1), Some(2)]);
}

const MODEL: [(&str, &[u8]); 2] =
    [("cameras.txt", b"1 PINHOLE 4 3 4 4 2 1.5\n"), ("images.txt", b"1 1 0 0 0 0 0 0 1 a.png\n\n")];

/// Format, keys, and the warnings as kind and text.
fn reported(files: &[(&str, &[u8])], below: &str) -> (Format, Vec<String>, Vec<(crate::WarningKind, String)>) {
    let folder = folder_of(files);
    let mut warnings = Warnings::new();
    let dataset = open(folder.path().join(below), &mut warnings).unwrap();
    let kept = warnings.kept().iter().map(|warning| (warning.kind, warning.to_string())).collect();
    (dataset.format, dataset.keys().to_vec(), kept)
}

#[track_caller]
fn expect_ignored(files: &[(&str, &[u8])], format: Format, key: &str, expected: &[(&str, &str)]) {
    let (found, keys, kept) = reported(files, "");
    assert_eq!((found, keys), (format, vec![key.to_owned()]));
    assert_eq!(kept.len(), expected.len(), "{kept:?}");
    for ((kind, message), (scene, text)) in kept.iter().zip(expected) {
        assert_eq!(*kind, crate::WarningKind::IgnoredScene);
        assert!(message.starts_with(&format!("{scene}: ")) && message.contains(text), "{message}");
    }
}

#[test]
fn scenes_in_other_formats_are_counted() {
    let (json, rows) = (TRANSFORMS.as_bytes(), TRAJECTORY.as_bytes());
    let [cameras, images] = MODEL.map(|(_, bytes)| bytes);
    let model = [("b/sparse/0/cameras.txt", cameras), ("b/sparse/0/images.txt", images)];
    let files =
        [&[("a/transforms.json", json), ("c.txt", rows), ("c/1.png", b""), ("README.txt", b"hello")], &model[..]];
    let left = [("b", "a COLMAP model is not read"), ("c", "an RE10K trajectory is not read")];
    expect_ignored(&files.concat(), Format::Nerfstudio, "a", &left);
    expect_ignored(
        &[&[("c/c.txt", rows), ("c/images/1.png", b"")], &model[..]].concat(),
        Format::Colmap,
        "b",
        &[("c", "an RE10K trajectory is not read, because the dataset is read as colmap")],
    );
    let broken = [&model[..], &[("c/images/a.png", &b""[..]), ("c/sparse/0/images.txt", images)]].concat();
    let part = "contains images.txt without cameras.txt, but no COLMAP model";
    expect_ignored(&broken, Format::Colmap, "b", &[("c", part)]);
    let subsets = [("1K/a/transforms.json", json), ("1K/b/cameras.txt", cameras), ("1K/b/images.txt", images)];
    expect_ignored(&subsets, Format::Nerfstudio, "dl3dv_a", &[("b", "a COLMAP model")]);
    // A capture next to a folder of captures, which is read as one only where nothing else is.
    let captures = [("a/transforms.json", json), ("1K/x/transforms.json", json), ("1K/y/transforms.json", json)];
    expect_ignored(&captures, Format::Nerfstudio, "a", &[("1K", "contains 2 folders with a transforms.json")]);
}

/// COLMAP numbers the parts of a capture, and `0` may have been deleted; other programs name the folder.
#[test]
fn models_in_other_folders_than_those_of_captures_are_counted() {
    let [cameras, images] = MODEL.map(|(_, bytes)| bytes);
    let model = |folder: &str| [(format!("{folder}/cameras.txt"), cameras), (format!("{folder}/images.txt"), images)];
    let models = [model("a/sparse/0"), model("b/sparse/1"), model("b/sparse/2"), model("c/model"), model("d/.old")];
    let models = models.concat();
    let mut files: Vec<_> = models.iter().map(|(name, bytes)| (name.as_str(), *bytes)).collect();
    files.extend([("b/images/a.png", &b""[..]), ("c/images/a.png", b""), ("d/sparse/0/points3D.txt", b"")]);
    let part = "contains points3D.txt without cameras.txt and images.txt";
    let left = [
        ("b", "a COLMAP model in sparse/1, which is not read: a capture's model is looked for in the folder itself"),
        ("c", "a COLMAP model in model, which is not read"),
        ("d", part),
    ];
    expect_ignored(&files, Format::Colmap, "a", &left);
    files.retain(|(name, _)| !name.starts_with("a/") && !name.starts_with("d/"));
    files.push(("e/transforms.json", TRANSFORMS.as_bytes()));
    expect_ignored(&files, Format::Nerfstudio, "e", &left[..2]);
    files.retain(|(name, _)| name.starts_with("b/"));
    let message = opened(&files, "").unwrap_err().to_string();
    assert!(
        message.contains("but with a COLMAP model in ") && message.contains("b/sparse/1: give that folder ("),
        "{message}"
    );
}

/// As Blender's synthetic scenes are split.
#[test]
fn errors_point_at_files_named_like_a_transforms_json() {
    let json = TRANSFORMS.as_bytes();
    let files = [("lego/transforms_train.json", json), ("lego/transforms_val.json", json), ("lego/train/a.png", b"")];
    let message = opened(&files, "lego").unwrap_err().to_string();
    let expected = "a folder without these, but with transforms_train.json and transforms_val.json: give that file (";
    assert!(message.contains(expected) && message.ends_with("lego)"), "{message}");
    expect(&files, "lego/transforms_train.json", Format::Nerfstudio, &["lego"]);
}

/// A model of structure from motion, copies of images and notes.
#[test]
fn what_is_in_a_capture_belongs_to_it() {
    let (json, rows) = (TRANSFORMS.as_bytes(), TRAJECTORY.as_bytes());
    let [cameras, images] = MODEL.map(|(_, bytes)| bytes);
    let capture: [(&str, &[u8]); 7] = [
        ("s/h/transforms.json", json),
        ("s/h/colmap/sparse/0/cameras.txt", cameras),
        ("s/h/colmap/sparse/0/images.txt", images),
        ("s/h/dense/cameras.txt", cameras),
        ("s/h/dense/images.txt", images),
        ("s/h/images_2/a_7.png", b""),
        ("s/.cache/images/a_7.png", b""),
    ];
    for below in ["s", "s/h"] {
        assert_eq!(reported(&capture, below), (Format::Nerfstudio, vec!["h".to_owned()], vec![]), "{below}");
    }
    let clip = [("k.txt", rows), ("images/00000.png", b""), ("thumbnails/1.png", b"")];
    assert_eq!(reported(&clip, ""), (Format::Re10k, vec!["k".to_owned()], vec![]));
    let clips = [("k/k.txt", rows), ("k/images/00000.png", &b""[..]), ("chunk/000000.torch", b"")];
    assert_eq!(reported(&clips, ""), (Format::Re10k, vec!["k".to_owned()], vec![]));
}

#[test]
fn images_without_cameras_are_counted() {
    let (json, rows) = (TRANSFORMS.as_bytes(), TRAJECTORY.as_bytes());
    let misspelt = [("a/transforms.json", json), ("b/transform.json", json), ("b/images/a_7.png", b"")];
    expect_ignored(&misspelt, Format::Nerfstudio, "a", &[("b", "contains transform.json, but no transforms.json")]);
    let deleted = [("a/transforms.json", json), ("b/nerfstudio/images_8/a_7.png", &b""[..]), ("out/0.png", b"")];
    expect_ignored(&deleted, Format::Nerfstudio, "a", &[("b", "contains images, but no transforms.json")]);
    let clips = [("a.txt", rows), ("a/1.png", b""), ("b/1.png", b""), ("c/images/1.jpg", b""), ("d/d.exr", b"")];
    let left = [("b", "contains images, but no trajectory b.txt"), ("c", "contains images, but no trajectory c.txt")];
    expect_ignored(&clips, Format::Re10k, "a", &left);
}

/// Neither other hidden files, nor what is in hidden folders.
#[test]
fn trajectories_whose_names_begin_with_a_dot_are_counted() {
    let rows = TRAJECTORY.as_bytes();
    let hidden = [("..b.txt", rows), (".c.txt", rows), (".notes.txt", b"hello"), (".d.csv", rows), (".e/e.txt", rows)];
    let text = "an RE10K trajectory is not read, because its name begins with a dot";
    let left = [("..b.txt", text), (".c.txt", text)];
    expect_ignored(&[&[("a.txt", rows)][..], &hidden[..]].concat(), Format::Re10k, "a", &left);
    let json = TRANSFORMS.as_bytes();
    expect_ignored(&[&[("a/transforms.json", json)][..], &hidden[..]].concat(), Format::Nerfstudio, "a", &left);
}

/// Keys are text. Other systems have no such names.
#[cfg(target_os = "linux")]
#[test]
fn scenes_whose_names_are_not_utf_8_are_counted() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt as _;

    let folder = folder_of(&[("a/transforms.json", TRANSFORMS.as_bytes()), ("notes", b"")]);
    let below = |name: &[u8]| folder.path().join(OsStr::from_bytes(name));
    for name in [&b"sc\xe8ne"[..], b"\xe8", b".\xe8"] {
        fs::create_dir(below(name)).unwrap();
        fs::write(below(name).join("transforms.json"), TRANSFORMS).unwrap();
    }
    fs::write(below(b"clip\xe8.txt"), TRAJECTORY).unwrap();
    fs::write(below(b"notes\xe8.txt"), "hello").unwrap();
    let mut warnings = Warnings::new();
    let dataset = open(folder.path(), &mut warnings).unwrap();
    assert_eq!((dataset.keys(), warnings.total()), (&["a".to_owned()][..], 3));
    let scenes: Vec<&str> = warnings.kept().iter().map(|warning| warning.scene.as_str()).collect();
    assert_eq!(scenes, ["clip\u{fffd}.txt", "sc\u{fffd}ne", "\u{fffd}"], "neither hidden folders nor other text");
    assert_eq!(warnings.count(crate::WarningKind::IgnoredScene), 3);
}

/// Which of the two counts cannot be known; the chunk comes first.
#[test]
fn one_key_in_two_formats_is_a_duplicate() {
    let folder = folder_of(&[("a.txt", TRAJECTORY.as_bytes()), ("a/1.png", &encoded_image())]);
    let mut warnings = Warnings::new();
    let trajectories = open(folder.path(), &mut warnings).unwrap();
    let mixed = tempfile::tempdir().unwrap();
    torch::export_chunks(&trajectories, &mixed.path().join("test"), 1, &mut warnings, &|| ()).unwrap();
    assert_eq!(warnings.total(), 0, "{:?}", warnings.kept());
    for (name, kind) in [("a", crate::WarningKind::DuplicateScene), ("b", crate::WarningKind::IgnoredScene)] {
        let text = mixed.path().join(format!("test/{name}.txt"));
        fs::write(&text, TRAJECTORY).unwrap();
        let mut warnings = Warnings::new();
        let dataset = open(mixed.path(), &mut warnings).unwrap();
        assert_eq!((dataset.format, dataset.keys()), (Format::TorchChunks, &["a".to_owned()][..]));
        let kept = warnings.kept();
        assert!(kept.len() == 1 && kept[0].kind == kind && kept[0].scene == name, "{kept:?}");
        fs::remove_file(text).unwrap();
    }
}

fn encoded_image() -> Vec<u8> {
    atsplat_pixels::encode_png(&atsplat_pixels::ImageU8::new(9, 5, vec![9; 135]).unwrap()).unwrap()
}
