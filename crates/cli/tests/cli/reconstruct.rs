//! `atsplat reconstruct` as a user runs it: its files equal the results of the library.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use atsplat_camera::{Camera, MeanCameraScale, PoseNormalisation, WorldFromCamera, normalise};
use atsplat_model::network::{Device, Network, Reconstruction, Views};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, Precision, generated};
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_numeric::Tolerance;
use atsplat_pixels::{DecodeLimits, ImageU8, decode, encode_png};
use atsplat_scene::{SceneSource as _, Warnings};
use atsplat_splat::{Gaussians, files};
use atsplat_tests::{graphics_required, shared_data};
use serde_json::{Value, json};

use crate::common::{SCENE, atsplat, json_of, printed_json, read_json, succeed};

const SEED: u64 = 3;

/// The network of the model's fixtures: 32×48 pixels, a tenth of a second.
fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../model/oracle/tiny.toml").canonicalize().unwrap()
}

/// Five photos of 48×32 pixels along an arc, in nerfstudio's layout, one of them listed but missing.
fn capture() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("images")).unwrap();
    let mut frames = Vec::new();
    for at in 0..6u8 {
        let name = format!("images/{at:03}.png");
        if at != 4 {
            let sample = |(x, y, c): (usize, usize, usize)| {
                u8::try_from((x * 5 + y * (3 + c) * 2 + usize::from(at) * 9 + (x / 8 + y / 8) % 2 * 70) % 256).unwrap()
            };
            let places = (0..32).flat_map(|y| (0..48).flat_map(move |x| (0..3).map(move |c| (x, y, c))));
            let image = ImageU8::new(48, 32, places.map(sample).collect()).unwrap();
            fs::write(folder.path().join(&name), encode_png(&image).unwrap()).unwrap();
        }
        let (sin, cos) = (0.1 * f64::from(at)).sin_cos();
        let pose = [
            [cos, 0.0, sin, 7.0 + 12.0 * sin],
            [0.0, 1.0, 0.0, 1.5],
            [-sin, 0.0, cos, 12.0 * cos],
            [0.0, 0.0, 0.0, 1.0],
        ];
        frames.push(json!({ "file_path": name, "transform_matrix": pose }));
    }
    let capture = json!({ "w": 48, "h": 32, "fl_x": 44.0, "fl_y": 44.0, "cx": 24.0, "cy": 16.0, "frames": frames });
    fs::write(folder.path().join("transforms.json"), capture.to_string()).unwrap();
    folder
}

fn reconstruct<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&["reconstruct", ".", "--views", "0,2,5", "--out", "scene.ply"], more].concat()
}

fn untrained<'a>(tiny: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    reconstruct(&[&["--weights", "random:3", "--model", tiny], more].concat())
}

fn gaussians(path: &Path) -> Gaussians {
    files::read(path).unwrap().0
}

fn record(folder: &Path) -> Value {
    read_json(&folder.join("scene.ply.json"))
}

/// The same reconstruction through the libraries.
fn by_hand(folder: &Path, frames: &[usize]) -> Reconstruction {
    let mut warnings = Warnings::new();
    let dataset = atsplat_scene::open(folder, &mut warnings).unwrap();
    let scene = dataset.load(&dataset.keys()[0], &mut warnings).unwrap();
    let cameras: Vec<Camera> = frames.iter().map(|&frame| scene.frames[frame].camera).collect();
    let poses: Vec<WorldFromCamera> = cameras.iter().map(|camera| camera.camera_from_world.inverse()).collect();
    let rule = PoseNormalisation::mean_camera(MeanCameraScale::LongLrm);
    let normalised = normalise(&poses, &[], &rule).unwrap();
    let cameras = cameras.iter().zip(&normalised.context);
    let cameras = cameras.map(|(camera, pose)| Camera { camera_from_world: pose.inverse(), ..*camera }).collect();
    let image = |&frame: &usize| scene.decode(frame, &DecodeLimits::default()).unwrap().into_samples();
    let images = frames.iter().flat_map(image).map(|sample| f32::from(sample) / 255.0).collect();
    let views = Views::new(ImageSize::new(32, 48), images, cameras).unwrap();
    let config = ModelConfig::read(&tiny()).unwrap();
    let weights = generated(&parameters(&config), SEED);
    Network::new(&config, &Device::flex()).unwrap().with_weights(&weights).unwrap().reconstruct(&views, 0).unwrap()
}

#[test]
fn the_file_holds_the_librarys_gaussians() {
    let folder = capture();
    let here = folder.path();
    let tiny = tiny();
    let text = succeed(here, &untrained(tiny.to_str().unwrap(), &["--frame", "trial", "--explain"]));
    let made = by_hand(here, &[0, 2, 5]);
    assert_eq!(gaussians(&here.join("scene.ply")), made.gaussians);
    let record = record(here);
    assert_eq!(record["tokens"]["gaussians"], made.budget.gaussians);
    let left: Vec<u64> =
        record["tokens"]["blocks"].as_array().unwrap().iter().map(|b| b["left"].as_u64().unwrap()).collect();
    assert_eq!(left, made.budget.tokens.iter().map(|&count| count as u64).collect::<Vec<_>>());
    assert_eq!((&record["weights"]["kind"], &record["weights"]["seed"]), (&json!("untrained"), &json!(SEED)));
    assert_eq!(record["input"]["views"][1], json!({ "frame": 2, "name": "002" }));
    assert!(text.starts_with("UNTRAINED") && text.contains("block  tokens in") && text.contains("decoder"), "{text}");
    assert!(text.contains("memory of the network, by formula"), "{text}");
}

/// A GPU makes nearly the same Gaussians. Without a GPU, or in a build without GPU networks, an error is reported before
/// anything is written.
#[test]
fn uses_a_gpu_or_reports_that_there_is_none() {
    let folder = capture();
    let here = folder.path();
    let tiny = tiny();
    let args = untrained(tiny.to_str().unwrap(), &["--frame", "trial", "--device", "wgpu", "--renders", "renders"]);
    let outcome = atsplat(here, &args);
    if outcome.code == 0 {
        let record = record(here);
        assert!(cfg!(feature = "gpu-network") && record["device"] == "wgpu");
        let renderer = record["renders"]["backend"].as_str().unwrap();
        assert!(!renderer.starts_with("cpu"), "{renderer}");
        let (ours, theirs) = (gaussians(&here.join("scene.ply")), by_hand(here, &[0, 2, 5]).gaussians);
        let wide =
            |scene: &Gaussians| scene.parts().means.as_flattened().iter().map(|x| f64::from(*x)).collect::<Vec<_>>();
        Tolerance { absolute: 1e-3, relative: 1e-3 }.assert(wide(&ours), wide(&theirs), "centres");
        return;
    }
    let message = if cfg!(feature = "gpu-network") { "adapter" } else { "--features gpu-network" };
    outcome.says(1, message);
    assert!(!here.join("scene.ply").exists());
    let required = cfg!(feature = "gpu-network") && graphics_required();
    assert!(!required, "{}", outcome.stderr);
    atsplat(here, &["budget", "--model", "nano", "--run", "--device", "wgpu"]).says(1, message);
    assert_ne!(atsplat(here, &["budget", "--device", "wgpu"]).code, 0, "nothing runs without --run");
}

/// The dataset's cameras see the same Gaussians as the normalised cameras.
#[test]
fn the_datasets_cameras_see_the_same_in_the_scene_frame() {
    let folder = capture();
    let here = folder.path();
    let tiny = tiny();
    let args = untrained(tiny.to_str().unwrap(), &["--renders", "renders", "--targets", "1,3"]);
    succeed(here, &args);
    let record = record(here);
    let names: Vec<&str> =
        record["renders"]["files"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    let expected = [
        "inputs/000000",
        "inputs/000002",
        "inputs/000005",
        "context/000000",
        "context/000002",
        "context/000005",
        "targets/000001",
        "targets/000003",
    ];
    assert_eq!(names, expected.map(|name| format!("{name}.png")));
    let image = |path: &str| decode(&fs::read(here.join(path)).unwrap(), &DecodeLimits::default()).unwrap();
    assert_eq!(image("renders/inputs/000002.png"), image("images/002.png"), "nothing was resampled");

    let scale = record["input"]["normalisation"]["scale"].as_f64().unwrap();
    assert!((0.1..0.9).contains(&scale), "the scene is scaled: {scale}");
    let (near, far) = (format!("{}", 0.01 / scale), format!("{}", 500.0 / scale));
    let render =
        ["render", "scene.ply", "--cameras", ".", "--frames", "0,1,2,3,5", "--out", "again", "--effects", "all"];
    succeed(here, &[&render[..], &["--near", &near, "--far", &far]].concat());
    for name in &names[3..] {
        let (ours, again) =
            (image(&format!("renders/{name}")), image(&format!("again/{}", name.split_once('/').unwrap().1)));
        let worst = ours.samples().iter().zip(again.samples()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        let brightest = ours.samples().iter().max().unwrap();
        assert!(worst <= 2, "{name}: {worst}");
        assert!(*brightest > 20, "{name} shows nothing: {brightest}");
    }
}

#[test]
fn the_same_arguments_give_identical_bytes() {
    let folder = capture();
    let here = folder.path();
    let tiny = tiny();
    let mut outcomes = Vec::new();
    for threads in ["1", "3"] {
        succeed(here, &untrained(tiny.to_str().unwrap(), &["--threads", threads, "--renders", "renders"]));
        let files = ["scene.ply", "scene.ply.json", "renders/context/000005.png"];
        outcomes.push(files.map(|name| fs::read(here.join(name)).unwrap()));
    }
    assert!(outcomes[0] == outcomes[1]);
    let other = ["--weights", "random:4", "--model", tiny.to_str().unwrap(), "--out", "other.ply"];
    succeed(here, &[&["reconstruct", ".", "--views", "0,2,5"], &other[..]].concat());
    assert_ne!(fs::read(here.join("other.ply")).unwrap(), outcomes[0][0], "the seed decides the weights");
}

/// Two photos that have changed places: the same frames and cameras, other data.
#[test]
fn the_record_tells_other_photos_apart() {
    let (folder, tiny) = (capture(), tiny());
    let here = folder.path();
    let input = || {
        succeed(here, &untrained(tiny.to_str().unwrap(), &[]));
        record(here)["input"].clone()
    };
    let before = input();
    let [first, second] = ["images/000.png", "images/002.png"].map(|file| fs::read(here.join(file)).unwrap());
    fs::write(here.join("images/000.png"), second).unwrap();
    fs::write(here.join("images/002.png"), first).unwrap();
    let after = input();
    assert_eq!(before["trial"], after["trial"]);
    assert_ne!(before["data-sha256"], after["data-sha256"]);
}

#[test]
fn writes_spz_by_extension_and_keeps_the_order_of_views() {
    let folder = capture();
    let here = folder.path();
    let tiny = tiny();
    let args = ["reconstruct", ".", "--weights", "random:3", "--model", tiny.to_str().unwrap(), "--json"];
    let report = printed_json(here, &[&args[..], &["--views", "5,0..3:2", "--out", "a.spz"]].concat());
    assert_eq!(report["output"]["format"], json!({ "spz3": { "antialiased": false } }));
    let frames: Vec<&Value> = report["input"]["views"].as_array().unwrap().iter().map(|view| &view["frame"]).collect();
    assert_eq!(frames, [&json!(5), &json!(0), &json!(2)]);
    assert!(report["seconds"]["decoder"].is_number() && report["memory"]["weight-bytes"].is_number());
    let message = report["output"]["gaussians"].as_u64().unwrap();
    assert_eq!(gaussians(&here.join("a.spz")).len() as u64, message);
}

/// Three views of 32×48 have 6 patches each; at the training resolution, 24.
#[test]
fn photos_are_scaled_to_the_training_resolution() {
    let folder = capture();
    let here = folder.path();
    let config = ModelConfig { resolution: ImageSize::new(64, 64), ..ModelConfig::read(&tiny()).unwrap() };
    let tensors = generated(&parameters(&config), SEED);
    let weights_file = here.join("weights.safetensors");
    ModelWeights::new(config, BTreeMap::new(), &tensors).unwrap().write(&weights_file, Precision::Single).unwrap();
    let file = ["--weights", "weights.safetensors", "--size", "48x32"];
    for (more, seen, tokens) in
        [(&[][..], json!([64, 96]), 3 * 24), (&["--context-size", "given"], json!([32, 48]), 3 * 6)]
    {
        let text = succeed(here, &reconstruct(&[&file[..], more].concat()));
        assert_eq!(record(here)["input-size"], seen, "{more:?}");
        assert_eq!(record(here)["tokens"]["initial"], tokens, "{more:?}");
        assert_eq!(text.contains("32x48 seen at 64x96"), more.is_empty(), "{text}");
    }
    let config = ModelConfig { resolution: ImageSize::new(8208, 16), ..ModelConfig::read(&tiny()).unwrap() };
    ModelWeights::new(config, BTreeMap::new(), &tensors).unwrap().write(&weights_file, Precision::Single).unwrap();
    atsplat(here, &reconstruct(&file)).says(1, "setting for large images: ");
}

/// Weights from a file make the same Gaussians, also under other configurations.
#[test]
fn reconstructs_with_weights_from_a_file() {
    let folder = capture();
    let here = folder.path();
    let config = ModelConfig::read(&tiny()).unwrap();
    let tensors = generated(&parameters(&config), SEED);
    let weights =
        ModelWeights::new(config, BTreeMap::from([("data".to_owned(), "none".to_owned())]), &tensors).unwrap();
    weights.write(&here.join("weights.safetensors"), Precision::Single).unwrap();
    let file = ["--weights", "weights.safetensors"];
    let text = succeed(here, &reconstruct(&[&file[..], &["--frame", "trial"]].concat()));
    assert!(!text.contains("UNTRAINED"), "{text}");
    assert_eq!(gaussians(&here.join("scene.ply")), by_hand(here, &[0, 2, 5]).gaussians);
    assert_eq!(record(here)["weights"]["provenance"], json!({ "data": "none" }));
    assert_eq!(record(here)["model"]["written-for"], Value::Null);

    for (more, count) in [
        (&["--expand-first", "0"][..], 18),
        (&["--thresholds", "0,0,0"], 144),
        (&["--thresholds", "100,100,100"], 18),
        (&["--ratios", "1,0,0"], 36),
    ] {
        succeed(here, &reconstruct(&[&file[..], more].concat()));
        assert_eq!(record(here)["tokens"]["final"], count, "{more:?}");
        assert_eq!(record(here)["model"]["written-for"]["name"], "tiny");
    }
    atsplat(here, &reconstruct(&[&file[..], &["--model", "nano", "--size", "48x32"]].concat()))
        .says(1, "coarse.layers: 4 and 2");
    let hash = "0".repeat(64);
    atsplat(here, &reconstruct(&[&file[..], &["--sha256", &hash]].concat())).says(1, &format!("sha256 {hash}, found "));

    let mut bytes = fs::read(here.join("weights.safetensors")).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::write(here.join("weights.safetensors"), &bytes).unwrap();
    fs::remove_file(here.join("scene.ply")).unwrap();
    atsplat(here, &reconstruct(&file)).says(1, "as written");
    fs::write(here.join("weights.safetensors"), &bytes[..last]).unwrap();
    atsplat(here, &reconstruct(&file)).says(1, "weights.safetensors");
    assert!(!here.join("scene.ply").exists());
}

#[test]
fn missing_weights_are_reported_with_advice() {
    let folder = capture();
    let here = folder.path();
    let hash = "ab".repeat(32);
    let args = ["--weights", "gone.safetensors", "--model", "paper-dl3dv", "--sha256", &hash];
    let outcome = atsplat(here, &reconstruct(&args));
    assert_eq!(outcome.code, 1);
    for message in [
        "paper-dl3dv",
        &hash,
        "dinov2_vitb14_pretrain.pth",
        "https://",
        "weights import",
        "random:SEED",
        "gone.safetensors",
    ] {
        assert!(outcome.stderr.contains(message), "{message}: {}", outcome.stderr);
    }
    let typo = atsplat(here, &reconstruct(&["--weights", "micro-room"])).stderr;
    let expected = "expected micro-rooms or micro-yards, embedded in the binary, or a weights file of this toolkit";
    assert!(typo.contains(expected) && typo.contains("(micro-room)") && !typo.contains("paper-re10k"), "{typo}");
    fs::write(here.join("text.safetensors"), "not weights").unwrap();
    atsplat(here, &reconstruct(&["--weights", "text.safetensors"])).says(1, "torch.save");
    assert!(!here.join("scene.ply").exists() && !here.join("scene.ply.json").exists());
}

/// Photos of the size that a protocol crops to count as cropped, but only on request.
#[test]
fn photos_that_were_cropped_before_are_taken_on_request() {
    let folder = capture();
    let here = folder.path();
    let presets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/presets");
    let preset = fs::read_to_string(presets.join("re10k-2v-256.toml")).unwrap();
    let preset = preset.replace("name = \"re10k-2v-256\"", "name = \"mine\"");
    fs::write(here.join("mine.toml"), preset.replace("height = 256, width = 256", "height = 32, width = 48")).unwrap();
    let tiny = tiny();
    let args = untrained(tiny.to_str().unwrap(), &["--protocol", "mine.toml"]);
    atsplat(here, &args).says(1, "640×360");
    succeed(here, &[&args[..], &["--any-size"]].concat());
    assert_eq!(record(here)["input"]["protocol"], "mine.toml, images of any size");
}

#[test]
fn rejects_input_that_cannot_be_reconstructed() {
    let folder = capture();
    let here = folder.path();
    let tiny = tiny();
    let start = ["reconstruct", ".", "--weights", "random:1", "--model", tiny.to_str().unwrap(), "--out", "scene.ply"];
    for (more, message) in [
        (&["--views", "0,4"][..], "004.png"),
        (&["--views", "0,4"], "error: scene \""),
        (&["--views", "0,9"], "positions below 6"),
        (&["--views", "0,2,0"], "selected twice"),
        (&["--views", "0,2", "--size", "40x32"], "divisible by"),
        (&["--views", "0,2", "--size", "96x64"], "48×32"),
        (&["--views", "0,2", "--size", "96x64"], "photos scaled to 96×64 (--size, or the model's resolution): "),
        (&["--views", "0,2", "--protocol", "re10k-2v-256"], "640×360"),
        (&["--views", "0,2", "--thresholds", "0.1"], "3 thresholds"),
        (&["--views", "0,2", "--key", "other"], "other"),
        (&["--views", "0,2", "--backbone", "gone.pth"], "no DINOv2 backbone"),
    ] {
        atsplat(here, &[&start[..], more].concat()).says(1, message);
        assert!(!here.join("scene.ply").exists(), "{more:?}");
    }
}

#[test]
fn usage_errors_are_reported_before_anything_is_written() {
    let folder = capture();
    let here = folder.path();
    let start = ["reconstruct", ".", "--out", "out/scene.ply"];
    let views = ["--views", "0,2"];
    let weights = ["--weights", "random:1"];
    for more in [
        &views[..],
        &weights[..],
        &[views, ["--weights", "random"]].concat(),
        &[views, ["--weights", "random:x"]].concat(),
        &[views, weights, ["--model", "paper"]].concat(),
        &[views, weights, ["--targets", "1"]].concat(),
        &[views, weights, ["--out", "scene.obj"]].concat(),
        &[views, weights, ["--size", "48"]].concat(),
        &[views, weights, ["--ratios", "2,0,0"]].concat(),
        &[views, weights, ["--thresholds", "-1"]].concat(),
        &[views, weights, ["--thresholds", "1"], ["--ratios", "1"]].concat(),
        &[views, weights, ["--protocol", "nothing"]].concat(),
        &[views, weights, ["--sha256", "12"]].concat(),
        &[views, weights, ["--frame", "camera"]].concat(),
        &[views, weights, ["--constants", "inria"]].concat(),
        &[views, weights, ["--background", "white"]].concat(),
        &[views, ["--weights", "a.safetensors"], ["--backbone", "b"]].concat(),
        &[weights, ["--views", "5..2"]].concat(),
    ] {
        let outcome = atsplat(here, &[&start[..], more].concat());
        assert_eq!(outcome.code, 2, "{more:?}: {}", outcome.stderr);
        assert!(!here.join("out").exists(), "{more:?}");
    }
    atsplat(here, &[&start[..], &views, &weights, &["--strict"]].concat()).says(2, "unexpected argument '--strict'");
}

/// Without targets only tokens are plotted; with targets, renders and uncertainty too. Untrained weights are labelled.
#[test]
fn plots_token_expansion() {
    let folder = capture();
    let here = folder.path();
    let tiny = tiny();
    let tiny = tiny.to_str().unwrap();
    let names = |folder: &str| {
        let entries = fs::read_dir(here.join(folder)).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    succeed(here, &untrained(tiny, &["--plots", "alone"]));
    assert_eq!(names("alone"), ["token-expansion-1.png", "token-expansion-1.svg"]);
    atsplat(here, &untrained(tiny, &["--plots", "plots", "--targets", "1,3"])).prints(0, "6 plots into plots");
    let stems = ["expansion-strips", "token-expansion-1", "uncertainty"];
    assert_eq!(names("plots"), stems.map(|stem| [format!("{stem}.png"), format!("{stem}.svg")]).concat());
    assert_eq!(record(here)["plots"]["files"].as_array().unwrap().len(), 6);
    for stem in stems {
        let svg = fs::read_to_string(here.join(format!("plots/{stem}.svg"))).unwrap();
        assert!(svg.contains("UNTRAINED") && svg.contains("data:image/png"), "{stem}");
    }
    let strips = fs::read_to_string(here.join("plots/expansion-strips.svg")).unwrap();
    assert!(["no expansion", "block 2", "blocks 2–3", "blocks 2–4", "truth"].iter().all(|name| strips.contains(name)));
    assert_eq!(strips.matches(" dB · ").count(), 8, "{strips}");
}

/// Output of `render` is a capture with known cameras.
#[test]
fn reconstructs_from_renders() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "8", "--size", "96x96", "--out", "frames"]);
    let tiny = tiny();
    let network = ["--weights", "random:1", "--model", tiny.to_str().unwrap()];
    for (data, out) in [("frames", "a.ply"), ("frames/render.json", "b.ply")] {
        succeed(here, &[&["reconstruct", data, "--views", "..", "--out", out], &network[..]].concat());
    }
    assert_eq!(fs::read(here.join("a.ply")).unwrap(), fs::read(here.join("b.ply")).unwrap());
    fs::remove_file(here.join("frames/000003.png")).unwrap();
    for (views, code) in [("..", 0), ("3,4", 1)] {
        let args = ["reconstruct", "frames", "--views", views, "--out", "c.ply"];
        atsplat(here, &[&args, &network[..]].concat()).says(code, "frames/000003.png");
    }
}

/// A real scene of RE10K through `nano`, and a capture with lens distortion through a crop.
#[test]
fn reconstructs_real_photos() {
    let Some(shared) = shared_data("real_photos") else { return };
    let shared = shared.canonicalize().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // The folder's square images were cropped but its trajectory was not; the chunk's cameras were cropped as well.
    let crops = shared.join("re10k/000c3ab189999a83");
    let args = ["reconstruct", crops.to_str().unwrap(), "--views", "9,126", "--weights", "random:1", "--out", "no.ply"];
    let outcome = atsplat(here, &args);
    let message = outcome.stderr.contains("frame 9") && outcome.stderr.contains("found 256×256");
    assert!(outcome.code == 1 && message && outcome.stderr.contains("455×256"), "{}", outcome.stderr);
    for (data, views, targets) in [("re10k/chunk", "9,126", "29,30,46"), ("fox", "0,1", "2")] {
        let data = shared.join(data);
        let args =
            ["reconstruct", data.to_str().unwrap(), "--views", views, "--targets", targets, "--weights", "random:1"];
        let more = ["--out", "scene.ply", "--renders", "renders", "--json"];
        let outcome = atsplat(here, &[&args[..], &more].concat());
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        let report = json_of(&outcome.stdout);
        assert_eq!((&report["tokens"]["final"], &report["tokens"]["gaussians"]), (&json!(1440), &json!(23_040)));
        assert_eq!(outcome.stderr.contains("lens distortion"), data.ends_with("fox"), "{}", outcome.stderr);
        let scene = gaussians(&here.join("scene.ply"));
        assert_eq!(scene.len(), 23_040);
        // The mean camera is close to the cameras, so the network's near plane removes nothing.
        let scale = report["input"]["normalisation"]["scale"].as_f64().unwrap();
        let origin: Vec<f64> = serde_json::from_value(report["input"]["normalisation"]["origin"].clone()).unwrap();
        let mean = scene.parts().means.iter().map(|mean| f64::from(mean[0])).sum::<f64>() / 23_040.0;
        assert!(scale > 0.0 && (mean - origin[0]).abs() * scale < 500.0, "{mean} {origin:?} {scale}");
    }
}
