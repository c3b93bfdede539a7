//! `atsplat fit` as a user runs it.

mod common;

use std::path::Path;

use serde_json::Value;
use tempfile::tempdir;

use common::{atsplat, succeed};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../splat/tests/fixtures/files/compressed_degree1.ply");

/// Eight photos of 64×64 pixels around a small scene, in `photos`.
fn photograph(folder: &Path) {
    succeed(folder, &["render", SCENE, "--orbit", "8", "--size", "64x64", "--out", "photos"]);
}

/// The scene is optimised for photos at half their size; held-out ones are then compared at that size, at the photos' own, and at an
/// eighth of that.
#[test]
fn held_out_photos_are_compared_at_other_scales() {
    let folder = tempdir().unwrap();
    photograph(folder.path());
    let with_scales = |scales: &'static str| {
        let views = ["fit", "photos", "--views", "..", "--held-out", "..:4", "--size", "32x32", "--scales", scales];
        let run = ["--start", SCENE, "--strategy", "mip-splatting", "--steps", "2", "--out", "fitted.ply", "--json"];
        [&views[..], &run[..]].concat()
    };
    let report: Value = serde_json::from_str(&succeed(folder.path(), &with_scales("2,1,0.25"))).unwrap();
    let rows = report["at-scales"].as_array().unwrap();
    let size = |row: &Value| (row["scale"].as_f64(), row["width"].as_u64(), row["height"].as_u64());
    let expected = [(2.0, 64), (1.0, 32), (0.25, 8)].map(|(scale, side)| (Some(scale), Some(side), Some(side)));
    assert_eq!(rows.iter().map(size).collect::<Vec<_>>(), expected);
    let last = report["evaluations"].as_array().unwrap().last().unwrap();
    assert_eq!((&rows[1]["psnr"], &rows[1]["ssim"]), (&last["psnr"], &last["ssim"]), "once the size itself");
    assert!([0, 2].iter().all(|&at| rows[at]["psnr"].as_f64().unwrap() > 10.0 && rows[at]["psnr"] != last["psnr"]));
    let enlarged = atsplat(folder.path(), &with_scales("4"));
    assert_ne!(enlarged.code, 0);
    assert!(enlarged.stderr.contains("--scales 4") && enlarged.stderr.contains("128"), "{}", enlarged.stderr);
}
