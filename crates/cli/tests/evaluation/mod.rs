//! Small protocols and what two runs of them have in common.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use atsplat_eval::{Results, TargetRow, TrialRow};

/// Writes `tiny.toml`: RE10K's two-view protocol on pictures of `side`².
pub(crate) fn write_preset(here: &Path, side: u32) {
    let text = atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap();
    let text = text.replacen("name = \"re10k-2v-256\"", "name = \"tiny\"", 1);
    let text = text.replacen("expected-size = { width = 640, height = 360 }\n", "", 1);
    let text = text.replacen("height = 256, width = 256", &format!("height = {side}, width = {side}"), 1);
    std::fs::write(here.join("tiny.toml"), text).unwrap();
}

/// Writes an index that asks the same of every scene.
pub(crate) fn write_index(folder: &Path, scenes: &[&str], context: &str, target: &str) {
    let entries: Vec<String> =
        scenes.iter().map(|scene| format!("{scene:?}: {{\"context\": {context}, \"target\": {target}}}")).collect();
    std::fs::write(folder.join("evaluation_index.json"), format!("{{{}}}", entries.join(", "))).unwrap();
}

/// Rows without times, which differ from run to run.
pub(crate) fn bare(results: &Results) -> (Vec<TrialRow>, Vec<TargetRow>) {
    (results.trials.clone(), results.targets.clone())
}
