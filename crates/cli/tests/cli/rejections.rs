//! What would silently change or lose a number is an error.

use std::fs;

use crate::common::{atsplat, read_json, succeed, write_trajectory};
use crate::evaluation::{bare, write_noise};
use crate::render_scene::SCENE;
use atsplat_model::ModelConfig;
use atsplat_results::Results;

const RUN: [&str; 6] = ["run", "tiny.toml", "--data", "data", "--out", "store"];

/// Arguments that no method of the call reads, each with the one that would.
#[test]
fn arguments_that_nothing_reads_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let baseline = [&RUN[..], &["--method", "warp"]].concat();
    let optimised = [&RUN[..], &["--method", "3dgs:2"]].concat();
    let renders = ["score", "tiny.toml", "--data", "data", "--out", "store", "--renders", "data"].to_vec();
    let gone = ["--weights", "/gone.safetensors"];
    for (args, more, expected) in [
        (&baseline, &gone[..], "--weights requires one of the methods atsplat, atsplat+refine"),
        (&baseline, &["--model", "nano"], "--model requires one of the methods atsplat"),
        (&optimised, &["--thresholds", "0.1,0.1,0.1"], "--thresholds requires one of the methods atsplat"),
        (&baseline, &["--context-size", "given"], "--context-size requires one of the methods atsplat"),
        (&baseline, &["--max-gaussians", "5"], "--max-gaussians requires one of the methods 3dgs, mip-splatting, mcmc"),
        (&baseline, &["--seed", "7"], "--seed requires one of the methods atsplat, atsplat+refine, 3dgs,"),
        (&baseline, &["--seed", "0"], "--seed requires one of the methods atsplat, atsplat+refine, 3dgs,"),
        (&optimised, &["--method-timeout", "3"], "--method-timeout requires the method exec"),
        (&optimised, &["--method-processes", "3"], "--method-processes requires the method exec"),
        (&optimised, &["--ply-frame", "trial"], "--ply-frame requires the method ply"),
        (&optimised, &["--setting", "DepthSplat"], "--setting requires the method ply"),
        (&renders, &["--setting", "DepthSplat"], "--setting requires --ply"),
        (&optimised, &["--mode", "antialiased"], "--mode requires one of the methods ply, exec"),
        (&renders, &["--mode", "classic"], "--mode requires --ply"),
        (&optimised, &["--opacities-as-stored"], "--opacities-as-stored requires one of the methods ply, exec"),
        (&baseline, &["--effects", "none"], "--effects requires a method whose Gaussians are rendered"),
        (&renders, &["--tolerance", "0.1"], "--tolerance requires --ply"),
        (
            &baseline,
            &["--images", "2"],
            "--images: expected captures of nerfstudio or COLMAP, found a dataset in the format re10k",
        ),
        (&baseline, &["--prefer-undistorted"], "--prefer-undistorted: expected captures of nerfstudio or DL3DV"),
        (&baseline, &["--metric-weights", "gone"], "expected an existing folder, found \"gone\""),
        (&baseline, &["--metrics", "ssim,pnsr"], "pnsr"),
        (&baseline, &["--method", "nearest-view,warp"], "--method: warp is given twice"),
        (&baseline, &["--constants", "inria"], "--constants requires a method whose Gaussians are rendered"),
        (&renders, &["--background", "white"], "--background requires --ply"),
        (&renders, &["--ply-frame", "trial"], "--ply-frame requires --ply"),
        (&baseline, &["--warm-up", "2"], "--warm-up requires --timing"),
        (&baseline, &["tiny.toml"], "the protocols: tiny.toml is given twice"),
        (&optimised, &["--max-gaussians", "3"], "--max-gaussians"),
        (
            &baseline,
            &["--method", "atsplat", "--weights", "random:1", "--context-size", "given"],
            "--context-size requires --weights with a file",
        ),
    ] {
        atsplat(here, &[&args[..], more].concat()).says(2, expected);
    }
    atsplat(here, &[&RUN[..], &["--method", "atsplat"]].concat()).says(2, "--weights is required: micro-rooms,");
    assert!(!here.join("store").exists());
    succeed(here, &[&optimised[..], &["--max-gaussians", "300", "--background", "white", "--seed", "7"]].concat());
}

/// Weights do not fit another configuration, even one with the same shapes; a copy keeps what they say of their training.
#[test]
fn weights_keep_their_configuration_and_training() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let network = [&RUN[..], &["--method", "atsplat", "--weights", "micro-rooms", "--model", "micro"]].concat();
    atsplat(here, &network).says(1, "anchors.depth.near: 0.1 and 0.5");

    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../eval/checkpoints/micro-rooms.safetensors");
    let import = ["weights", "import", file, "--out", "copy.safetensors", "--precision", "f16"];
    atsplat(here, &[&import[..], &["--model", "micro"]].concat()).says(1, "is a file of this toolkit");
    let config = atsplat_model::weights::ModelWeights::read(file.as_ref()).unwrap();
    fs::write(here.join("same.toml"), toml::to_string(&config.config).unwrap()).unwrap();
    succeed(here, &[&import[..], &["--model", "same.toml"]].concat());
    atsplat(here, &["weights", "verify", file, "--model", "micro"]).says(1, "anchors.depth.near: 0.1 and 0.5");
    succeed(here, &["weights", "verify", "copy.safetensors", "--model", "same.toml"]);
    let copy = atsplat_model::weights::ModelWeights::read(&here.join("copy.safetensors")).unwrap();
    assert!(copy.config == config.config && copy.tensors.digest() == config.tensors.digest());
    assert!(config.provenance.contains_key("data"), "{:?}", config.provenance);
    for (key, value) in &config.provenance {
        assert_eq!(copy.provenance.get(key), Some(value), "{key}");
    }
    assert_ne!(config.config, ModelConfig::named("micro").unwrap());
}

#[test]
fn windows_without_room_are_no_index_and_the_input_stays() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/aaaa.txt"), 60);
    let index = r#"{"aaaa": {"context": [10, 40], "target": [20]}}"#;
    fs::write(here.join("index.json"), index).unwrap();
    let extrapolate = ["protocol", "extrapolate", "index.json", "--data", "data", "--out"];
    let rejected = atsplat(here, &[&extrapolate[..], &["wide.json", "--margin", "30"]].concat());
    let advice = "nothing was written; --margin takes fewer targets on each side; --clip keeps windows with those that the scene has";
    rejected.says(1, "no window has room");
    assert!(rejected.stderr.contains(advice) && !rejected.stderr.contains("--keep-windows"), "{}", rejected.stderr);
    assert!(!here.join("wide.json").exists());
    succeed(here, &[&extrapolate[..], &["clipped.json", "--margin", "30", "--clip"]].concat());
    atsplat(here, &[&extrapolate[..], &["./index.json"]].concat()).says(1, "would overwrite the input index");
    assert_eq!(fs::read_to_string(here.join("index.json")).unwrap(), index);
    succeed(here, &[&extrapolate[..], &["near.json"]].concat());
}

#[test]
fn a_report_of_no_store_creates_nothing() {
    let folder = tempfile::tempdir().unwrap();
    atsplat(folder.path(), &["report", "nowhere", "--out", "page"]).says(1, "reading nowhere: ");
    assert!(!folder.path().join("page").exists());
}

/// Outputs are opened before inputs are read. One of their folders was there before.
#[test]
fn a_failure_leaves_no_folder_behind() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::create_dir(here.join("there")).unwrap();
    for args in [
        "reconstruct nowhere --views 0 --weights random:1 --out out/a.ply --renders out/b --plots there",
        "fit nowhere --views .. --strategy 3dgs --steps 1 --out out/a.ply --plots out/b --checkpoint there/c",
        "reproduce --weights nowhere.safetensors --out out",
        "render nowhere.ply --orbit --out out/a --preview out/b/c.png",
        "data simulate out/a --route nowhere",
        "weights import nowhere.pth --model nano --out out/a/b.safetensors",
    ] {
        atsplat(here, &args.split(' ').collect::<Vec<_>>()).says(1, "nowhere");
        let left: Vec<_> = fs::read_dir(here).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["there"], "{args}");
    }
}

/// Failed rows, and renders without a Gaussian, are what `--strict` is for.
#[test]
fn strict_finds_failed_rows_and_empty_renders() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 2);
    fs::create_dir(here.join("behind")).unwrap();
    // A Gaussian far behind every camera, and a broken one.
    let (header, _) = SCENE.split_once("end_header").unwrap();
    let rows = "0 0 -9000 0 0 0 1 -4 -4 -4 1 0 0 0 0\nnan 0 3 1 1 1 3 -1 -1 -1 1 0 0 0 1\n";
    let text = format!("{}end_header\n{rows}", header.replace("vertex 6", "vertex 2"));
    let write = |scene: &str| fs::write(here.join("behind").join(scene), &text).unwrap();
    let score = |store: &str| {
        atsplat(here, &["score", "tiny.toml", "--data", "data", "--strict", "--ply", "behind", "--out", store])
    };
    let report = |store: &str, more: &[&str]| atsplat(here, &[&["report", store, "--out", "page"], more].concat());
    write("scene-00.ply");
    assert_eq!(score("failing").code, 4);
    report("failing", &["--strict"]).says(4, "failing: tiny: 1 trial of behind is incomplete: scene-01 failed:");
    assert_eq!(report("failing", &[]).code, 0);

    write("scene-01.ply");
    score("empty").prints(4, "2 without a Gaussian in any target");
    let expected = "empty: tiny: 2 trials of behind render no Gaussian in any target: scene scene-00, entry 0";
    report("empty", &["--strict"]).says(4, expected);
    let table = fs::read_to_string(here.join("page/tables/protocol-tiny.md")).unwrap();
    for expected in
        ["no Gaussian is rendered in 2 of 2 trials", "broken Gaussians were repaired or not drawn in 2 of 2 trials"]
    {
        assert!(table.contains(expected), "{expected}: {table}");
    }
}

/// A Gaussian at a depth of 0.05: DepthSplat culls what is nearer than 0.1 in the dataset's unit, ATSplat what is nearer than 0.002 in the
/// trial's.
#[test]
fn gaussians_of_a_listed_method_are_not_drawn_with_other_settings_in_silence() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    fs::create_dir(here.join("near")).unwrap();
    let (header, _) = SCENE.split_once("end_header").unwrap();
    let row = "0.16 0 0.05 0 0 0 5 -5 -5 -5 1 0 0 0 0\n";
    let text = format!("{}end_header\n{row}", header.replace("vertex 6", "vertex 1"));
    fs::write(here.join("near/scene-00.ply"), text).unwrap();
    let score = |out: &str, more: &[&str]| {
        let args = ["score", "tiny.toml", "--data", "data", "--ply", "near", "--name", "depthsplat", "--out", out];
        atsplat(here, &[&args[..], more].concat())
    };
    let results = |store: &str| Results::read(&here.join(store)).unwrap();
    let warning = "although it states others for a method of their name: depthsplat";
    score("store", &[]).prints(0, warning);
    assert!(!results("store").trials[0].renders_nothing());
    let said = "methods depthsplat of the two runs differ: parameters.setting: none and DepthSplat";
    score("store", &["--setting", "DepthSplat"]).says(1, said);
    let chosen = score("chosen", &["--setting", "DepthSplat"]);
    assert!(chosen.code == 0 && !chosen.stdout.contains(warning), "{}", chosen.stdout);
    assert!(results("chosen").trials[0].renders_nothing());
    let method = ["--method", "depthsplat=ply:near", "--setting", "DepthSplat"];
    succeed(here, &[&RUN[..5], &["run"], &method].concat());
    assert_eq!(bare(&results("run")), bare(&results("chosen")));
    let kept = score("kept", &["--setting", "ATSplat"]);
    assert!(kept.code == 0 && !kept.stdout.contains(warning), "{}", kept.stdout);
    assert_eq!(bare(&results("kept")), bare(&results("store")));
    score("misspelt", &["--setting", "DepthSplt"]).says(1, "\"DepthSplt\"");
    let elsewhere = score("elsewhere", &["--setting", "NoPoSplat"]);
    assert!(elsewhere.stdout.contains("depthsplat names NoPoSplat"), "{}", elsewhere.stdout);
}

/// Polars panics while it reads this table, which is reported like other damage.
#[test]
fn a_damaged_table_is_an_error_without_a_report_of_the_panic() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    succeed(here, &[&RUN[..], &["--method", "nearest-view"]].concat());
    let trials = here.join("store/trials.parquet");
    let mut bytes = fs::read(&trials).unwrap();
    // In the type of an unsigned column (64 bits, unsigned), one bit of the field that is a flag.
    let at = bytes.windows(4).position(|window| window == [0x13, 64, 0x12, 0]).unwrap();
    bytes[at + 2] ^= 1;
    fs::write(&trials, bytes).unwrap();
    // As in a store of an older version: a stated hash would tell first.
    let records = here.join("store/provenance.json");
    let mut stated = read_json(&records);
    assert!(stated.as_object_mut().unwrap().remove("tables-sha256").is_some());
    fs::write(&records, stated.to_string()).unwrap();
    let refused = atsplat(here, &["report", "store", "--out", "page"]);
    refused.says(1, "found damaged data: ");
    assert!(!refused.stderr.contains("panicked"), "{}", refused.stderr);
}

#[test]
fn an_unfinished_run_is_no_baseline() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 3);
    let run = [&RUN[..], &["--method", "nearest-view"]].concat();
    succeed(here, &run);
    // As if the run had been killed before its last trial: each part contains one trial.
    let trials = here.join("store").join("trials.parquet");
    assert!(trials.is_file(), "a finished store is compact");
    let mut results = Results::read(&here.join("store")).unwrap();
    let last = results.trials.pop().unwrap();
    results.targets.retain(|row| row.key != last.key);
    results.write(&here.join("killed")).unwrap();
    let accept = ["drift", "accept", "killed", "--baseline", "baseline.json", "--why", "first", "--no-probe"];
    atsplat(here, &accept).says(1, "is not done: 2 of 3 entries of tiny under nearest-view");
    assert!(!here.join("baseline.json").exists());
    succeed(here, &["drift", "accept", "store", "--baseline", "baseline.json", "--why", "first", "--no-probe"]);
}

#[test]
fn a_table_with_a_flipped_bit_is_named_by_whatever_reads_its_store() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let run = [&RUN[..], &["--method", "nearest-view"]].concat();
    succeed(here, &run);
    let table = here.join("store/targets.parquet");
    let whole = fs::read(&table).unwrap();
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    fs::write(&table, &flipped).unwrap();
    let commands: [&[&str]; 4] = [
        &run,
        &["report", "store", "--out", "page"],
        &["merge", "store", "--out", "merged"],
        &["drift", "accept", "store", "--baseline", "baseline.json", "--why", "first", "--no-probe"],
    ];
    for args in commands {
        let failed = atsplat(here, args);
        let said = ["provenance.json states (restore the file from a copy", "it was damaged", "targets.parquet"];
        assert!(
            failed.code == 1 && said.iter().all(|part| failed.stderr.contains(part)),
            "{args:?}: {}",
            failed.stderr
        );
    }
    assert!(!here.join("merged").exists() && !here.join("baseline.json").exists());
    assert_eq!(fs::read(&table).unwrap(), flipped, "nothing replaces it");
    fs::write(&table, whole).unwrap();
    succeed(here, &run);
}
