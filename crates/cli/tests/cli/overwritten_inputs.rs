//! Commands do not overwrite what they read, nor files that another program wrote.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{SCENE, atsplat, succeed, write_trajectory};
use crate::evaluation::write_noise;
use atsplat_model::ModelConfig;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{KeyMap, ModelWeights, Precision, generated};

/// Every file below a folder, with its bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else {
            found.insert(path.clone(), fs::read(path).unwrap());
        }
    }
    found
}

/// Each call fails with its message, and leaves every file as it was.
fn rejects(here: &Path, calls: &[(&str, &str)]) {
    let before = contents(here);
    for (args, expected) in calls {
        atsplat(here, &args.split(' ').collect::<Vec<_>>()).says(1, expected);
        assert!(contents(here) == before, "{args}: a file was replaced");
    }
}

#[test]
fn weights_do_not_overwrite_what_they_are_made_from() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let config = ModelConfig::named("nano").unwrap();
    let stored = generated(&parameters(&config), 3);
    let weights = ModelWeights::new(config, BTreeMap::from([("data".to_owned(), "none".to_owned())]), &stored).unwrap();
    weights.write(&here.join("w.safetensors"), Precision::Single).unwrap();
    fs::write(here.join("map.toml"), "name = \"map\"\n").unwrap();
    fs::write(here.join("nano.toml"), toml::to_string(&weights.config).unwrap()).unwrap();
    assert!(KeyMap::resolve(here.join("map.toml").to_str().unwrap()).is_ok());
    rejects(
        here,
        &[
            (
                "weights export w.safetensors --key-map identity --out w.safetensors",
                "error: --out: w.safetensors would overwrite the input weights file; choose another file",
            ),
            (
                "weights export w.safetensors --key-map map.toml --out ./map.toml",
                "--out: ./map.toml would overwrite the input key map",
            ),
            (
                "weights import w.safetensors --model nano --out ./w.safetensors --precision bf16",
                "error: --out: ./w.safetensors would overwrite the input weights; choose another file",
            ),
            (
                "weights import w.safetensors --model nano.toml --out nano.toml",
                "nano.toml would overwrite the input configuration",
            ),
            (
                "weights import w.safetensors --model nano --key-map map.toml --out map.toml",
                "--out: map.toml would overwrite the input key map",
            ),
        ],
    );
    succeed(here, &["weights", "export", "w.safetensors", "--key-map", "map.toml", "--out", "other.safetensors"]);
    succeed(here, &["weights", "import", "other.safetensors", "--model", "nano", "--out", "again.safetensors"]);
    // The name of something embedded is not a file.
    succeed(here, &["weights", "export", "micro-rooms", "--key-map", "identity", "--out", "micro-rooms"]);
}

#[test]
fn indices_do_not_overwrite_datasets_or_the_input_index() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/aaaa.txt"), 60);
    fs::write(here.join("index.svg"), r#"{"aaaa": {"context": [10, 40], "target": [20]}}"#).unwrap();
    fs::write(here.join("rule.toml"), "").unwrap();
    let of_dataset = " would be read as part of the dataset data; choose a path outside it";
    let index = "index.svg would overwrite the input index; choose another file";
    rejects(
        here,
        &[
            ("protocol build data --sampler re10k-2v --out data/aaaa.txt", of_dataset),
            ("protocol build data --sampler re10k-2v --out data/transforms.json", of_dataset),
            (
                "protocol build data/aaaa.txt --sampler re10k-2v --out data/aaaa.txt",
                "part of the dataset data/aaaa.txt; ",
            ),
            (
                "protocol build data --sampler rule.toml --out rule.toml",
                "rule.toml would overwrite the input sampling rule",
            ),
            ("protocol overlap index.svg --data data --out index.svg", index),
            ("protocol overlap index.svg --data data --out data/aaaa.txt", of_dataset),
            ("protocol overlap index.svg --data data --plot index.svg", index),
        ],
    );
    succeed(here, &["protocol", "overlap", "index.svg", "--data", "data", "--out", "data/overlap.json"]);
}

/// A folder of RE10K trajectories would have `digests.txt` of the results for another one.
#[test]
fn results_are_not_written_into_the_folder_of_the_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    fs::write(here.join("sweep.toml"), "title = 'settings'\n[[settings]]\nlabel = 'whole'\n").unwrap();
    let run = "run tiny.toml --data data --method nearest-view --out";
    let (itself, by_another_path) = (format!("{run} data"), format!("{run} data/scene-00/.."));
    let error = " is the folder of the dataset; choose another one for the results";
    rejects(
        here,
        &[
            (itself.as_str(), "error: --out: data is the folder of the dataset; "),
            (by_another_path.as_str(), error),
            ("score tiny.toml --data ./data --renders data --out data/", error),
            ("tradeoff sweep tiny.toml --data data --sweep sweep.toml --weights random:1 --out data", error),
            ("reproduce --data data --out ./data", error),
            // One of the datasets that are found in the folder.
            ("reproduce --data . --out data", error),
        ],
    );
    // Below it, above it, and next to it.
    for out in ["data/results", ".", "results"] {
        succeed(here, &format!("{run} {out}").split(' ').collect::<Vec<_>>());
    }
    let inspected = succeed(here, &["data", "inspect", "data"]);
    assert!(!inspected.contains("unreadable-scene"), "{inspected}");
}

#[test]
fn plots_do_not_overwrite_photos() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::create_dir_all(here.join("data/aaaa")).unwrap();
    write_trajectory(&here.join("data/aaaa.txt"), 60);
    fs::write(here.join("index.json"), r#"{"aaaa": {"context": [10, 40], "target": [20]}}"#).unwrap();
    succeed(here, &["render", SCENE, "--orbit", "1", "--size", "43x24", "--out", "made"]);
    for file in ["aaaa/333670.png", "no-photo.png"] {
        fs::copy(here.join("made/000000.png"), here.join("data").join(file)).unwrap();
    }
    let plot = "--plot: data/aaaa/333670.png would overwrite the input photo data/aaaa/333670.png";
    rejects(
        here,
        &[
            ("protocol overlap index.json --data data --plot data/aaaa/333670.png", plot),
            ("data motion data --plot data/aaaa/333670.png", plot),
        ],
    );
    succeed(here, &["protocol", "overlap", "index.json", "--data", "data", "--plot", "data/no-photo.png"]);
    succeed(here, &["data", "motion", "data", "--plot", "data/no-photo.png"]);
}

#[test]
fn a_fit_overwrites_neither_its_start_nor_files_of_another_kind() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "3", "--size", "64x64", "--out", "photos"]);
    fs::copy(SCENE, here.join("start.ply")).unwrap();
    fs::write(here.join("notes"), "what I found").unwrap();
    fs::write(here.join("empty"), "").unwrap();
    let fit = "fit photos --views .. --size 32x32 --strategy fixed --steps 2 --start start.ply";
    let start = "error: --out: start.ply would overwrite the input start; choose another file";
    let other = " is not a checkpoint written by `atsplat fit`; choose another file";
    let of_dataset = "--checkpoint: photos/render.json would be read as part of the dataset photos; ";
    let state = |file: &str| format!("{fit} --out fitted.ply --checkpoint-every 1 --checkpoint {file}");
    rejects(
        here,
        &[
            (&format!("{fit} --out start.ply"), start),
            (&format!("{fit} --opacities-as-stored --out start.ply"), start),
            (&state("start.ply"), "--checkpoint: start.ply would overwrite the input start"),
            (&state("photos/render.json"), of_dataset),
            (&state("photos/000000.png"), "part of the dataset photos"),
            (&state("notes"), &format!("--checkpoint: notes{other}")),
            (&state("empty"), &format!("--checkpoint: empty{other}")),
        ],
    );
    let run = |text: &str| drop(succeed(here, &text.split(' ').collect::<Vec<_>>()));
    run(&state("state"));
    let first = fs::read(here.join("state")).unwrap();
    let of_a_run = "--checkpoint: state is the state of a run; --resume continues it, otherwise choose another file";
    rejects(here, &[(&state("state"), of_a_run), (&state("state").replace("--steps 2", "--steps 3"), of_a_run)]);
    run(&format!("{} --resume", state("state")));
    assert!(fs::read(here.join("state")).unwrap() == first);
    // Safetensors of another kind.
    fs::rename(here.join("state"), here.join("other")).unwrap();
    let bytes = fs::read(here.join("other")).unwrap();
    let place = bytes.windows(11).position(|window| window == b"atsplat.fit").unwrap();
    let mut renamed = bytes;
    renamed[place..place + 11].copy_from_slice(b"another.fit");
    fs::write(here.join("other"), renamed).unwrap();
    rejects(here, &[(&state("other"), other)]);
}

/// A scene, cameras, exposures and constants next to a capture with photos as renders are named.
#[test]
fn renders_overwrite_nothing_that_they_are_made_from() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "2", "--size", "16x16", "--out", "made"]);
    let frame = |photo: &str| {
        format!(r#"{{ "file_path": "{photo}", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]] }}"#)
    };
    let transforms = |photos: [&str; 2]| {
        let frames = photos.map(frame).join(", ");
        format!(r#"{{ "fl_x": 16, "fl_y": 16, "cx": 8, "cy": 8, "w": 16, "h": 16, "frames": [{frames}] }}"#)
    };
    for (capture, images) in [("ds", "ds/images"), ("two/a", "two/a/images"), ("two/b", "two/b/images")] {
        fs::create_dir_all(here.join(images)).unwrap();
        for photo in ["000000.png", "000001.png"] {
            fs::copy(here.join("made").join(photo), here.join(images).join(photo)).unwrap();
        }
        let photos = transforms(["images/000000.png", "images/000001.png"]);
        fs::write(here.join(capture).join("transforms.json"), photos).unwrap();
    }
    fs::create_dir(here.join("taken")).unwrap();
    for scene in ["scene.ply", "scene.png", "taken/000000.png"] {
        fs::copy(SCENE, here.join(scene)).unwrap();
    }
    fs::create_dir(here.join("exposed")).unwrap();
    let exposures = r#"{ "0": [[1,0,0,0],[0,1,0,0],[0,0,1,0]] }"#;
    fs::write(here.join("exposed/render.json"), exposures).unwrap();
    let orbit = "--orbit 1 --size 16x16 --out";
    rejects(
        here,
        &[
            (
                "render scene.ply --cameras ds/transforms.json --out ds/images",
                "error: --out: ds/images/000000.png would overwrite the input photo ds/images/000000.png; choose another",
            ),
            (
                "render scene.ply --cameras ds --out ds/images",
                "000000.png would overwrite the input photo ds/images/000000.png",
            ),
            ("render scene.ply --spline ds 2 --out ds/images", "would overwrite the input photo "),
            (
                "render scene.ply --cameras ds --frames 1 --out ds/../ds/images",
                "000001.png would overwrite the input photo ",
            ),
            (
                "render scene.ply --cameras two --key a --out two/b/images",
                "would overwrite the input photo two/b/images/000000.png",
            ),
            (
                &format!("render scene.png {orbit} out --preview scene.png"),
                "--preview: scene.png would overwrite the input scene",
            ),
            (
                &format!("render taken/000000.png {orbit} taken"),
                "taken/000000.png would overwrite the input scene taken/000000.png",
            ),
            (
                &format!("render scene.ply {orbit} exposed --exposure exposed/render.json"),
                "exposed/render.json would overwrite the input exposures exposed/render.json",
            ),
            (
                "render scene.ply --cameras made/render.json --out made",
                "made/render.json would overwrite the input cameras made/render.json",
            ),
        ],
    );
    // What is not read is replaced, as by the same command again.
    for _ in 0..2 {
        succeed(here, &["render", "scene.ply", "--cameras", "ds", "--out", "ds/renders", "--preview", "ds/path.png"]);
        succeed(here, &["render", "scene.ply", "--cameras", "made/render.json", "--out", "again"]);
        succeed(
            here,
            &["render", "taken/000000.png", "--orbit", "1", "--size", "16x16", "--formats", "exr", "--out", "taken"],
        );
    }
}

#[test]
fn reconstructions_and_fits_overwrite_neither_photos_nor_weights() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "3", "--size", "32x32", "--out", "made"]);
    fs::create_dir_all(here.join("ds/inputs")).unwrap();
    let mut frames = Vec::new();
    for (at, photo) in
        ["inputs/000000.png", "inputs/000001.png", "uncertainty.png", "contact-sheet.png"].iter().enumerate()
    {
        fs::copy(here.join("made/000000.png"), here.join("ds").join(photo)).unwrap();
        frames.push(format!(
            r#"{{ "file_path": "{photo}", "transform_matrix": [[1,0,0,{at}],[0,1,0,0],[0,0,1,4],[0,0,0,1]] }}"#
        ));
    }
    let frames = frames.join(", ");
    let text = format!(r#"{{ "fl_x": 32, "fl_y": 32, "cx": 16, "cy": 16, "w": 32, "h": 32, "frames": [{frames}] }}"#);
    fs::write(here.join("ds/transforms.json"), text).unwrap();
    fs::copy(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../eval/checkpoints/micro-rooms.safetensors"),
        here.join("w.ply"),
    )
    .unwrap();
    let reconstruct = "reconstruct ds --views 0,1 --size 32x32 --weights";
    rejects(
        here,
        &[
            (
                &format!("{reconstruct} random:1 --out a.ply --renders ds"),
                "--renders: ds/inputs/000000.png would overwrite the input photo ds/inputs/000000.png",
            ),
            (
                &format!("{reconstruct} random:1 --out a.ply --plots ds"),
                "--plots: ds/uncertainty.png would overwrite the input photo ds/uncertainty.png",
            ),
            (&format!("{reconstruct} w.ply --out w.ply"), "--out: w.ply would overwrite the input weights file"),
            (
                "fit ds --views .. --strategy fixed --steps 1 --start random:9 --size 32x32 --out a.ply --plots ds",
                "--plots: ds/contact-sheet.png would overwrite the input photo ds/contact-sheet.png",
            ),
        ],
    );
}

/// The key of a capture is its folder's name.
#[cfg(feature = "opencv")]
#[test]
fn undistorted_scenes_do_not_replace_their_captures() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "1", "--size", "16x16", "--out", "made"]);
    fs::create_dir_all(here.join("data/scene/images")).unwrap();
    fs::copy(here.join("made/000000.png"), here.join("data/scene/images/0.png")).unwrap();
    let frame = r#"{ "file_path": "images/0.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]] }"#;
    let text = format!(r#"{{ "fl_x": 16, "cx": 8, "cy": 8, "w": 16, "h": 16, "k1": 0.01, "frames": [{frame}] }}"#);
    fs::write(here.join("data/scene/transforms.json"), text).unwrap();
    let cameras = "--out: data/scene/transforms.json would be read as part of the dataset data";
    rejects(
        here,
        &[
            ("data undistort data/scene --out data", &format!("{cameras}/scene; choose a path outside it")),
            ("data undistort data/scene/transforms.json --out data", cameras),
            ("data undistort data -o data", &format!("{cameras}; choose a path outside it")),
        ],
    );
    succeed(here, &["data", "undistort", "data/scene", "--out", "straight"]);
    assert!(here.join("straight/scene/images/0.png").is_file());
    // A model below its capture, and photos elsewhere.
    fs::create_dir_all(here.join("desk/sparse/0")).unwrap();
    fs::rename(here.join("data/scene/images"), here.join("desk/images")).unwrap();
    fs::write(here.join("desk/sparse/0/cameras.txt"), "1 PINHOLE 16 16 16 16 8 8\n").unwrap();
    fs::write(here.join("desk/sparse/0/images.txt"), "1 1 0 0 0 0 0 0 1 0.png\n\n").unwrap();
    rejects(
        here,
        &[(
            "data undistort desk/sparse/0 --out .",
            "--out: ./desk contains the file desk/sparse/0/cameras.txt of its scene; choose another folder",
        )],
    );
    fs::create_dir(here.join("frames")).unwrap();
    fs::rename(here.join("desk/images"), here.join("frames/clip")).unwrap();
    write_trajectory(&here.join("clip.txt"), 1);
    let expected = "--out: frames/clip contains the photo frames/clip/0.png of its scene";
    atsplat(here, &["data", "undistort", "clip.txt", "--frames", "frames", "--out", "frames"]).says(1, expected);
    assert!(!here.join("frames/clip/transforms.json").exists());
}
