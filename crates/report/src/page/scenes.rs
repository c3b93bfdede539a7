use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::timing::{TimingRow, machine_of};
use atsplat_eval::{Results, TargetRow, TrialKey, TrialRow};
use atsplat_metrics::{DECIBEL_CAP, Definition, Direction, definitions};
use atsplat_numeric::median;
use serde_json::{Value, json};

use super::PageStore;
use super::pictures::Album;

/// Metrics for which any target has a score, in the order of their definitions.
pub(super) fn metrics(stores: &[PageStore<'_>]) -> Vec<Value> {
    let scored: BTreeSet<&str> = stores
        .iter()
        .flat_map(|store| &store.source.results.targets)
        .flat_map(|row| row.scores.keys().map(String::as_str))
        .collect();
    let known = definitions().iter().filter(|metric| scored.contains(metric.id));
    let to_json = |metric: &Definition| {
        let decimals = if metric.unit == "dB" { 2 } else { 3 };
        json!({ "id": metric.id, "name": metric.name, "higher": metric.direction == Direction::Higher, "decimals": decimals })
    };
    known.map(to_json).collect()
}

/// Every protocol and method with its trials, for the page's script.
pub(super) fn runs(stores: &[PageStore<'_>], album: &Album) -> Vec<Value> {
    let mut runs = Vec::new();
    for (at, store) in stores.iter().enumerate() {
        let results = store.source.results;
        let mut targets: BTreeMap<&TrialKey, Vec<&TargetRow>> = BTreeMap::new();
        for row in &results.targets {
            targets.entry(&row.key).or_default().push(row);
        }
        let mut by_run: BTreeMap<(&str, &str), Vec<Value>> = BTreeMap::new();
        for trial in &results.trials {
            let own = targets.get(&trial.key).map_or(&[][..], Vec::as_slice);
            let trial_json = trial_to_json(
                trial,
                own,
                encoding(results, trial),
                &|row| album.places(at, row),
                album.context(at, &trial.key),
            );
            by_run.entry((&trial.key.preset, &trial.key.method)).or_default().push(trial_json);
        }
        for ((preset, method), trials) in by_run {
            let title = results
                .provenance
                .methods
                .iter()
                .find(|record| record.name == method)
                .map_or(method, |record| &record.title);
            let store = if stores.len() > 1 { format!(" · {}", store.source.label) } else { String::new() };
            runs.push(json!({ "label": format!("{preset} · {title}{store}"), "protocol": preset, "title": format!("{title}{store}"), "trials": trials }));
        }
    }
    runs
}

/// Median seconds of a trial's encoding on the machine that tables show; `None` if the trial was not timed there.
fn encoding(results: &Results, trial: &TrialRow) -> Option<f64> {
    let machine = machine_of(results, &trial.key.preset)?;
    let own = |row: &&TimingRow| {
        row.key == trial.key && row.trial_hash == trial.trial_hash && row.machine == *machine && !row.load.is_busy()
    };
    median(results.timings.iter().find(own)?.encode.iter().copied())
}

fn trial_to_json(
    trial: &TrialRow,
    targets: &[&TargetRow],
    encode: Option<f64>,
    places: &dyn Fn(&TargetRow) -> Option<[usize; 2]>,
    seen: &[(u64, usize)],
) -> Value {
    let mut sums: BTreeMap<&str, (f64, u64)> = BTreeMap::new();
    for (metric, score) in targets.iter().flat_map(|row| scores(row)) {
        let (sum, count) = sums.entry(metric).or_default();
        *sum += score;
        *count += 1;
    }
    let means: BTreeMap<&str, f64> =
        sums.into_iter().map(|(metric, (sum, count))| (metric, sum / count as f64)).collect();
    let pictures = targets.iter().filter_map(|row| {
        let [truth, render] = places(row)?;
        let scores: BTreeMap<&str, f64> = scores(row).collect();
        Some(json!({ "frame": row.frame, "leaked": row.leaked, "scores": scores, "truth": truth, "render": render }))
    });
    json!({
        "scene": trial.key.scene,
        "entry": trial.key.entry,
        "status": trial.status.name(),
        "detail": trial.detail,
        "scores": means,
        "context": trial.context,
        "gaussians": trial.gaussians,
        "encode": encode,
        "pictures": pictures.collect::<Vec<_>>(),
        "seen": seen,
    })
}

/// Scores as they enter averages: the PSNR of identical pictures is the declared cap.
fn scores(row: &TargetRow) -> impl Iterator<Item = (&str, f64)> {
    let finite = row.scores.iter().map(|(metric, score)| (metric.as_str(), *score));
    let identical = row.status == atsplat_eval::TargetStatus::Identical && !row.scores.contains_key("psnr");
    finite.chain(identical.then_some(("psnr", DECIBEL_CAP)))
}

/// The list of scenes and the details of the selected one.
pub(super) fn section(stores: &[PageStore<'_>], album: &Album) -> String {
    if stores.iter().all(|store| store.source.results.trials.is_empty()) {
        return "<p class=\"hint\">No trial was run.</p>".to_owned();
    }
    let heads: String = metrics(stores)
        .iter()
        .filter_map(|metric| metric.get("name")?.as_str())
        .map(|name| format!("<th>{name}</th>"))
        .collect();
    format!(
        "<p class=\"hint\">{}</p>\n<div class=\"choose\"><label>Run <select id=\"run\"></select></label> \
         <label>Beside <select id=\"beside\"></select></label> <label>Order <select id=\"order\">\
         <option value=\"worst\">worst first</option><option value=\"typical\">typical first</option><option value=\"best\">best \
         first</option><option value=\"difference\">by difference</option></select></label> \
         <label>by <select id=\"metric\"></select></label></div>\n<div class=\"strip\" id=\"extremes\"></div>\n\
         <div class=\"browser\"><div class=\"list\" tabindex=\"0\" role=\"region\" aria-label=\"Scenes\"><table><thead><tr>\
         <th class=\"label\">Scene</th>{heads}<th id=\"lead\" hidden>Lead</th><th></th></tr></thead><tbody id=\"list\"></tbody></table></div>\
         <div class=\"detail card\" id=\"detail\" aria-live=\"polite\"></div></div>",
        super::escaped(&album.summary()),
    )
}
