use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use atsplat_metrics::{Definition, Direction};
use atsplat_results::store::images::image_path;
use atsplat_results::{Results, TargetRow, TrialKey};

use super::PageStore;
use super::image_files::{ImageFiles, Unusable};
use crate::counted;
use crate::plot_data::first_metric;

/// The images of a page, up to a budget of bytes in base64. Protocols take turns, each with the worst, the best and the most
/// typical of its trials with renders first; a trial adds its context, its truths and the renders of all methods.
#[derive(Debug, Default)]
pub(super) struct Album {
    /// Positions in [`ImageFiles`], in the page's order.
    shown: Vec<usize>,
    /// The reverse.
    known: BTreeMap<usize, usize>,
    left: usize,
    places: BTreeMap<(usize, TrialKey, u64), [usize; 2]>,
    context: BTreeMap<(usize, TrialKey), Vec<(u64, usize)>>,
    found: u64,
    unreadable: u64,
    replaced: u64,
    over_budget: u64,
    context_left_out: BTreeSet<PathBuf>,
}

/// The method names under which a store keeps ground-truth and context images.
const TRUTH: &str = "truth";
const CONTEXT: &str = "context";

impl Album {
    pub(super) fn fill(files: &mut ImageFiles, stores: &[PageStore<'_>], budget: usize) -> Self {
        let mut album = Self { left: budget, ..Self::default() };
        for (at, row) in in_turns(stores) {
            let Some(store) = stores.get(at) else { continue };
            let Some(folder) = store.folder else { continue };
            let path = |method: &str, frame| image_path(folder, &row.key.of_method(method), frame);
            let render = path(&row.key.method, row.frame);
            album.found += 1;
            // Of a store with thousands of images, a page shows few.
            if files.is_too_large(&render, row.render_hash.as_deref(), album.left) {
                album.over_budget += 1;
                continue;
            }
            let truth = files.position(&path(TRUTH, row.frame), row.truth_hash.as_deref());
            let images = match (truth, files.position(&render, row.render_hash.as_deref())) {
                (Ok(truth), Ok(render)) => [truth, render],
                (Err(Unusable::Replaced), _) | (_, Err(Unusable::Replaced)) => {
                    album.replaced += 1;
                    continue;
                }
                _ => {
                    album.unreadable += 1;
                    continue;
                }
            };
            let Some(places) = album.add(files, images) else {
                album.over_budget += 1;
                continue;
            };
            album.places.insert((at, row.key.clone(), row.frame), places);
            let place = (at, row.key.clone());
            if !album.context.contains_key(&place) {
                let trial = store.source.results.trials.iter().find(|trial| trial.key == row.key);
                let frames = trial.map_or(&[][..], |trial| &trial.context);
                let hash = |at: usize| trial?.context_hashes.get(at).map(String::as_str);
                let ends = frames.iter().enumerate().filter(|(at, _)| *at == 0 || at + 1 == frames.len());
                let seen = ends.filter_map(|(at, &frame)| {
                    let file = path(CONTEXT, frame);
                    let added = album.add_file(files, &file, hash(at));
                    if added.is_none() && file.is_file() {
                        album.context_left_out.insert(file);
                    }
                    Some((frame, added?))
                });
                let seen = seen.collect();
                album.context.insert(place, seen);
            }
        }
        album
    }

    /// Every image.
    pub(super) fn uris<'a>(&self, files: &'a ImageFiles) -> Vec<&'a str> {
        self.shown.iter().map(|image| files.uri(*image)).collect()
    }

    /// The positions of truth and render of a target in [`Self::uris`].
    pub(super) fn places(&self, store: usize, row: &TargetRow) -> Option<[usize; 2]> {
        self.places.get(&(store, row.key.clone(), row.frame)).copied()
    }

    /// Frame and position of the first and the last context image of a trial.
    pub(super) fn context(&self, store: usize, key: &TrialKey) -> &[(u64, usize)] {
        self.context.get(&(store, key.clone())).map_or(&[], Vec::as_slice)
    }

    /// How many images the page contains, and why it contains no more.
    pub(super) fn summary(&self) -> String {
        if self.found == 0 {
            return "The stores contain no images: run with --keep-images to compare renders with the ground truth."
                .to_owned();
        }
        let mut text = format!(
            "{} of {} images are in this page, those of the worst, typical and best scenes first.",
            self.places.len(),
            self.found
        );
        for (count, why) in [
            (self.over_budget, "would make it too large"),
            (self.unreadable, "cannot be read"),
            (self.replaced, "belong to results that were replaced"),
        ] {
            if count > 0 {
                text.push_str(&format!(" {count} {why}."));
            }
        }
        if !self.context_left_out.is_empty() {
            let count = counted(self.context_left_out.len() as u64, "context image");
            text.push_str(&format!(" {count} left out: no room, unreadable, or from replaced results."));
        }
        text
    }

    /// The position of an image file; `None` if it is unusable or does not fit.
    fn add_file(&mut self, files: &mut ImageFiles, path: &Path, hash: Option<&str>) -> Option<usize> {
        if files.is_too_large(path, hash, self.left) {
            return None;
        }
        let image = files.position(path, hash).ok()?;
        self.add(files, [image]).map(|[position]| position)
    }

    /// Positions of images, each shown once; `None` if they do not fit.
    fn add<const N: usize>(&mut self, files: &ImageFiles, images: [usize; N]) -> Option<[usize; N]> {
        let new = images.iter().filter(|image| !self.known.contains_key(*image));
        self.left = self.left.checked_sub(new.map(|image| files.uri(*image).len()).sum())?;
        Some(images.map(|image| {
            let next = self.shown.len();
            *self.known.entry(image).or_insert_with(|| {
                self.shown.push(image);
                next
            })
        }))
    }
}

/// Targets, each with the number of its store.
type Rows<'a> = Vec<(usize, &'a TargetRow)>;

/// The targets of all stores that have renders, trial by trial under all methods.
pub(super) fn in_turns<'a>(stores: &[PageStore<'a>]) -> Vec<(usize, &'a TargetRow)> {
    let mut trials = BTreeMap::<(&str, &str, u32), Rows<'_>>::new();
    for (at, store) in stores.iter().enumerate() {
        if store.folder.is_some_and(|folder| folder.join("images").is_dir()) {
            for row in &store.source.results.targets {
                trials.entry((&row.key.preset, &row.key.scene, row.key.entry)).or_default().push((at, row));
            }
        }
    }
    let mut metrics = BTreeMap::<&str, Option<&Definition>>::new();
    let mut by_preset = BTreeMap::<&str, Vec<(f64, Rows<'_>)>>::new();
    for ((preset, ..), rows) in trials {
        let of_store = |results: &Results| {
            let record = results.provenance.presets.iter().find(|record| record.name == preset)?;
            first_metric(results, record)
        };
        let first = || stores.iter().find_map(|store| of_store(store.source.results));
        let metric = *metrics.entry(preset).or_insert_with(first);
        let quality = quality(&rows, metric);
        let with_renders = rows.into_iter().filter(|(at, row)| has_render(stores, *at, row)).collect();
        by_preset.entry(preset).or_default().push((quality, with_renders));
    }
    let mut turns: Vec<(usize, Rows<'_>)> =
        by_preset.into_values().flat_map(|trials| ranked(trials).into_iter().enumerate()).collect();
    turns.sort_by_key(|(turn, _)| *turn);
    turns.into_iter().flat_map(|(_, rows)| rows).collect()
}

fn has_render(stores: &[PageStore<'_>], at: usize, row: &TargetRow) -> bool {
    let folder = stores.get(at).and_then(|store| store.folder);
    folder.is_some_and(|folder| image_path(folder, &row.key, row.frame).is_file())
}

/// The trials of a protocol that have renders: the worst, the best, the one nearest the median of all, then the others from the
/// worst to the best, and last those without scores.
fn ranked(trials: Vec<(f64, Rows<'_>)>) -> Vec<Rows<'_>> {
    let (mut scored, others): (Vec<_>, Vec<_>) = trials.into_iter().partition(|(quality, _)| quality.is_finite());
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    let middle = scored.len() / 2;
    let of_rank = scored.into_iter().map(|(_, rows)| rows).enumerate();
    let mut shown: Vec<(usize, Rows<'_>)> = of_rank.filter(|(_, rows)| !rows.is_empty()).collect();
    let typical = shown.iter().map(|(rank, _)| *rank).min_by_key(|rank| rank.abs_diff(middle));
    let ends = [shown.first(), shown.last()].map(|one| one.map(|(rank, _)| *rank));
    let first = [ends[0], ends[1], typical];
    shown.sort_by_key(|(rank, _)| first.iter().position(|one| *one == Some(*rank)).unwrap_or(first.len()));
    let without_scores = others.into_iter().map(|(_, rows)| rows).filter(|rows| !rows.is_empty());
    shown.into_iter().map(|(_, rows)| rows).chain(without_scores).collect()
}

/// Mean score of a trial's targets, larger for better; infinite without scores.
fn quality(rows: &[(usize, &TargetRow)], metric: Option<&Definition>) -> f64 {
    let Some(metric) = metric else { return f64::INFINITY };
    let scores: Vec<f64> = rows.iter().filter_map(|(_, row)| row.scores.get(metric.id).copied()).collect();
    if scores.is_empty() {
        return f64::INFINITY;
    }
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    match metric.direction {
        Direction::Higher => mean,
        Direction::Lower => -mean,
    }
}
