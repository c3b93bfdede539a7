//! What `atsplat fit` makes of photos, and says of the training views.

use std::fs;
use std::path::Path;

use atsplat_numeric::Tolerance;
use atsplat_pixels::{DecodeLimits, ImageU8, decode};
use serde_json::{Value, json};
use tempfile::tempdir;

use crate::common::{SCENE, atsplat, read_json, succeed};

const FIT: [&str; 8] = ["fit", "photos", "--start", SCENE, "--strategy", "fixed", "--out", "fitted.ply"];

fn record(here: &Path) -> Value {
    read_json(&here.join("fitted.ply.json"))
}

/// Photos of 13×9 pixels, of which two have an alpha channel with transparent pixels.
#[test]
fn photos_with_alpha_are_composited_over_the_background_if_asked() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "4", "--size", "13x9", "--out", "photos"]);
    let rgba = concat!(env!("CARGO_MANIFEST_DIR"), "/../pixels/tests/fixtures/images/colour6_8.png");
    for number in [1, 3] {
        fs::copy(rgba, here.join(format!("photos/00000{number}.png"))).unwrap();
    }
    let fit = |more: &[&'static str]| {
        let fitted = atsplat(here, &[&FIT[..], &["--views", "..", "--steps", "1"], more].concat());
        assert_eq!(fitted.code, 0, "{}", fitted.stderr);
        let record = record(here);
        let warned = record["warnings"].as_array().unwrap().iter().any(|text| text.as_str().unwrap().contains("alpha"));
        assert_eq!(warned, fitted.stderr.contains("an alpha channel, which is dropped"), "{record}: {}", fitted.stderr);
        (record["alpha"].as_str().unwrap().to_owned(), warned, record["views-sha256"].as_str().unwrap().to_owned())
    };
    let (dropped, black) = (fit(&[]), fit(&["--alpha", "composite"]));
    let white = fit(&["--alpha", "composite", "--background", "white"]);
    assert_eq!((dropped.0.as_str(), dropped.1), ("drop", true));
    assert!([&black, &white].iter().all(|(how, warned, _)| how == "composite" && !warned), "{black:?}, {white:?}");
    assert!(dropped.2 != black.2 && black.2 != white.2 && dropped.2 != white.2, "other pixels");
    assert_eq!(fit(&["--background", "white"]).2, dropped.2, "the background alone changes no photo");
    let random = ["--views", "..", "--steps", "1", "--alpha", "composite", "--background", "random"];
    atsplat(here, &[&FIT[..], &random].concat()).says(2, "--alpha composite requires --background black or white");
}

/// Two steps see two of the three views that are not held out.
#[test]
fn the_psnr_of_training_views_is_named_as_what_it_is() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "4", "--size", "16x12", "--out", "photos"]);
    atsplat(here, &[&FIT[..], &["--views", "..", "--held-out", "0", "--steps", "2"]].concat())
        .prints(0, " dB, mean over each view's last step, 2 of 3 views\n");
    let record = record(here);
    assert_eq!((&record["training-psnr-views"], &record["training-identical"]), (&json!(2), &json!(0)));
    assert!(record["training-psnr"].is_f64(), "{record}");
    assert_eq!(record["evaluations"][0]["identical"], 0, "{record}");
}

/// One photo is missing among those of a range, then all of another range, and then one in each.
#[test]
fn ranges_leave_out_missing_photos_with_a_warning() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "8", "--size", "16x12", "--out", "photos"]);
    fs::remove_file(here.join("photos/000001.png")).unwrap();
    let fit = |views: &[&'static str]| atsplat(here, &[&FIT[..], &["--steps", "1"], views].concat());
    let fitted = fit(&["--views", "..", "--held-out", "0..6:4"]);
    let warned = fitted.stderr.contains("1 × missing-image");
    assert!(fitted.code == 0 && warned, "{}", fitted.stderr);
    let record = record(here);
    assert_eq!((&record["views"], &record["held-out"]), (&json!(["2", "3", "5", "6", "7"]), &json!(["0", "4"])));
    fit(&["--views", "..", "--held-out", "1..2"]).says(1, "--held-out: none of these frames has a photo");
    fs::remove_file(here.join("photos/000005.png")).unwrap();
    let both = fit(&["--views", "0..4", "--held-out", "4..8"]);
    assert_eq!(both.code, 0, "{}", both.stderr);
    for text in ["2 × missing-image\n", "frame 1: no photos/000001.png\n", "frame 5: no photos/000005.png\n"] {
        assert!(both.stderr.contains(text), "{text}: {}", both.stderr);
    }
    let record = serde_json::from_slice::<Value>(&fs::read(here.join("fitted.ply.json")).unwrap()).unwrap();
    assert_eq!((&record["views"], &record["held-out"]), (&json!(["0", "2", "3"]), &json!(["4", "6", "7"])));
}

/// What the warning advises is what the error is about.
#[test]
fn photos_of_a_model_that_are_elsewhere_are_asked_for() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    fs::create_dir_all(here.join("desk/sparse")).unwrap();
    fs::write(here.join("desk/sparse/cameras.txt"), "1 PINHOLE 16 12 16 16 8 6\n").unwrap();
    let images = "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n\n";
    fs::write(here.join("desk/sparse/images.txt"), images).unwrap();
    let fit = ["fit", "desk", "--views", "..", "--strategy", "fixed", "--start", "random:60", "--depths", "1,9"];
    let reconstruct = ["reconstruct", "desk", "--views", "..", "--weights", "random:1", "--model", "nano"];
    for (args, out) in [(&fit[..], &["--steps", "2", "--out", "fitted.ply"][..]), (&reconstruct, &["--out", "r.ply"])] {
        let failed = atsplat(here, &[args, out].concat());
        assert_eq!(failed.code, 1, "{}", failed.stderr);
        for text in ["2 × missing-image\n", "a.png; if the model's images are in another folder, --frames names it\n"]
        {
            assert!(failed.stderr.contains(text), "{text}: {}", failed.stderr);
        }
        assert!(failed.stderr.contains("--views: none of these frames has a photo"), "{}", failed.stderr);
    }
}

/// Photos of 16×12 pixels lose two columns on either side.
#[test]
fn renders_with_the_written_cameras_are_those_of_the_optimisation() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "4", "--size", "16x12", "--out", "photos"]);
    let views = ["fit", "photos", "--views", "3,1", "--held-out", "2", "--size", "12x12", "--strategy", "fixed"];
    let start = ["--start", "random:60", "--depths", "1,9", "--steps", "20", "--out", "fitted.ply"];
    let corrections = ["--optimise-poses", "0.01", "--optimise-exposure", "0.05"];
    succeed(here, &[&views[..], &start, &corrections].concat());
    let record = record(here);
    let mut written = read_json(&here.join("fitted.ply.cameras.json"));
    let cameras = written["views"].as_array().unwrap();
    let number = |camera: &Value| camera["number"].as_u64().unwrap();
    assert_eq!(cameras.iter().map(number).collect::<Vec<_>>(), [3, 1, 2]);
    assert!(cameras.iter().all(|camera| camera["width"] == 12 && camera["height"] == 12));
    for (camera, correction) in cameras.iter().zip(record["corrections"].as_array().unwrap()) {
        assert_eq!(camera["camera-from-world"], correction["camera-from-world"]);
        assert!(camera["exposure"].is_array() && camera["exposure"] == correction["exposure"], "{camera}");
    }
    assert_eq!(cameras[2]["exposure"], Value::Null, "held out");

    for camera in written["views"].as_array_mut().unwrap() {
        camera["exposure"] = Value::Null;
    }
    fs::write(here.join("plain.json"), written.to_string()).unwrap();
    for (file, out) in [("fitted.ply.cameras.json", "again"), ("plain.json", "plain")] {
        succeed(here, &["render", "fitted.ply", "--cameras", file, "--out", out]);
    }
    let image = |folder: &str, number: u32| -> ImageU8 {
        let bytes = fs::read(here.join(format!("{folder}/00000{number}.png"))).unwrap();
        decode(&bytes, &DecodeLimits::default()).unwrap()
    };
    let psnr = |folder: &str, number: u32| {
        let (photo, render) = (image("photos", number), image(folder, number));
        let rows = photo.samples().chunks_exact(3 * 16).flat_map(|row| &row[3 * 2..3 * 14]);
        let squares = rows.zip(render.samples()).map(|(a, b)| (f64::from(a.abs_diff(*b)) / 255.0).powi(2));
        -10.0 * (squares.sum::<f64>() / f64::from(3 * 12 * 12)).log10()
    };
    for trained in [1, 3] {
        let (exposed, plain) = (psnr("again", trained), psnr("plain", trained));
        assert!(exposed > plain + 0.1, "view {trained}: {exposed} dB, {plain} dB without its exposure");
    }
    assert_eq!(image("again", 2).samples(), image("plain", 2).samples(), "the held-out view has no exposure");
    let expected = record["evaluations"].as_array().unwrap().last().unwrap()["psnr"].as_f64().unwrap();
    // Rounded to 8 bits.
    Tolerance::absolute(0.1).assert([psnr("again", 2)], [expected], "PSNR of the held-out view");
}
