//! Small protocols, and the reproducible part of their results.

use std::fmt::Write as _;
use std::path::Path;

use atsplat_pixels::{ImageU8, encode_png};
use atsplat_results::{Results, TargetRow, TrialRow};

/// Frames of a scene of [`write_noise`].
pub(crate) const FRAMES: u32 = 40;

/// Writes noise scenes to `data`, with their index.
pub(crate) fn write_noise(here: &Path, scenes: u8) {
    let keys: Vec<String> = (0..scenes).map(|scene| format!("scene-{scene:02}")).collect();
    for (scene, key) in (0..).zip(&keys) {
        std::fs::create_dir_all(here.join("data").join(key)).unwrap();
        let mut text = "https://example.org/video\n".to_owned();
        for frame in 0..FRAMES {
            let x = -0.02 * f64::from(frame);
            writeln!(text, "{} 0.5 0.5 0.5 0.5 0 0 1 0 0 {x} 0 1 0 0 0 0 1 0", frame * 33_367).unwrap();
            let byte = |at: u32| u8::try_from((at * (7 + frame) + at / 61 * (scene + 3)) % 251).unwrap();
            let image = ImageU8::new(32, 32, (0..32 * 32 * 3).map(byte).collect()).unwrap();
            let path = here.join("data").join(key).join(format!("{}.png", frame * 33_367));
            std::fs::write(path, encode_png(&image).unwrap()).unwrap();
        }
        std::fs::write(here.join("data").join(format!("{key}.txt")), text).unwrap();
    }
    write_preset(here, 32);
    let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
    write_index(&here.join("data"), &keys, "[0, 20]", "[1, 3, 5, 7, 9, 11, 13, 15]");
}

/// Writes `tiny.toml`: RE10K's two-view protocol on images of `side`², with any number of targets.
pub(crate) fn write_preset(here: &Path, side: u32) {
    let text = atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap();
    let text = text.replacen("name = \"re10k-2v-256\"", "name = \"tiny\"", 1);
    let text = text.replacen("targets = [3, 3]", "targets = [1, 99]", 1);
    let text = text.replacen("expected-size = { width = 640, height = 360 }\n", "", 1);
    let text = text.replacen("height = 256, width = 256", &format!("height = {side}, width = {side}"), 1);
    std::fs::write(here.join("tiny.toml"), text).unwrap();
}

/// Writes an index with the same frames in every scene.
pub(crate) fn write_index(folder: &Path, scenes: &[&str], context: &str, target: &str) {
    let entries: Vec<String> =
        scenes.iter().map(|scene| format!("{scene:?}: {{\"context\": {context}, \"target\": {target}}}")).collect();
    std::fs::write(folder.join("evaluation_index.json"), format!("{{{}}}", entries.join(", "))).unwrap();
}

/// Rows without times, which differ between runs.
pub(crate) fn bare(results: &Results) -> (Vec<TrialRow>, Vec<TargetRow>) {
    (results.trials.clone(), results.targets.clone())
}
