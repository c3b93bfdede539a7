//! `atsplat run`, `score` and `merge` as a user runs them.

use crate::common;
use std::path::Path;

use crate::common::{atsplat, printed_json, succeed, write_trajectory};
use crate::evaluation::{bare, write_index, write_preset};
use atsplat_camera::ImageSize;
use atsplat_numeric::{SplitMix64, Tolerance};
use atsplat_pixels::{DecodeLimits, Image, ImageU8, decode, encode_png, exr};
use atsplat_results::store::images::image_path;
use atsplat_results::{Results, TargetStatus, TrialKey};
use atsplat_rooms::{
    EffectChoice, ImageEncoding, Layout, Request, SceneKind, SceneSeed, Split, WriteOptions, write_dataset,
};
use atsplat_scene::Warnings;
use atsplat_tests::shared_data;

const FLOORS: [&str; 2] = ["--method", "nearest-view,warp"];

/// Simulated yards under a protocol of small images, in `data/test`, next to their index.
fn simulated(here: &Path, scenes: u32) {
    simulated_at(here, scenes, SceneKind::Yards, 40);
}

fn simulated_at(here: &Path, scenes: u32, kind: SceneKind, side: u32) {
    let request = |number| Request {
        size: ImageSize { width: side, height: side },
        frames: 5,
        samples: 1,
        effects: EffectChoice::None,
        ..Request::new(kind, SceneSeed { split: Split::Test, number })
    };
    let options = WriteOptions { layout: Layout::Re10k, encoding: ImageEncoding::Png, depth: false };
    let requests: Vec<Request> = (0..scenes).map(request).collect();
    let written = write_dataset(&here.join("data"), requests, &options, &mut Warnings::default(), |_, _| {}).unwrap();
    write_preset(here, side);
    let keys: Vec<&str> = written.iter().map(|scene| scene.key.as_str()).collect();
    write_index(&here.join("data/test"), &keys, "[0, 4]", "[1, 2, 4]");
}

fn key(results: &Results, method: &str, scene: usize) -> TrialKey {
    let trials: Vec<_> = results.trials.iter().filter(|trial| trial.key.method == method).collect();
    trials[scene].key.clone()
}

#[test]
fn baselines_run_on_simulated_data_and_ground_truth_is_identical() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated(here, 2);
    let args = ["run", "tiny.toml", "--data", "data/test", "--out", "floors", "--keep-images", "all"];
    atsplat(here, &[&args[..], &FLOORS].concat()).prints(0, "4 results computed");
    let floors = Results::read(&here.join("floors")).unwrap();
    assert_eq!((floors.trials.len(), floors.targets.len()), (4, 12));
    assert!(floors.targets.iter().all(|row| row.scores.contains_key("ssim")));
    let leaked = floors.targets.iter().filter(|row| row.leaked && row.key.method == "nearest-view");
    assert_eq!(leaked.map(|row| row.status).collect::<Vec<_>>(), [TargetStatus::Identical; 2]);

    // The ground-truth images, as written by any other method.
    let truth = "floors/images/tiny/truth";
    atsplat(here, &["score", "tiny.toml", "--data", "data/test", "--renders", truth, "--out", "oracle"])
        .says(1, "--name that of score");
    let score =
        ["score", "tiny.toml", "--data", "data/test", "--renders", truth, "--name", "oracle", "--out", "oracle"];
    atsplat(here, &[&score[..], &["--strict"]].concat()).prints(0, "6 identical");
    let oracle = Results::read(&here.join("oracle")).unwrap();
    for row in &oracle.targets {
        assert_eq!(row.status, TargetStatus::Identical, "{row:?}");
        Tolerance::F64.assert([row.scores["ssim"]], [1.0], "SSIM of identical images");
    }
    atsplat(here, &score).prints(0, "0 results computed; 2 were there before");
    let json = printed_json(here, &[&score[..], &["--json"]].concat());
    // As in tables, what is identical is in no mean.
    let row = &json["rows"][0];
    assert_eq!((&row["identical"], &row["means"]), (&6.into(), &serde_json::json!({})));
    let both = printed_json(here, &[&args[..], &FLOORS, &["--json"]].concat());
    let row = both["rows"].as_array().unwrap().iter().find(|row| row["method"] == "nearest-view").unwrap();
    let scored = floors.targets.iter().filter(|row| row.key.method == "nearest-view");
    let mut scenes: std::collections::BTreeMap<&str, Vec<f64>> = std::collections::BTreeMap::new();
    for target in scored.filter(|row| row.status == TargetStatus::Scored) {
        scenes.entry(&target.key.scene).or_default().push(target.scores["psnr"]);
    }
    let means = scenes.values().map(|scores| scores.iter().sum::<f64>() / scores.len() as f64);
    let mean = means.sum::<f64>() / scenes.len() as f64;
    assert_eq!((row["identical"].as_u64(), scenes.len()), (Some(2), 2));
    Tolerance::relative(1e-12).assert([row["means"]["psnr"].as_f64().unwrap()], [mean], "without identical renders");
}

#[test]
fn expansion_is_measured_over_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated_at(here, 6, SceneKind::Rooms, 64);
    let args = ["expansion", "tiny.toml", "--data", "data/test"];
    let report = printed_json(here, &[&args[..], &["--json"]].concat());
    assert_eq!((&report["network"], &report["scenes"]), (&"micro-rooms".into(), &6.into()));
    let blocks = report["blocks"].as_array().unwrap();
    // The network sees two views of 128x128, as it was trained; half of the tokens, half, and a quarter of them become two.
    let counts = |field: &str| blocks.iter().map(|row| row[field].as_f64().unwrap()).collect::<Vec<_>>();
    Tolerance::F64.assert(counts("tokens"), [512.0, 768.0, 1152.0], "tokens");
    Tolerance::F64.assert(counts("expanded"), [256.0, 384.0, 288.0], "expanded");
    for row in blocks {
        let low = |field: &str| row[field]["interval"][0].as_f64().unwrap();
        assert!(low("correlation") > 0.0 && low("contrast") > 1.0, "errors are where they are predicted: {row}");
    }
    assert_eq!(report["thresholds"].as_array().unwrap().len(), 3);

    let first = succeed(here, &[&args[..], &["--limit", "1", "--expand-first", "1"]].concat());
    assert!(first.contains("over 1 trial of 1 scene;") && first.contains("| 2 | 512 | 256 |"), "{first}");
    assert!(!first.contains("| 3 |"), "{first}");
    std::fs::remove_dir_all(here.join("data/test/rooms-test-00000002")).unwrap();
    let strict = atsplat(here, &[&args[..], &["--strict"]].concat());
    assert_eq!(strict.code, 4, "{}", strict.stderr);
    assert!(
        strict.stdout.contains("5 trials of 5 scenes") && strict.stderr.contains("rooms-test-00000002"),
        "{}",
        strict.stderr
    );

    let one = [&args[..], &["--limit", "1", "--strict"]].concat();
    std::fs::copy(here.join("tiny.toml"), here.join("copy.toml")).unwrap();
    let several = printed_json(here, &[&one[..], &["copy.toml", "--json"]].concat());
    assert_eq!(several.as_array().unwrap().len(), 2, "{several}");
    std::fs::remove_file(here.join("data/test/rooms-test-00000004.txt")).unwrap();
    atsplat(here, &one).says(4, "1 × scenes of the index that are not in the data\n    rooms-test-00000004\n");
}

/// Noise of σ 0.05 far from black and white: 20 · log10(1 / 0.05) dB.
#[test]
fn noise_of_known_deviation_has_the_analytic_psnr() {
    const DEVIATION: f64 = 0.05;
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir_all(here.join("data/grey")).unwrap();
    write_trajectory(&here.join("data/grey.txt"), 5);
    // Square images with square pixels.
    let trajectory = std::fs::read_to_string(here.join("data/grey.txt")).unwrap();
    std::fs::write(here.join("data/grey.txt"), trajectory.replace(" 0.48 0.86 ", " 0.86 0.86 ")).unwrap();
    write_preset(here, 256);
    write_index(&here.join("data"), &["grey"], "[0, 4]", "[1, 2, 3]");
    let mut random = SplitMix64::new(1);
    std::fs::create_dir_all(here.join("renders/grey/color")).unwrap();
    for frame in 0..5 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "90 to 165")]
        let samples: Vec<u8> = (0..256 * 256 * 3).map(|_| (90.0 + 75.0 * random.unit()) as u8).collect();
        let truth = ImageU8::new(256, 256, samples).unwrap();
        std::fs::write(here.join(format!("data/grey/{}.png", frame * 33_367)), encode_png(&truth).unwrap()).unwrap();
        let mut gaussian =
            || (-2.0 * (1.0 - random.unit()).ln()).sqrt() * (2.0 * std::f64::consts::PI * random.unit()).cos();
        #[expect(clippy::cast_possible_truncation, reason = "renders are f32")]
        let noisy = Image::from_u8(&truth).samples().iter().map(|s| s + (DEVIATION * gaussian()) as f32).collect();
        let noisy = exr::write_rgb(&Image::new(256, 256, noisy).unwrap(), &exr::Values::DisplayReferred).unwrap();
        std::fs::write(here.join(format!("renders/grey/color/{frame:06}.exr")), noisy).unwrap();
    }
    succeed(here, &["score", "tiny.toml", "--data", "data", "--renders", "renders", "--out", "store"]);
    let results = Results::read(&here.join("store")).unwrap();
    assert_eq!(results.targets.len(), 3);
    let mean = results.targets.iter().map(|row| row.scores["psnr"]).sum::<f64>() / 3.0;
    Tolerance::absolute(0.01).assert([mean], [-20.0 * DEVIATION.log10()], "PSNR of noise");
}

#[test]
fn broken_renders_are_counted_as_rows() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated(here, 2);
    let args = ["run", "tiny.toml", "--data", "data/test", "--out", "floors", "--keep-images", "all"];
    succeed(here, &[&args[..], &["--method", "warp"]].concat());
    let floors = Results::read(&here.join("floors")).unwrap();
    let image = |scene, frame| image_path(&here.join("floors"), &key(&floors, "warp", scene), frame);
    std::fs::remove_file(image(0, 1)).unwrap();
    let whole = std::fs::read(image(0, 2)).unwrap();
    std::fs::write(image(0, 2), &whole[..whole.len() / 2]).unwrap();
    let small = decode(&whole, &DecodeLimits::default()).unwrap();
    let small = ImageU8::new(20, 20, small.samples()[..1200].to_vec()).unwrap();
    std::fs::write(image(1, 1), encode_png(&small).unwrap()).unwrap();

    let renders = "floors/images/tiny/warp";
    let score = ["score", "tiny.toml", "--data", "data/test", "--renders", renders, "--out", "scored"];
    let message = succeed(here, &score);
    assert!(message.contains("3 failed") && message.contains("2 incomplete"), "{message}");
    assert_eq!(atsplat(here, &[&score[..], &["--strict"]].concat()).code, 4);
    let scored = Results::read(&here.join("scored")).unwrap();
    let detail = |target: usize| scored.targets[target].detail.clone().unwrap_or_default();
    assert!(detail(0).contains("no file for frame 1"), "{}", detail(0));
    assert!(detail(1).contains("000002.png"), "{}", detail(1));
    assert!(detail(3).contains("expected an image of 40×40, found 20×20"), "{}", detail(3));
    let failed: Vec<bool> = scored.targets.iter().map(|row| row.status == TargetStatus::Failed).collect();
    assert_eq!(failed, [true, true, false, true, false, false]);
}

/// A file with 3D filters under no chosen mode, and under one.
#[test]
fn gaussians_of_mip_splatting_are_warned_of_and_drawn_as_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated(here, 1);
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../splat/tests/fixtures/files/degree4_mip_uncertainty.ply");
    std::fs::create_dir(here.join("ply")).unwrap();
    let mut names = std::fs::read_dir(here.join("data/test")).unwrap().map(|entry| entry.unwrap().file_name());
    let trajectory = names.find_map(|name| Some(name.to_str()?.strip_suffix(".txt")?.to_owned())).unwrap();
    std::fs::copy(file, here.join(format!("ply/{trajectory}.ply"))).unwrap();
    let score = |out: &str, more: &[&str]| {
        let args = ["score", "tiny.toml", "--data", "data/test", "--ply", "ply", "--out", out];
        atsplat(here, &[&args[..], more].concat())
    };
    score("store", &[]).says(0, "warning: tiny: 1 × drawn in the classic mode, in trials of ply\n");
    succeed(here, &["report", "store", "--out", "page", "--format", "markdown"]);
    let table = std::fs::read_to_string(here.join("page/tables/protocol-tiny.md")).unwrap();
    assert!(table.contains("were drawn in the classic mode in 1 of 1 trials"), "{table}");
    let said = "methods ply of the two runs differ: parameters.mode: none and antialiased";
    score("store", &["--mode", "antialiased"]).says(1, said);
    let chosen = score("chosen", &["--mode", "antialiased"]);
    assert!(chosen.code == 0 && !chosen.stderr.contains("classic mode"), "{}", chosen.stderr);
    let record = Results::read(&here.join("chosen")).unwrap().provenance.methods.remove(0);
    assert_eq!(record.parameters["mode"], "antialiased");
}

#[test]
fn merges_shards_and_reports_missing_ones() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated(here, 5);
    let run = |out: &str, data: &str, more: &[&str]| {
        let args = ["run", "tiny.toml", "--data", data, "--out", out];
        succeed(here, &[&args[..], &FLOORS, more].concat());
        Results::read(&here.join(out)).unwrap()
    };
    let whole = run("whole", "data/test", &[]);
    let absolute = here.join("data/test").display().to_string();
    assert_eq!(run("whole", &absolute, &[]), whole, "resumed, whatever path leads to the data");
    for (shard, data) in [("1/3", "data/test"), ("2/3", "./data/test/"), ("3/3", absolute.as_str())] {
        run(&format!("part-{}", &shard[..1]), data, &["--shard", shard]);
    }
    atsplat(here, &["merge", "part-1", "part-3", "--out", "merged"]).says(1, "shard 2 is missing");
    succeed(here, &["merge", "part-1", "part-3", "part-2", "--out", "merged"]);
    assert_eq!(bare(&Results::read(&here.join("merged")).unwrap()), bare(&whole));
    let why = "merged: expected a folder without results, found results; choose another folder";
    atsplat(here, &["merge", "part-1", "part-2", "part-3", "--out", "merged"]).says(1, why);
    assert_eq!(atsplat(here, &["run", "tiny.toml", "--data", "data/test", "--out", "x", "--shard", "4/3"]).code, 2);
}

#[test]
fn times_are_measured_on_request_and_otherwise_absent_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated(here, 4);
    let run = ["run", "tiny.toml", "--data", "data/test", "--out", "store", "--method", "warp"];
    atsplat(here, &run).prints(0, "no times of warp: no timing pass was made");
    let why = "warning: every frontier is empty: no setting has a cost; against seconds, warp: no timing pass was made";
    atsplat(here, &["tradeoff", "store"]).says(0, why);
    atsplat(here, &[&run[..], &["--repetitions", "7"]].concat()).says(2, "--timing");
    assert_eq!(atsplat(here, &[&run[..], &["--timing", "--repetitions", "4"]].concat()).code, 2, "five at the least");
    let json = printed_json(here, &[&run[..], &["--timing", "--repetitions", "7", "--json"]].concat());
    assert_eq!((&json["summary"]["evaluated"], &json["summary"]["resumed"]), (&0.into(), &4.into()), "{json}");
    let times = &json["times"][0];
    assert_eq!(
        (&times["trials"], &times["trials-there"], &times["encode"]),
        (&3.into(), &4.into(), &serde_json::Value::Null)
    );
    let render = &times["render"];
    assert!(times["repetitions"].as_u64().unwrap() >= 7 && render["median"].as_f64().unwrap() > 0.0, "{times}");
    assert!(times["busy"].is_boolean() && render["mad"].is_number() && times["machine"]["threads"].is_u64(), "{times}");
    let table = succeed(here, &["tradeoff", "store"]);
    let expected = "--curve: expected trials that were optimised with several budgets, and timed; found none";
    atsplat(here, &["reproduce", "--out", "report", "--curve", "store"]).says(1, expected);
    let expected = "./store is the same store as store: name each store once";
    atsplat(here, &["reproduce", "--out", "report", "--curve", "store", "--curve", "./store"]).says(2, expected);
    assert!(!here.join("report").exists(), "nothing was run");
    assert!(table.contains("Timed on") && !table.contains("skipped: no timing"), "{table}");
    assert!(!atsplat(here, &["tradeoff", "store"]).stderr.contains("frontier is empty"), "it has times");
}

#[test]
fn errors_are_reported_before_the_work_starts() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated(here, 1);
    let run = |args: &[&str]| atsplat(here, &[&["run", "tiny.toml", "--data", "data/test"], args].concat());
    std::fs::write(here.join("file"), b"").unwrap();
    run(&[&["--out", "file/store"], &FLOORS[..]].concat()).says(1, "file/store");
    run(&["--out", "store", "--method", "atsplat"]).says(2, "random:SEED");
    run(&["--out", "store", "--method", "renders:nowhere"]).says(1, "nowhere");
    run(&[&["--out", "store", "--metrics", "psnrs"], &FLOORS[..]].concat()).says(2, "psnr-unclipped");
    run(&["--out", "store", "--method", "3dgs:2", "--effects", "all", "--tolerance", "0.1"])
        .says(2, "--tolerance requires --effects auto");
    assert_eq!(run(&["--out", "store", "--method", "guess"]).code, 2);
    assert_eq!(run(&["--out", "store"]).code, 2, "a method is needed");
    std::fs::remove_file(here.join("data/test/evaluation_index.json")).unwrap();
    run(&[&["--out", "store"], &FLOORS[..]].concat()).says(1, "the file of pixelsplat-re10k");
    let photos = ["run", "photos-3v-256", "--data", "data/test", "--out", "store", "--method", "warp"];
    let photos = atsplat(here, &photos).stderr;
    assert!(photos.contains("give an index (--index)") && photos.contains("(--sampler photos-3v)"), "{photos}");
    assert!(!here.join("store").exists(), "nothing was started");
}

#[test]
fn a_store_of_a_newer_version_or_other_settings_is_not_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated(here, 1);
    let args = ["run", "tiny.toml", "--data", "data/test", "--out", "store", "--method", "warp"];
    succeed(here, &[&args[..], &["--metrics", "l1"]].concat());
    let said = "metrics of the two runs differ: l1: then computed, now not requested; request the metrics";
    atsplat(here, &args).says(1, said);
    let path = here.join("store/provenance.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let written = format!("\"schema-version\": {}", atsplat_results::store::SCHEMA_VERSION);
    std::fs::write(&path, text.replace(&written, "\"schema-version\": 99")).unwrap();
    atsplat(here, &args).says(1, "a newer atsplat is needed");
}

/// The second and third command of whoever scores: more scenes, and a metric that was not requested, for one method of two.
#[test]
fn a_store_gets_the_scenes_that_a_limit_left_out_and_further_metrics() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    simulated(here, 5);
    let run = |out: &str, more: &[&str]| {
        let args = ["run", "tiny.toml", "--data", "data/test", "--out", out];
        atsplat(here, &[&args[..], more].concat())
    };
    let expect = |outcome: common::Outcome, computed: &str| {
        outcome.prints(0, computed);
        outcome
    };
    let both = FLOORS[1];
    let first = expect(run("store", &["--method", both, "--limit", "2"]), "4 results computed");
    let note = "note: lpips will not be computed: weights absent: LPIPS (VGG) needs vgg16-397923af.pth; get it from ";
    assert!(first.stderr.contains(note), "{}", first.stderr);
    let said = "limits of the two runs differ: then 2 scenes, now 3 scenes; ";
    run("store", &["--method", both, "--limit", "3"]).says(1, said);
    expect(run("store", &["--method", both]), "6 results computed; 4 were there before");
    let added = run("store", &["--method", "warp", "--metrics", "l1"]);
    let lacking = "10 targets of nearest-view not in the mean of L1: scene ";
    assert!(expect(added, "5 results computed").stdout.contains(lacking));
    expect(run("fresh", &["--method", "warp", "--metrics", "l1"]), "5 results computed");
    let [store, fresh] = ["store", "fresh"].map(|name| Results::read(&here.join(name)).unwrap());
    let of_warp: Vec<_> = store.targets.iter().filter(|row| row.key.method == "warp").cloned().collect();
    assert_eq!(of_warp, fresh.targets);
    assert_eq!((store.provenance.limit, store.provenance.metrics), (None, fresh.provenance.metrics));
    succeed(here, &["report", "store", "--out", "page", "--format", "markdown"]);
    let table = std::fs::read_to_string(here.join("page/tables/protocol-tiny.md")).unwrap();
    assert!(table.contains("not computed: added to the results later"), "{table}");
    succeed(here, &["run", "tiny.toml", "--data", "data/test", "--out", "store", "--method", both, "--metrics", "l1"]);
    let store = Results::read(&here.join("store")).unwrap();
    assert!(store.targets.iter().all(|row| row.scores.contains_key("l1")), "both methods have it");
}

/// A capture whose first target was cropped and whose lens distorts: `run` skips the former by name and counts the latter.
#[test]
fn reports_data_that_contradicts_its_description() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_preset(here, 32);
    let mut keys = Vec::new();
    for key in ["cropped", "whole"] {
        let pose = |x: f64| serde_json::json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        let frame = |at: u32| serde_json::json!({ "file_path": format!("images/{at}.png"), "transform_matrix": pose(f64::from(at) * 0.1) });
        let frames: Vec<_> = (0..3).map(frame).collect();
        let transforms = serde_json::json!({ "w": 64, "h": 48, "fl_x": 64, "k1": 0.01, "frames": frames });
        std::fs::create_dir_all(here.join("data").join(key).join("images")).unwrap();
        std::fs::write(here.join("data").join(key).join("transforms.json"), transforms.to_string()).unwrap();
        for at in 0..3 {
            let width = if key == "cropped" && at == 1 { 48 } else { 64 };
            let image = ImageU8::new(width, 48, vec![90; (width * 48 * 3) as usize]).unwrap();
            let path = here.join("data").join(key).join(format!("images/{at}.png"));
            std::fs::write(path, encode_png(&image).unwrap()).unwrap();
        }
        keys.push(key);
    }
    write_index(&here.join("data"), &keys, "[0, 2]", "[1]");
    let args = ["run", "tiny.toml", "--data", "data", "--out", "store", "--method", "nearest-view"];
    let outcome = atsplat(here, &args);
    let skipped = "1 entry skipped, image-misfit: scene cropped: frame 1: expected an image of 64×48";
    assert!(outcome.stdout.contains(skipped) && outcome.stdout.contains("found 48×48"), "{}", outcome.stdout);
    // Each warning is printed once: in the report or, next to JSON, on standard error.
    assert!(outcome.stdout.contains("warning: tiny: 2 lens-distortion: "), "{}", outcome.stdout);
    assert!(!outcome.stderr.contains("lens-distortion"), "{}", outcome.stderr);
    let again = ["run", "tiny.toml", "--data", "data", "--out", "again", "--method", "nearest-view", "--json"];
    let json = atsplat(here, &again);
    assert!(json.stderr.contains("warning: tiny: 2 × lens-distortion\n"), "{}", json.stderr);
    let results = Results::read(&here.join("store")).unwrap();
    assert_eq!(results.trials.iter().map(|trial| trial.key.scene.as_str()).collect::<Vec<_>>(), ["whole"]);
    let args =
        ["reconstruct", "data", "--key", "cropped", "--views", "0,1", "--weights", "random:1", "--model", "nano"];
    let outcome = atsplat(here, &[&args[..], &["--size", "48x48", "--out", "scene.ply"]].concat());
    assert_eq!(outcome.code, 1, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("cropped") && outcome.stderr.contains("frame 1"), "{}", outcome.stderr);
    assert!(outcome.stderr.contains("64×48") && outcome.stderr.contains("48×48"), "{}", outcome.stderr);
}

/// A scene of RealEstate10K under the two official indices, found by their hashes.
#[test]
fn evaluates_a_real_scene_under_the_official_indices() {
    let Some(shared) = shared_data("a_real_scene_under_the_official_indices") else { return };
    let shared = shared.canonicalize().unwrap();
    let (data, index) = (shared.join("re10k/000c3ab189999a83"), shared.join("index"));
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let args = ["run", "re10k-2v-256", "re10k-overlap", "--any-size", "--data", data.to_str().unwrap()];
    let more = ["--index", index.to_str().unwrap(), "--out", "store"];
    succeed(here, &[&args[..], &more, &FLOORS].concat());
    let results = Results::read(&here.join("store")).unwrap();
    assert_eq!(results.trials.len(), 4);
    let of = |preset: &str| results.trials.iter().find(|trial| trial.key.preset == preset).unwrap();
    assert_eq!((&of("re10k-2v-256").context[..], of("re10k-2v-256").overlap), (&[9, 126][..], None));
    assert_eq!(of("re10k-overlap").context, [25, 161]);
    Tolerance::EXACT.assert(of("re10k-overlap").overlap, [0.2853], "NoPoSplat's overlap");
    let frames: Vec<u64> = results.targets.iter().take(3).map(|row| row.frame).collect();
    assert_eq!(frames, [29, 30, 46]);
    assert!(results.targets.iter().all(|row| (8.0..30.0).contains(&row.scores["psnr"])), "{:?}", results.targets);
    let names: Vec<_> = results.provenance.presets.iter().map(|preset| preset.index_name.as_deref()).collect();
    assert_eq!(names, [Some("pixelsplat-re10k"), Some("noposplat-re10k")]);
}
