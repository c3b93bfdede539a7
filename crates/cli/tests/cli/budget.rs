//! `atsplat budget`: the paper's table by formula, and the counts of the network.

use std::path::Path;

use serde_json::{Value, json};

use crate::common::{atsplat, succeed};

fn rows(args: &[&str]) -> Vec<Value> {
    let text = succeed(Path::new("."), &[&["budget", "--json"], args].concat());
    serde_json::from_str::<Value>(&text).unwrap()["rows"].as_array().unwrap().clone()
}

#[test]
fn the_formula_gives_every_published_row() {
    let found: Vec<Value> = rows(&[])
        .iter()
        .map(|row| {
            json!([
                row["model"],
                row["views"],
                row["size"],
                row["max"]["initial"],
                row["max"]["final"],
                row["max"]["gaussians"],
                row["verdict"]
            ])
        })
        .collect();
    let expected = json!([
        ["paper-re10k", 2, [256, 256], 512, 1440, 23_040, "equal"],
        ["paper-dl3dv", 2, [256, 448], 896, 2520, 40_320, "equal"],
        ["paper-dl3dv", 4, [256, 448], 1792, 5040, 80_640, "equal"],
        ["paper-dl3dv", 6, [256, 448], 2688, 7560, 120_960, "equal"],
        ["paper-dl3dv-224", 6, [224, 224], 1176, 3308, 52_928, "equal"],
        ["paper-dl3dv-hr", 12, [512, 960], 5760, 19_440, 311_040, "equal"],
    ]);
    assert_eq!(json!(found), expected);
    let text = succeed(Path::new("."), &["budget"]);
    assert_eq!(text.lines().filter(|line| line.contains("equal")).count(), 6, "{text}");
    assert!(text.contains("52K") && text.contains("GiB"), "{text}");
}

#[test]
fn other_settings_are_not_compared_with_published_rows() {
    let row = |args: &[&str]| rows(args).remove(0);
    let published = row(&["--model", "paper-dl3dv", "--views", "4", "--size", "448x256"]);
    assert_eq!((&published["verdict"], &published["published"]["final-tokens"]), (&json!("equal"), &json!(5040)));
    for args in [
        &["--model", "paper-dl3dv", "--views", "3"][..],
        &["--model", "nano"],
        &["--model", "paper-re10k", "--ratios", "0.5,0.5,0.5"],
    ] {
        let row = row(args);
        assert_eq!((&row["verdict"], &row["published"]), (&json!("not-published"), &Value::Null), "{args:?}");
    }
    let dynamic = row(&["--model", "paper-re10k", "--thresholds", "0.1,0.1,0.4"]);
    assert_eq!((&dynamic["min"]["gaussians"], &dynamic["max"]["gaussians"]), (&json!(8192), &json!(65_536)));
    assert!(rows(&["--thresholds", "1,1,1"]).iter().all(|row| row["published"].is_null()));
}

/// As `run yards-6v-112 --weights micro-yards` does, and as it does with large images.
#[test]
fn another_size_than_that_of_the_weights_has_the_counts_of_a_run_too() {
    let budget = ["budget", "--model", "micro", "--views", "6", "--size"];
    let text = succeed(Path::new("."), &[&budget[..], &["112x112"]].concat());
    let expected = "micro: assumes weights that were trained at 112x112; the network of weights trained at 128x128 sees these images \
                    at 128x128: 1536 > 4320 tokens, 69120 Gaussians";
    assert!(text.contains("52928") && text.lines().any(|line| line == expected), "{text}");
    let text = succeed(Path::new("."), &[&budget[..], &["224x128"]].concat());
    assert!(!text.contains("assumes"), "{text}");
    let row = rows(&["--model", "micro", "--views", "6", "--size", "112x112"]).remove(0);
    assert_eq!((&row["resized"]["seen-at"], &row["resized"]["max"]["gaussians"]), (&json!([128, 128]), &json!(69_120)));
    assert_eq!(row["resized"]["high-resolution"], Value::Null, "small images");
    let large = ["--model", "paper-dl3dv", "--views", "12", "--size", "960x512"];
    let text = succeed(Path::new("."), &[&["budget"], &large[..]].concat());
    for line in [
        "paper-dl3dv: assumes weights that were trained at 512x960; the network of weights trained at 256x448 sees these images at \
         256x480: 5760 > 16200 tokens, 259200 Gaussians",
        "paper-dl3dv: in evaluations, this network takes the setting for large images: 5760 > 19440 tokens, 311040 Gaussians",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}: {text}");
    }
    assert_eq!(rows(&large).remove(0)["resized"]["high-resolution"]["max"]["gaussians"], 311_040);
}

#[test]
fn the_network_agrees_with_the_formula() {
    for (args, gaussians) in [
        (&["--model", "nano", "--views", "3", "--size", "64x48"][..], 1632),
        (&["--model", "nano", "--views", "1", "--size", "48x32", "--thresholds", "0,0,0"], 768),
        (&["--model", "nano", "--views", "1", "--size", "48x32", "--expand-first", "0"], 96),
    ] {
        let row = rows(&[&["--run"], args].concat()).remove(0);
        assert_eq!(row["run"]["tokens"], row["max"], "{row}");
        assert_eq!(
            (&row["run"]["tokens"]["gaussians"], &row["run"]["keeps-to-formula"]),
            (&json!(gaussians), &json!(true))
        );
        assert!(row["run"]["total-secs"].as_f64().unwrap() > 0.0);
    }
    let text = succeed(Path::new("."), &["budget", "--model", "nano", "--views", "1", "--size", "32x32", "--run"]);
    assert!(text.contains("within") && text.contains("seconds of each stage"), "{text}");
}

#[test]
fn rejects_inputs_without_a_budget() {
    for (args, code, message) in [
        (&["--model", "nano", "--size", "40x32"][..], 1, "divisible by 16"),
        (&["--model", "gone.toml"], 1, "gone.toml"),
        (&["--model", "nano", "--thresholds", "1"], 1, "3 thresholds"),
        (&["--model", "none"], 2, "paper-re10k"),
        (&["--views", "2"], 2, "--model"),
        (&["--model", "nano", "--views", "0"], 2, "views"),
        (&["--model", "nano", "--thresholds", "1,1,1", "--ratios", "1,1,1"], 2, "--ratios"),
    ] {
        atsplat(Path::new("."), &[&["budget"], args].concat()).says(code, message);
    }
}
