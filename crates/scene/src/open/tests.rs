use super::*;
use std::fs;

const TRAJECTORY: &str = "https://youtu.be/x\n1 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n";
const TRANSFORMS: &str = r#"{"w": 4, "h": 3, "fl_x": 4, "frames": [{"file_path": "images/a_7.png",
    "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;

fn folder_of(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
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
    let folder = folder_of(&[
        ("h/nerfstudio/transforms.json", TRANSFORMS.as_bytes()),
        ("h/gaussian_splat/transforms.json", TRANSFORMS.replace("a_7", "a_8").as_bytes()),
    ]);
    for (prefer_gaussian_splat, name) in [(false, "a_7"), (true, "a_8")] {
        let nerfstudio = NerfstudioOptions { prefer_gaussian_splat, ..NerfstudioOptions::default() };
        let options = OpenOptions { nerfstudio, ..OpenOptions::default() };
        let dataset = open_with(folder.path(), &options, &mut Warnings::new()).unwrap();
        assert_eq!(dataset.load("h", &mut Warnings::new()).unwrap().frames[0].name, name);
    }
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
fn chunks_are_recognised_by_their_first_bytes() {
    assert!(is_chunk(b"PK\x03\x04rest"));
    assert!(is_chunk(b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M"));
    assert!(!is_chunk(b"\x80\x02}q\x00"), "any other pickle");
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
    ] {
        let error = opened(&[("poses.json", text.as_bytes())], "poses.json").unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("poses.json"), "{error}");
    }
    let index = br#"{"5aca87f95a9412c6": {"context": [58, 133], "target": [93]}}"#;
    let folder = folder_of(&[("index.json", index)]);
    let dataset = open(folder.path().join("index.json"), &mut Warnings::new()).unwrap();
    let error = dataset.load(&dataset.keys()[0], &mut Warnings::new()).unwrap_err().to_string();
    assert!(error.contains("frames") && error.contains("is an entry of an evaluation index"), "{error}");
}

#[test]
fn names_match_serde() {
    for format in [Format::Re10k, Format::TorchChunks, Format::Nerfstudio, Format::Colmap] {
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
fn a_duplicate_scene_is_skipped_with_a_warning() {
    let json = TRANSFORMS.as_bytes();
    let folder = folder_of(&[("1K/a/transforms.json", json), ("2K/a/transforms.json", json)]);
    let mut warnings = Warnings::new();
    let dataset = open(folder.path(), &mut warnings).unwrap();
    assert_eq!(dataset.keys(), ["dl3dv_a"]);
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(crate::WarningKind::DuplicateScene, 1)]);
    assert!(warnings.kept()[0].detail.contains("2K"), "{:?}", warnings.kept());
}
