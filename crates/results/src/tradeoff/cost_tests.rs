//! Costs of settings: what they are of, how they are compared, and what is said of them.

use atsplat_metrics::Direction;
use atsplat_numeric::Tolerance;
use atsplat_protocol::{Aggregation, Preset};

use super::*;
use crate::sample_rows::{PRESET, results, timing};
use crate::statistics::{Contrast, Leaked};
use crate::times::{GAUSSIANS_UNTIMED, Load, TimingRow};
use crate::{
    MethodRecord, PresetRecord, Results, StatedCost, StatedSeconds, TargetRow, TargetStatus, TrialKey, TrialRow,
    TrialStatus,
};

/// The rows of several methods under one protocol, each timed for half a second on every scene.
fn store(methods: &[&str], scenes: &[(&str, u32, Vec<f64>)]) -> Results {
    let mut store = Results::default();
    for name in methods {
        let rows = results(name, "psnr", scenes);
        store.provenance.metrics = rows.provenance.metrics;
        store.timings.extend(rows.trials.iter().map(|row| timing(name, &row.key.scene, &[0.25], &[0.25])));
        store.trials.extend(rows.trials);
        store.targets.extend(rows.targets);
        store.provenance.methods.push(MethodRecord { name: (*name).to_owned(), ..MethodRecord::default() });
    }
    store.provenance.presets.push(preset_record(PRESET, Aggregation::SceneMeans));
    store
}

fn preset_record(name: &str, aggregation: Aggregation) -> PresetRecord {
    let mut preset = Preset::named("re10k-2v-256").unwrap();
    preset.aggregation = aggregation;
    PresetRecord { name: name.to_owned(), toml: preset.to_toml().unwrap(), ..PresetRecord::default() }
}

fn scenes() -> [(&'static str, u32, Vec<f64>); 2] {
    [("sparse", 0, vec![20.0]), ("dense", 0, vec![24.0])]
}

fn only(store: &Results) -> Tradeoff {
    tradeoffs(store, &["psnr"], Leaked::Included).unwrap().swap_remove(0)
}

fn text(tradeoff: Tradeoff) -> String {
    TradeoffReport { tradeoffs: vec![tradeoff], unfinished: Vec::new() }.to_string()
}

/// The points along an axis, cheapest first, with their costs.
fn costs(tradeoff: &Tradeoff, axis: Axis) -> Vec<(&str, f64)> {
    let frontier = tradeoff.frontiers.iter().find(|frontier| frontier.axis == axis).unwrap();
    frontier.points.iter().map(|point| (point.label.as_str(), point.cost)).collect()
}

/// One has a time for its Gaussians; those of the other come from files.
#[test]
fn gaussians_that_were_made_elsewhere_have_no_time() {
    let mut store = store(&["made", "imported"], &scenes());
    for row in store.timings.iter_mut().filter(|row| row.key.method == "imported") {
        row.encode.clear();
    }
    let found = only(&store);
    assert_eq!(costs(&found, Axis::Seconds), [("made", 0.5)]);
    assert_eq!(found.frontiers[0].left_out, [("imported".to_owned(), GAUSSIANS_UNTIMED.to_owned())]);
    assert_eq!(costs(&found, Axis::Gaussians).len(), 2, "their number is known");
}

/// The frugal one has half as many in every scene, but the lavish one fails in the dense scene.
#[test]
fn gaussians_are_averaged_over_common_trials() {
    let mut store = store(&["frugal", "lavish"], &scenes());
    for row in &mut store.trials {
        let dense = if row.key.scene == "dense" { 10 } else { 1 };
        let sparse = if row.key.method == "frugal" { 1000 } else { 2000 };
        row.gaussians = Some(sparse * dense);
        if row.key.method == "lavish" && dense > 1 {
            (row.status, row.gaussians) = (TrialStatus::Failed, None);
        }
    }
    store.targets.retain(|row| row.key.method == "frugal" || row.key.scene == "sparse");
    let noted = |store: &Results| only(store).notes.into_iter().map(|note| note.text).collect::<Vec<_>>();
    assert_eq!(costs(&only(&store), Axis::Gaussians), [("frugal", 1000.0), ("lavish", 2000.0)]);
    let expected = "Gaussians are averaged over the 1 trial that all settings finished, of 2";
    assert!(noted(&store).contains(&expected.to_owned()), "{:?}", noted(&store));
    // Without a trial in common, each is over its own.
    store.trials.retain(|row| row.key.method == "lavish" || row.key.scene == "dense");
    assert_eq!(costs(&only(&store), Axis::Gaussians), [("lavish", 2000.0), ("frugal", 10_000.0)]);
    assert!(noted(&store).iter().any(|note| note.starts_with("No trial was finished by all")), "{:?}", noted(&store));
}

/// The images of one are NaN in the dense scene, where it has ten times as many Gaussians.
#[test]
fn trials_without_a_compared_image_are_not_finished() {
    let mut store = store(&["finite", "nan"], &scenes());
    for row in &mut store.trials {
        row.gaussians = Some(if row.key.scene == "dense" { 5000 } else { 500 });
    }
    for row in store.targets.iter_mut().filter(|row| row.key.method == "nan" && row.key.scene == "dense") {
        row.status = TargetStatus::NonFinite;
        row.scores.clear();
    }
    let found = only(&store);
    assert_eq!(costs(&found, Axis::Gaussians), [("finite", 500.0), ("nan", 500.0)]);
    let expected = "Gaussians are averaged over the 1 trial that all settings finished, of 2";
    assert!(found.notes.iter().any(|note| note.text == expected), "{:?}", found.notes);
}

#[test]
fn times_of_other_trials_and_rows_of_several_machines_are_named() {
    let mut store = store(&["a", "b", "c"], &scenes());
    assert_eq!(only(&store).notes, []);
    store.timings.retain(|row| row.key.method != "b" || row.key.scene == "dense");
    for (row, machine) in store.trials.iter_mut().filter(|row| row.key.method == "c").zip(["two threads", "sixteen"]) {
        row.notes = vec!["something else".to_owned(), format!("optimisation: 147 steps in its time on {machine}")];
    }
    let found = only(&store);
    let expected = [
        "b: timed on 1 of the 2 trials that have times: times of different trials are compared",
        "c: optimised on several machines, which take different numbers of steps in the same time: sixteen; two threads",
    ];
    assert_eq!(found.notes.iter().map(ToString::to_string).collect::<Vec<_>>(), expected);
    let text = text(found);
    assert!(expected.iter().all(|note| text.contains(&format!("\n  {note}\n"))), "{text}");
}

/// The images of a scene have changed since a setting was timed on it.
#[test]
fn times_of_outdated_trials_are_not_counted() {
    let mut store = store(&["a", "b"], &scenes());
    let row = store.timings.iter_mut().find(|row| row.key.method == "b" && row.key.scene == "dense").unwrap();
    row.trial_hash = "another".to_owned();
    let expected = "b: timed on 1 of the 2 trials that have times: times of different trials are compared";
    assert_eq!(only(&store).notes.iter().map(ToString::to_string).collect::<Vec<_>>(), [expected]);
}

/// Of three protocols, the first has another stated machine than the others, and the machine of an outdated time.
#[test]
fn protocols_are_compared_on_the_machine_for_which_most_state_times() {
    let names = ["first", "second", "third"];
    let mut store = results("a", "psnr", &[("x", 0, vec![20.0])]);
    let (trial, target) = (store.trials.remove(0), store.targets.remove(0));
    let mut record = MethodRecord { name: "a".to_owned(), ..MethodRecord::default() };
    for (preset, machine) in names.into_iter().zip(["one card", "two cards", "two cards"]) {
        let key = TrialKey { preset: preset.to_owned(), ..trial.key.clone() };
        store.trials.push(TrialRow { key: key.clone(), ..trial.clone() });
        store.targets.push(TargetRow { key, ..target.clone() });
        let seconds = StatedSeconds { encode: 0.5, render: Some(0.25), machine: machine.to_owned() };
        record.stated.insert(preset.to_owned(), StatedCost { seconds: Some(seconds), ..StatedCost::default() });
        store.provenance.presets.push(preset_record(preset, Aggregation::SceneMeans));
    }
    store.provenance.methods.push(record);
    let outdated = timing("a", "x", &[0.5], &[]);
    let key = store.trials[0].key.clone();
    store.timings.push(TimingRow { key, trial_hash: "another".to_owned(), ..outdated });
    let found = across(&store, "psnr", Leaked::Included).unwrap();
    assert_eq!(found.machines.iter().map(|machine| machine.processor.as_str()).collect::<Vec<_>>(), ["two cards"]);
    let timed: Vec<&str> = costs(&found, Axis::Seconds).into_iter().map(|(label, _)| label).collect();
    assert_eq!(timed, ["a, second", "a, third"]);
}

#[test]
fn differences_are_averaged_as_all_protocols_average() {
    // Two targets gain nothing, and one 3 dB.
    let of = |method, last| results(method, "psnr", &[("x", 0, vec![20.0, 20.0]), ("y", 0, vec![last])]);
    let (mut store, other) = (of("a", 20.0), of("b", 23.0));
    store.trials.extend(other.trials);
    store.targets.extend(other.targets);
    let record = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
    store.provenance.methods.extend(["a", "b"].map(record));
    let mut difference = |presets: [(&str, Aggregation); 2]| {
        store.provenance.presets = presets.map(|(name, aggregation)| preset_record(name, aggregation)).to_vec();
        let found = across(&store, "psnr", Leaked::Included).unwrap();
        let point = found.frontiers[1].points.iter().find(|point| point.label == "b, sampled").unwrap();
        (point.against.as_ref().unwrap().difference.value.abs(), found.notes.len())
    };
    let (all, means) = (Aggregation::AllImages, Aggregation::SceneMeans);
    for (presets, expected, notes) in [
        ([(PRESET, all), ("empty", all)], 1.0, 0),
        ([(PRESET, means), ("empty", means)], 1.5, 0),
        ([(PRESET, all), ("empty", means)], 1.5, 1),
    ] {
        let (found, said) = difference(presets);
        Tolerance::F64.assert([found], [expected], "difference");
        assert_eq!(said, notes);
    }
}

fn timed(label: &str, quality: f64, secs: f64) -> Sample {
    let secs = Ok(Seconds { median: secs, error: 0.1, ..Seconds::default() });
    Sample { label: label.to_owned(), quality: Ok(quality), secs, gaussians: None, counts: Counts::default() }
}

/// The difference of their qualities, give or take 1.
fn within_one(samples: &[Sample], terms: &[(usize, f64)]) -> Contrast {
    let value = terms.iter().map(|(at, weight)| weight * samples[*at].quality.as_ref().unwrap()).sum::<f64>();
    Contrast { value, interval: Some([value - 1.0, value + 1.0]), scenes: 9, unpaired: 0 }
}

/// The second costs the same as the third, which is better, but is dearer than the first.
#[test]
fn a_point_is_worse_than_a_later_one_of_the_same_cost() {
    let samples = [timed("first", 20.0, 1.0), timed("twin", 20.5, 2.0), timed("better", 25.0, 2.05)];
    let contrasts = |terms: &[(usize, f64)]| Some(within_one(&samples, terms));
    let found = frontier(&samples, &contrasts, Direction::Higher, Axis::Seconds, 0.1);
    let standings = found.points.iter().map(|point| (point.standing, point.against.as_ref().unwrap().label.as_str()));
    let expected = [(Standing::Frontier, "better"), (Standing::Worse, "better"), (Standing::Frontier, "first")];
    assert_eq!(standings.collect::<Vec<_>>(), expected);
}

/// The third has targets in common with the first alone, which the second has replaced as the last of the frontier.
#[test]
fn a_point_is_not_compared_with_one_that_it_beats() {
    let samples = [timed("first", 20.0, 1.0), timed("second", 22.0, 2.0), timed("elsewhere", 24.0, 3.0)];
    let contrasts = |terms: &[(usize, f64)]| {
        let has = |sample: usize| terms.iter().any(|(at, _)| *at == sample);
        (!(has(1) && has(2))).then(|| within_one(&samples, terms))
    };
    let found = frontier(&samples, &contrasts, Direction::Higher, Axis::Seconds, 0.1);
    let last = found.points.last().unwrap();
    assert_eq!((last.standing, last.against.is_none()), (Standing::NotDistinguishable, true), "{last:?}");
}

/// Six scenes, in which the second setting is better by so many decibels; both with their seconds.
fn two_settings(gain: f64, [cheap, dear]: [f64; 2]) -> Results {
    let scene = |name, psnr| [(name, 0, vec![psnr])];
    let mut store = Results::default();
    for (method, gain, secs) in [("a", 0.0, cheap), ("b", gain, dear)] {
        for (name, psnr) in ["s", "t", "u", "v", "w", "x"].into_iter().zip([20.0, 21.0, 22.0, 23.0, 24.0, 25.0]) {
            let rows = results(method, "psnr", &scene(name, psnr + gain));
            store.trials.extend(rows.trials);
            store.targets.extend(rows.targets);
            store.timings.push(timing(method, name, &[secs], &[]));
        }
        store.provenance.methods.push(MethodRecord { name: method.to_owned(), ..MethodRecord::default() });
    }
    store.provenance.presets.push(preset_record(PRESET, Aggregation::SceneMeans));
    store
}

#[test]
fn prices_of_unreliable_times_are_marked() {
    let mut store = two_settings(1.0, [0.5, 1.0]);
    let price = "the next 0.1 dB for +50.0 ms";
    let quiet = text(only(&store));
    assert!(quiet.contains(&format!("{price} and +0 Gaussians\n")) && !quiet.contains('§'), "{quiet}");
    let others = Some(0.5);
    store.timings[7] = TimingRow { load: Load { others, ..Load::default() }, ..store.timings[7].clone() };
    store.provenance.methods[1].kind = "exec".to_owned();
    let busy = text(only(&store));
    assert!(busy.contains(&format!("{price}‡§ and")), "{busy}");
    let mut unpaid = only(&store);
    let price = Price { secs: None, gaussians: None, ..unpaid.frontiers[0].prices[0].clone() };
    unpaid.frontiers[0].prices = vec![price];
    let unpaid = text(unpaid);
    assert!(unpaid.contains("the next 0.1 dB for no measurable time\n"), "{unpaid}");
}

/// A frontier of settings that all look the same would contradict itself.
#[test]
fn what_decides_is_not_printed_as_zero() {
    let fast = text(only(&two_settings(1.0, [4.8e-6, 7.2e-6])));
    assert!(fast.contains(" 0.00480 ±0.00000 ") && fast.contains(" 0.0072 ±0.0000 "), "{fast}");
    assert!(fast.contains("the next 0.1 dB for +0.000240 ms and +0 Gaussians\n"), "{fast}");
    let close = text(only(&two_settings(0.000_02, [0.5, 1.0])));
    for expected in [
        " 500.0 ±0.0 ",
        "-0.0000200 (-0.0000200 to -0.0000200) from b",
        "+0.0000200 (+0.0000200 to +0.0000200) from a",
        "a to b, 0.0000200 dB better (0.0000200 to 0.0000200): the next 0.1 dB for ",
    ] {
        assert!(close.contains(expected), "{expected}: {close}");
    }
}
