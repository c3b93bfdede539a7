use std::collections::{BTreeMap, BTreeSet};

use atsplat_metrics::{DECIBEL_CAP, Definition, Direction, definition, definitions};
use atsplat_numeric::median;
use atsplat_results::statistics::is_psnr;
use atsplat_results::times::{Machine, TimingRow, machine_of};
use atsplat_results::{IDENTICAL, Results, TargetRow, TargetStatus, TrialKey, TrialRow};
use serde_json::{Value, json};

use super::PageStore;
use super::images::Album;
use crate::plot_data::title_of;

/// Metrics for which any target has a score, in the order of their definitions.
pub(super) fn metrics(stores: &[PageStore<'_>]) -> Vec<Value> {
    let scored: BTreeSet<&str> = stores
        .iter()
        .flat_map(|store| &store.source.results.targets)
        .flat_map(|row| row.scores.keys().map(String::as_str))
        .collect();
    let known = definitions().iter().filter(|metric| scored.contains(metric.id));
    let to_json = |metric: &Definition| {
        let (higher, decimals) = (metric.direction == Direction::Higher, metric.scale.decimals());
        json!({ "id": metric.id, "name": metric.name, "higher": higher, "decimals": decimals })
    };
    known.map(to_json).collect()
}

/// Every protocol and method with its trials, for the page's script.
pub(super) fn runs(stores: &[PageStore<'_>], album: &Album) -> Vec<Value> {
    let mut runs = Vec::new();
    let data = data_numbers(stores);
    for (at, store) in stores.iter().enumerate() {
        let results = store.source.results;
        let psnrs = psnrs(results);
        let encodings = encodings(results);
        let mut targets: BTreeMap<&TrialKey, Vec<&TargetRow>> = BTreeMap::new();
        for row in &results.targets {
            targets.entry(&row.key).or_default().push(row);
        }
        let mut by_run: BTreeMap<(&str, &str), Vec<Value>> = BTreeMap::new();
        for trial in &results.trials {
            let targets = targets.get(&trial.key).map_or(&[][..], Vec::as_slice);
            let trial_json = trial_to_json(
                trial,
                targets,
                &psnrs,
                trial.data_hash.as_deref().and_then(|hash| data.get(hash).copied()),
                encodings.get(&(&trial.key, trial.trial_hash.as_str())).copied(),
                &|row| album.places(at, row),
                album.context(at, &trial.key),
            );
            by_run.entry((&trial.key.preset, &trial.key.method)).or_default().push(trial_json);
        }
        for ((preset, method), trials) in by_run {
            let record = results.provenance.method(method);
            let title = record.map_or_else(|| method.to_owned(), |record| title_of(results, record));
            let store = if stores.len() > 1 { format!(" · {}", store.source.label) } else { String::new() };
            let preset_record = results.provenance.preset(preset);
            runs.push(json!({
                "label": format!("{preset} · {title}{store}"),
                "protocol": preset,
                "protocol_hash": preset_record.map(|preset| format!("{} {}", preset.hash, preset.index_sha256)),
                "title": format!("{title}{store}"),
                "trials": trials,
            }));
        }
    }
    runs
}

/// A number for each hash of a trial's data: the script only compares them, and a page may have many thousands of trials.
fn data_numbers<'a>(stores: &[PageStore<'a>]) -> BTreeMap<&'a str, usize> {
    let trials = stores.iter().flat_map(|store| &store.source.results.trials);
    let hashes: BTreeSet<&str> = trials.filter_map(|trial| trial.data_hash.as_deref()).collect();
    hashes.into_iter().enumerate().map(|(number, hash)| (hash, number)).collect()
}

/// Median seconds of the encoding of each trial, by its key and hash, in its last pass on the machine that tables show, unless it
/// was busy.
fn encodings(results: &Results) -> BTreeMap<(&TrialKey, &str), f64> {
    let mut machines: BTreeMap<&str, Option<Machine>> = BTreeMap::new();
    let mut last: BTreeMap<(&TrialKey, &str), &TimingRow> = BTreeMap::new();
    for row in results.timings.iter().filter(|row| row.is_timed()) {
        let machine = machines.entry(&row.key.preset).or_insert_with(|| machine_of(results, &row.key.preset));
        if machine.as_ref() != Some(&row.machine) {
            continue;
        }
        let known = last.entry((&row.key, row.trial_hash.as_str())).or_insert(row);
        if row.started >= known.started {
            *known = row;
        }
    }
    let secs = |row: &TimingRow| median(row.encode.iter().copied()).filter(|_| !row.load.is_busy());
    last.into_iter().filter_map(|(trial, row)| Some((trial, secs(row)?))).collect()
}

fn trial_to_json(
    trial: &TrialRow,
    targets: &[&TargetRow],
    psnrs: &[&str],
    data: Option<usize>,
    encode: Option<f64>,
    places: &dyn Fn(&TargetRow) -> Option<[usize; 2]>,
    seen: &[(u64, usize)],
) -> Value {
    // A target may be listed twice, and then weighs twice.
    let mut by_frame: BTreeMap<&str, Vec<(u64, f64)>> = BTreeMap::new();
    // As in tables, a render that is identical to the truth is in no mean, of whichever metric.
    for row in targets.iter().filter(|row| row.status == TargetStatus::Scored) {
        for (metric, score) in row.scores.iter().filter(|(_, score)| score.is_finite()) {
            by_frame.entry(metric).or_default().push((row.frame, *score));
        }
    }
    let mean = |scores: &[(u64, f64)]| scores.iter().map(|(_, score)| score).sum::<f64>() / scores.len() as f64;
    let means: BTreeMap<&str, f64> =
        by_frame.iter().map(|(metric, scores)| (*metric, rounded(metric, mean(scores)))).collect();
    for (metric, scores) in &mut by_frame {
        for (_, score) in scores {
            *score = rounded(metric, *score);
        }
    }
    let images = targets.iter().filter_map(|row| {
        let [truth, render] = places(row)?;
        let scores: BTreeMap<&str, f64> = scores(row, psnrs).collect();
        Some(json!({ "frame": row.frame, "leaked": row.leaked, "scores": scores, "truth": truth, "render": render }))
    });
    json!({
        "scene": trial.key.scene,
        "entry": trial.key.entry,
        "status": trial.status.name(),
        "detail": trial.detail,
        "scores": means,
        "by_frame": by_frame,
        "data": data,
        "context": trial.context,
        "gaussians": trial.gaussians,
        "encode": encode,
        "images": images.collect::<Vec<_>>(),
        "seen": seen,
    })
}

/// A score with two decimals more than are printed.
fn rounded(metric: &str, score: f64) -> f64 {
    const PRINTED_AT_MOST: usize = 3;
    let printed = definition(metric).map_or(PRINTED_AT_MOST, |metric| metric.scale.decimals());
    let power = 10f64.powf((printed + 2) as f64);
    (score * power).round() / power
}

/// The variants of PSNR among the metrics of a store.
fn psnrs(results: &Results) -> Vec<&'static str> {
    let metrics = results.provenance.metrics.iter().filter_map(|record| definition(&record.id));
    metrics.map(|metric| metric.id).filter(|id| is_psnr(id)).collect()
}

/// Scores of one image: a PSNR that is infinite, because the compared images are identical, is the declared cap.
fn scores<'a>(row: &'a TargetRow, psnrs: &[&'a str]) -> impl Iterator<Item = (&'a str, f64)> {
    let finite = row.scores.iter().map(|(metric, score)| (metric.as_str(), *score));
    let is_infinite = |psnr: &str| match row.not_computed.get(psnr) {
        Some(reason) => reason == IDENTICAL,
        None => row.status == TargetStatus::Identical && !row.scores.contains_key(psnr),
    };
    let infinite: Vec<&str> = psnrs.iter().copied().filter(|psnr| is_infinite(psnr)).collect();
    finite.chain(infinite.into_iter().map(|psnr| (psnr, DECIBEL_CAP)))
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
         <label>Compare with <select id=\"compared\"></select></label> <label>Order <select id=\"order\">\
         <option value=\"worst\">worst first</option><option value=\"typical\">typical first</option><option value=\"best\">best \
         first</option><option value=\"difference\">by difference</option></select></label> \
         <label>by <select id=\"metric\"></select></label></div>\n<div class=\"strip\" id=\"extremes\"></div>\n\
         <div class=\"browser\"><div class=\"list\" tabindex=\"0\" role=\"region\" aria-label=\"List of scenes\"><table><thead><tr>\
         <th class=\"label\">Scene</th>{heads}\
         <th id=\"difference\" title=\"positive: better than the compared run, over targets that both have\" hidden>Difference</th><td></td></tr></thead><tbody id=\"list\"></tbody></table></div>\
         <div class=\"detail card\" id=\"detail\" aria-live=\"polite\"></div></div>",
        super::escaped(&album.summary()),
    )
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use atsplat_results::MetricRecord;

    use super::*;
    use crate::sample::{atsplat, nearest_view, preset, results};
    use crate::table::Source;

    #[test]
    fn trainings_of_one_title_are_runs_of_their_own() {
        let results = results(vec![preset("re10k-2v-256")], ["one", "two"].map(|name| atsplat(name, |_| ())).to_vec());
        let store = PageStore { source: Source { label: "run", results: &results }, folder: None };
        let runs = runs(&[store], &Album::default());
        let titles: Vec<&str> = runs.iter().filter_map(|run| run["title"].as_str()).collect();
        assert_eq!(titles, ["ATSplat (one)", "ATSplat (two)"]);
    }

    /// A page of thousands of trials has no room for hashes and all digits; two methods on the same images have the same number.
    #[test]
    fn trials_are_short() {
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), nearest_view()]);
        results.targets[0].scores = [("psnr".to_owned(), 20.123_456_789), ("ssim".to_owned(), 0.123_456_789)].into();
        for (at, trial) in results.trials.iter_mut().enumerate() {
            trial.data_hash = Some(format!("{:064x}", at % 4));
        }
        results.trials[1].data_hash = None;
        let store = PageStore { source: Source { label: "run", results: &results }, folder: None };
        let runs = runs(&[store], &Album::default());
        let numbers = |run: usize| (0..4).map(|at| runs[run]["trials"][at]["data"].as_u64()).collect::<Vec<_>>();
        assert_eq!(numbers(0), [Some(0), None, Some(2), Some(3)]);
        assert_eq!(numbers(1), [Some(0), Some(1), Some(2), Some(3)]);
        let first = &runs[0]["trials"][0]["by_frame"];
        assert_eq!(
            (first["psnr"][0].to_string(), first["ssim"][0].to_string()),
            ("[5,20.1235]".into(), "[5,0.12346]".into())
        );
        assert!(runs[0]["trials"][0].to_string().len() < 400, "{}", runs[0]["trials"][0]);
    }

    /// The second pass is slower by a second, and its row is stored first or last.
    #[test]
    fn the_last_pass_counts_unless_the_machine_was_busy() {
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ())]);
        let encoding = |results: &Results| {
            let trial = &results.trials[0];
            encodings(results).get(&(&trial.key, trial.trial_hash.as_str())).copied()
        };
        let first = results.timings[0].clone();
        let mut again = TimingRow { started: first.started + 1, ..first };
        again.encode.iter_mut().for_each(|secs| *secs += 1.0);
        for at in [0, results.timings.len()] {
            let mut twice = results.clone();
            twice.timings.insert(at, again.clone());
            Tolerance::F64.assert(encoding(&twice), [1.25], "the second pass");
        }
        again.load.others = Some(0.4);
        results.timings.push(again);
        assert_eq!(encoding(&results), None);
    }

    /// A target of 20 dB with one whose render equals the truth, as tables average them: 20, not 60.
    #[test]
    fn identical_renders_are_in_no_mean() {
        for psnr in ["psnr", "psnr-8bit-truncated"] {
            let mut results = results(vec![preset("re10k-2v-256")], vec![nearest_view()]);
            results.provenance.metrics = vec![MetricRecord { id: psnr.to_owned(), ..MetricRecord::default() }];
            results.trials.truncate(1);
            results.targets.truncate(2);
            results.targets[0].scores = [(psnr.to_owned(), 20.0), ("ssim".to_owned(), 0.5)].into();
            let same = &mut results.targets[1];
            (same.status, same.scores) = (TargetStatus::Identical, [("ssim".to_owned(), 1.0)].into());
            same.not_computed = [(psnr.to_owned(), IDENTICAL.to_owned())].into();
            let store = PageStore { source: Source { label: "run", results: &results }, folder: None };
            let runs = runs(&[store], &Album::default());
            let mean = |metric: &str| runs[0]["trials"][0]["scores"][metric].as_f64();
            Tolerance::EXACT.assert([mean(psnr).unwrap(), mean("ssim").unwrap()], [20.0, 0.5], psnr);
            // The image itself shows the cap, under the metric of its store.
            let shown: Vec<(&str, f64)> = scores(&results.targets[1], &psnrs(&results)).collect();
            assert_eq!(shown.iter().map(|(metric, _)| *metric).collect::<Vec<_>>(), ["ssim", psnr]);
            Tolerance::EXACT.assert(shown.iter().map(|(_, score)| *score), [1.0, DECIBEL_CAP], psnr);
        }
    }
}
