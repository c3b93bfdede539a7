//! What `atsplat reconstruct` makes of photos.

use std::fs;

use atsplat_pixels::{DecodeLimits, ImageU8, decode, encode_png};
use serde_json::{Value, json};
use tempfile::tempdir;

use crate::common::{SCENE, atsplat, read_json, succeed};

/// A network for 48×32 pixels.
const TINY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../model/oracle/tiny.toml");

/// A PNG of 48×32 pixels of (200, 90, 30), of which the left half is transparent.
#[rustfmt::skip]
const HALF_TRANSPARENT: [u8; 115] = [
    137, 80, 78, 71, 13, 10, 26, 10, 0, 0, 0, 13, 73, 72, 68, 82, 0, 0, 0, 48, 0, 0, 0, 32, 8, 6,
    0, 0, 0, 84, 212, 251, 28, 0, 0, 0, 58, 73, 68, 65, 84, 120, 218, 237, 207, 49, 1, 0, 48, 8, 3, 176,
    42, 65, 216, 20, 227, 10, 52, 236, 224, 203, 17, 1, 73, 191, 202, 177, 185, 20, 1, 1, 1, 1, 1, 1, 1, 1,
    1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 129, 95, 11, 26, 145, 125, 151, 200, 226, 26, 235, 0,
    0, 0, 0, 73, 69, 78, 68, 174, 66, 96, 130,
];

#[test]
fn photos_with_alpha_are_composited_over_the_background_if_asked() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "4", "--size", "48x32", "--out", "photos"]);
    fs::write(here.join("photos/000002.png"), HALF_TRANSPARENT).unwrap();
    let reconstruct = |more: &[&'static str]| -> Vec<&'static str> {
        let input = ["reconstruct", "photos", "--views", "0,2", "--weights", "random:3", "--model", TINY];
        [&input[..], &["--out", "scene.ply"], more].concat()
    };
    let input = |more: &[&'static str]| {
        succeed(here, &[reconstruct(&["--renders", "renders"]), more.to_vec()].concat());
        let png = fs::read(here.join("renders/inputs/000002.png")).unwrap();
        let image = decode(&png, &DecodeLimits::default()).unwrap();
        let record = read_json(&here.join("scene.ply.json"));
        let last = image.samples().len() - 3;
        assert_eq!(image.samples()[last..], [200, 90, 30], "{more:?}: opaque");
        (image.samples()[..3].to_vec(), record["input"]["composited-over"].clone())
    };
    assert_eq!(input(&[]), (vec![200, 90, 30], Value::Null));
    assert_eq!(input(&["--alpha", "composite"]), (vec![0; 3], json!([0, 0, 0])));
    let colour = ["--alpha", "composite", "--background", "1,0.2,0"];
    assert_eq!(input(&colour), (vec![255, 51, 0], json!([255, 51, 0])));
    let expected = "--background requires --renders, --plots or --alpha composite";
    atsplat(here, &reconstruct(&["--background", "white"])).says(2, expected);
    succeed(here, &reconstruct(&["--background", "white", "--alpha", "composite"]));
}

/// The second run has one photo less, no targets, and a new photo; the render at 2 is its own.
#[test]
fn images_of_another_run_are_counted_and_recorded() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "5", "--size", "48x32", "--out", "photos"]);
    let reconstruct = |more: &[&str]| {
        let input = ["reconstruct", "photos", "--weights", "random:3", "--model", TINY, "--renders", "renders"];
        let outcome = atsplat(here, &[&input[..], &["--out", "scene.ply"], more].concat());
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        let record = read_json(&here.join("scene.ply.json"));
        let warnings = record["warnings"].as_array().unwrap().clone();
        (outcome.stderr, warnings.iter().find(|text| text.as_str().unwrap().contains("another run")).cloned())
    };
    assert_eq!(reconstruct(&["--views", "0,1,2", "--targets", "3"]).1, None);
    let (stderr, recorded) = reconstruct(&["--views", "2,4"]);
    let expected = "renders contains 5 images from another run";
    assert!(stderr.contains(&format!("warning: {expected}")), "{stderr}");
    assert_eq!(recorded, Some(expected.into()));
}

/// A file where renders go is found when the Gaussians are written.
#[test]
fn a_run_whose_later_outputs_fail_leaves_no_record_of_an_earlier_one() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "5", "--size", "48x32", "--out", "photos"]);
    let first = ["reconstruct", "photos", "--weights", "random:3", "--model", TINY, "--views", "0,1", "--out", "a.ply"];
    succeed(here, &first);
    let gaussians = || fs::read(here.join("a.ply")).unwrap();
    let before = gaussians();
    fs::create_dir(here.join("renders")).unwrap();
    fs::write(here.join("renders/context"), "").unwrap();
    atsplat(here, &[&first[..6], &["--views", "0,2", "--renders", "renders", "--out", "a.ply"]].concat())
        .says(1, "renders/context");
    assert!(gaussians() != before && !here.join("a.ply.json").exists());
}

/// The listed photos are gone, and two copies of them are there: the smaller one has the size that the protocol requires.
#[test]
fn a_protocol_chooses_the_copy_of_photos_that_it_requires() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    let frame = |at: u32| {
        let pose = json!([[1, 0, 0, 0.1 * f64::from(at)], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        json!({ "file_path": format!("images/{at}.png"), "transform_matrix": pose })
    };
    let frames: Vec<Value> = (0..3).map(frame).collect();
    let transforms = json!({ "w": 240, "h": 160, "fl_x": 240, "frames": frames });
    for (copy, [width, height]) in [("images_2", [120, 80]), ("images_4", [60, 40])] {
        fs::create_dir_all(here.join("data").join(copy)).unwrap();
        for at in 0..3u8 {
            let image = ImageU8::new(width, height, vec![90 + 7 * at; (width * height * 3) as usize]).unwrap();
            fs::write(here.join(format!("data/{copy}/{at}.png")), encode_png(&image).unwrap()).unwrap();
        }
    }
    fs::write(here.join("data/transforms.json"), transforms.to_string()).unwrap();
    let preset = atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap();
    let preset = preset.replacen("name = \"re10k-2v-256\"", "name = \"mine\"", 1);
    let preset = preset.replacen("{ width = 640, height = 360 }", "{ width = 60, height = 40 }", 1);
    let preset = preset.replacen("height = 256, width = 256", "height = 32, width = 48", 1);
    fs::write(here.join("mine.toml"), preset).unwrap();
    let network = ["--weights", "random:3", "--model", TINY, "--out", "scene.ply"];
    for (copy, more) in [("images_4/0.png", None), ("images_2/0.png", Some("--any-size"))] {
        let args = ["reconstruct", "data", "--views", "0,2", "--protocol", "mine.toml"];
        atsplat(here, &[&args, &network[..], more.as_slice()].concat()).says(0, copy);
    }
}
