use std::collections::BTreeMap;
use std::path::Path;

use atsplat_eval::{Results, TargetRow, TrialKey};
use atsplat_pixels::{DecodeLimits, decode};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::PageStore;

/// The pictures of a page: pairs of truth and render, up to a budget of bytes in base64.
#[derive(Debug, Default)]
pub(super) struct Album {
    uris: Vec<String>,
    places: BTreeMap<(usize, TrialKey, u64), [usize; 2]>,
    found: u64,
    unreadable: u64,
    over_budget: u64,
}

/// The method name under which a store keeps ground-truth pictures.
const TRUTH: &str = "truth";

impl Album {
    pub(super) fn fill(stores: &[PageStore<'_>], budget: usize) -> Self {
        let mut album = Self::default();
        let mut truths: BTreeMap<(usize, TrialKey, u64), usize> = BTreeMap::new();
        let mut left = budget;
        for (at, store) in stores.iter().enumerate() {
            let Some(folder) = store.folder.filter(|folder| folder.join("pictures").is_dir()) else { continue };
            for row in worst_first(store.source.results) {
                let own = |method: &str| TrialKey { method: method.to_owned(), ..row.key.clone() };
                let truth_key = (at, own(TRUTH), row.frame);
                let render = atsplat_eval::runner::picture_path(folder, &row.key, row.frame);
                if !render.is_file() {
                    continue;
                }
                album.found += 1;
                let Some(render) = uri(&render) else {
                    album.unreadable += 1;
                    continue;
                };
                let known = truths.get(&truth_key).copied();
                let truth = if known.is_some() {
                    String::new()
                } else {
                    let path = &atsplat_eval::runner::picture_path(folder, &truth_key.1, row.frame);
                    let Some(truth) = uri(path) else {
                        album.unreadable += 1;
                        continue;
                    };
                    truth
                };
                let Some(rest) = left.checked_sub(render.len() + truth.len()) else {
                    album.over_budget += 1;
                    continue;
                };
                left = rest;
                let truth = known.unwrap_or_else(|| album.add(truth));
                truths.insert(truth_key, truth);
                let render = album.add(render);
                album.places.insert((at, row.key.clone(), row.frame), [truth, render]);
            }
        }
        album
    }

    /// Every picture.
    pub(super) fn uris(&self) -> &[String] {
        &self.uris
    }

    /// The positions of truth and render of a target in [`Self::uris`].
    pub(super) fn places(&self, store: usize, row: &TargetRow) -> Option<[usize; 2]> {
        self.places.get(&(store, row.key.clone(), row.frame)).copied()
    }

    /// How many pictures the page contains, and why it contains no more.
    pub(super) fn summary(&self) -> String {
        if self.found == 0 {
            return "The stores contain no pictures: run with --keep-pictures to compare renders with the ground truth.".to_owned();
        }
        let mut text = format!(
            "{} of {} pictures are in this page, those of the worst scenes first.",
            self.places.len(),
            self.found
        );
        for (count, why) in [(self.over_budget, "would make it too large"), (self.unreadable, "cannot be read")] {
            if count > 0 {
                text.push_str(&format!(" {count} {why}."));
            }
        }
        text
    }

    fn add(&mut self, uri: String) -> usize {
        self.uris.push(uri);
        self.uris.len() - 1
    }
}

/// The targets of all runs, from the scene with the lowest mean PSNR on; runs take turns, so that none uses up the budget.
fn worst_first(results: &Results) -> Vec<&TargetRow> {
    let mut trials: BTreeMap<&TrialKey, Vec<&TargetRow>> = BTreeMap::new();
    for row in &results.targets {
        trials.entry(&row.key).or_default().push(row);
    }
    let mean = |rows: &[&TargetRow]| {
        let scores: Vec<f64> = rows.iter().filter_map(|row| row.scores.get("psnr").copied()).collect();
        if scores.is_empty() { f64::INFINITY } else { scores.iter().sum::<f64>() / scores.len() as f64 }
    };
    let mut runs: BTreeMap<(&str, &str), Vec<(f64, &TrialKey)>> = BTreeMap::new();
    for (key, rows) in &trials {
        runs.entry((&key.preset, &key.method)).or_default().push((mean(rows), key));
    }
    let mut turns: Vec<(usize, &TrialKey)> = Vec::new();
    for run in runs.values_mut() {
        run.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(b.1)));
        turns.extend(run.iter().enumerate().map(|(turn, (_, key))| (turn, *key)));
    }
    turns.sort();
    turns.iter().filter_map(|(_, key)| trials.get(key)).flatten().copied().collect()
}

/// A picture file as a data URI. The file must decode within limits, so that nothing but pictures is embedded.
fn uri(path: &Path) -> Option<String> {
    let bytes = std::fs::read(path).ok()?;
    decode(&bytes, &DecodeLimits::default()).ok()?;
    bytes.starts_with(b"\x89PNG").then(|| format!("data:image/png;base64,{}", STANDARD.encode(bytes)))
}
