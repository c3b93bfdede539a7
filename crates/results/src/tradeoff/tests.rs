use atsplat_metrics::Direction;
use atsplat_numeric::Tolerance;
use atsplat_protocol::{Aggregation, Preset};
use proptest::prelude::*;

use super::Standing::{Frontier as On, NotDistinguishable as Unclear, Worse};
use super::scored::{Scored, scored};
use super::*;
use crate::sample_rows::{PRESET, results, timing};
use crate::statistics::{Contrast, Leaked};
use crate::times::{Machine, TimingRow, machine_of};
use crate::{MethodRecord, PresetRecord, Results, TargetRow, TargetStatus, TrialKey, TrialRow, TrialStatus};

fn sample(label: &str, quality: f64, secs: f64) -> Sample {
    let (quality, gaussians, counts) = (Ok(quality), Some(1000.0 * secs), Counts::default());
    let secs = Ok(Seconds { median: secs, ..Seconds::default() });
    Sample { label: label.to_owned(), quality, secs, gaussians, counts }
}

/// [`sample`], whose seconds have a measurement error.
fn measured(label: &str, quality: f64, secs: f64, error: f64) -> Sample {
    let timed = Ok(Seconds { median: secs, error, ..Seconds::default() });
    Sample { secs: timed, ..sample(label, quality, secs) }
}

/// The frontier if every difference has the interval ± `half`.
fn frontier_with_intervals(half: f64, samples: &[Sample], direction: Direction, axis: Axis, step: f64) -> Frontier {
    let contrasts = |terms: &[(usize, f64)]| {
        let value = terms.iter().map(|(at, weight)| weight * samples[*at].quality.as_ref().unwrap()).sum::<f64>();
        Some(Contrast { value, interval: Some([value - half, value + half]), scenes: 9, unpaired: 0 })
    };
    super::frontier(samples, &contrasts, direction, axis, step)
}

fn frontier(samples: &[Sample], direction: Direction, axis: Axis, step: f64) -> Frontier {
    frontier_with_intervals(0.0, samples, direction, axis, step)
}

fn preset_record(name: &str) -> PresetRecord {
    let toml = Preset::named("re10k-2v-256").unwrap().to_toml().unwrap();
    PresetRecord { name: name.to_owned(), toml, ..PresetRecord::default() }
}

fn labels(frontier: &Frontier) -> Vec<&str> {
    frontier.points.iter().filter(|point| point.on_frontier()).map(|point| point.label.as_str()).collect()
}

fn standings(frontier: &Frontier) -> Vec<(&str, Standing)> {
    frontier.points.iter().map(|point| (point.label.as_str(), point.standing)).collect()
}

#[test]
fn dominated_points_are_not_on_the_frontier() {
    let samples = [
        sample("dear", 28.0, 4.0),
        sample("cheap", 20.0, 1.0),
        sample("worse than cheap", 19.0, 1.5),
        sample("middle", 27.0, 2.0),
        sample("as good as middle, dearer", 27.0, 3.0),
        sample("as dear as middle, worse", 26.0, 2.0),
        sample("twin of middle", 27.0, 2.0),
    ];
    let found = frontier(&samples, Direction::Higher, Axis::Seconds, 0.1);
    assert_eq!(labels(&found), ["cheap", "middle", "dear"]);
    let found_standings: Vec<Standing> = standings(&found).into_iter().map(|(_, standing)| standing).collect();
    assert_eq!(found_standings, [On, Worse, On, Unclear, Worse, Unclear, On], "{:?}", standings(&found));
    assert_eq!(found.knee.as_deref(), Some("middle"));
    let steps: Vec<_> = found.prices.iter().map(|price| (price.from.as_str(), price.to.as_str())).collect();
    assert_eq!(steps, [("cheap", "middle"), ("middle", "dear")]);
    Tolerance::F64.assert(found.prices.iter().filter_map(|price| price.secs), [0.1 / 7.0, 0.2], "seconds a tenth");
    Tolerance::F64.assert(found.prices.iter().filter_map(|price| price.gaussians), [100.0 / 7.0, 200.0], "Gaussians");
    // The same with the opposite direction, as for LPIPS.
    let lower = samples.clone().map(|s| Sample { quality: s.quality.map(|quality| -quality), ..s });
    let rotated = frontier(&lower, Direction::Lower, Axis::Seconds, 0.1);
    assert_eq!((labels(&rotated), &rotated.knee, &rotated.prices), (labels(&found), &found.knee, &found.prices));
}

/// Three settings of one cost: the best takes the place of the first, which the second was compared with.
#[test]
fn points_are_compared_with_the_frontier_as_it_is_in_the_end() {
    let samples = [("first", 20.0, 1.0), ("twin", 20.0, 1.02), ("better", 25.0, 1.05), ("dear", 30.0, 2.0)];
    let samples = samples.map(|(label, quality, secs)| measured(label, quality, secs, 0.1));
    let found = frontier_with_intervals(0.1, &samples, Direction::Higher, Axis::Seconds, 0.1);
    assert_eq!(standings(&found), [("first", Worse), ("twin", Worse), ("better", On), ("dear", On)]);
    let against = found.points.iter().filter_map(|point| Some(point.against.as_ref()?.label.as_str()));
    assert_eq!(against.collect::<Vec<_>>(), ["better", "better", "dear", "better"]);
}

/// A point is better only if the interval of the difference excludes 0.
#[test]
fn points_with_overlapping_intervals_are_not_ranked() {
    let samples = [
        sample("cheap", 20.0, 1.0),
        sample("as good", 20.9, 2.0),
        sample("better", 21.1, 3.0),
        sample("perhaps worse", 20.2, 4.0),
        sample("worse", 19.9, 5.0),
        sample("perhaps better", 22.0, 6.0),
        sample("best", 24.0, 9.0),
    ];
    for direction in [Direction::Higher, Direction::Lower] {
        let sign = if direction == Direction::Higher { 1.0 } else { -1.0 };
        let rotated = samples.clone().map(|s| Sample { quality: s.quality.map(|quality| sign * quality), ..s });
        let found = frontier_with_intervals(1.0, &rotated, direction, Axis::Seconds, 0.1);
        let found_standings: Vec<Standing> = standings(&found).into_iter().map(|(_, standing)| standing).collect();
        assert_eq!(found_standings, [On, Unclear, On, Unclear, Worse, Unclear, On], "{direction:?}");
        let against: Vec<&str> =
            found.points.iter().map(|point| point.against.as_ref().unwrap().label.as_str()).collect();
        assert_eq!(against, ["better", "cheap", "cheap", "better", "better", "better", "better"]);
        let difference = found.points[1].against.as_ref().unwrap().difference;
        Tolerance::F64.assert(
            difference.interval.unwrap(),
            [sign * 0.9 - 1.0, sign * 0.9 + 1.0],
            "as good minus cheap",
        );
        let steps: Vec<_> = found.prices.iter().map(|price| (price.from.as_str(), price.to.as_str())).collect();
        assert_eq!(steps, [("cheap", "better"), ("better", "best")]);
        Tolerance::F64.assert(found.prices[0].gain_interval, [0.1, 2.1], "the gain's interval");
        assert_eq!(found.knee, None, "21.1 is less than 1 dB above the line from 20 to 24");
    }
    assert_eq!(labels(&frontier_with_intervals(9.0, &samples, Direction::Higher, Axis::Seconds, 0.1)), ["cheap"]);
    let one_scene = |_: &[(usize, f64)]| Some(Contrast { value: 5.0, interval: None, scenes: 1, unpaired: 0 });
    let found = super::frontier(&samples, &one_scene, Direction::Higher, Axis::Seconds, 0.1);
    assert_eq!(
        (labels(&found), found.prices.len(), &found.knee),
        (vec!["cheap"], 0, &None),
        "one scene has no interval"
    );
}

#[test]
fn times_within_the_measurement_error_are_equal() {
    let samples = |error| {
        [("a", 20.0, 1.0), ("b", 22.0, 1.1), ("c", 24.0, 2.0)]
            .map(|(label, quality, secs)| measured(label, quality, secs, error))
    };
    let found = frontier(&samples(0.01), Direction::Higher, Axis::Seconds, 0.1);
    assert_eq!(labels(&found), ["a", "b", "c"]);
    let found = frontier(&samples(0.08), Direction::Higher, Axis::Seconds, 0.1);
    assert_eq!(labels(&found), ["b", "c"], "0.1 s is within √2 · 0.08 s: at equal cost the better point wins");
    assert_eq!(found.points[0].standing, Worse);
    assert_eq!(found.points[0].against.as_ref().unwrap().label, "b");
    let counts = frontier(&samples(0.08), Direction::Higher, Axis::Gaussians, 0.1);
    assert_eq!(labels(&counts), ["a", "b", "c"], "counts are exact");
    assert!(counts.prices[0].secs.is_none() && counts.prices[1].secs.is_some(), "no price in equal times");
}

#[test]
fn frontiers_of_few_or_invalid_points() {
    let none = frontier(&[], Direction::Higher, Axis::Seconds, 0.1);
    assert_eq!((none.points.len(), none.prices.len(), none.knee), (0, 0, None));
    let one = frontier(&[sample("one", 20.0, 1.0)], Direction::Higher, Axis::Gaussians, 0.1);
    assert_eq!((labels(&one), one.prices.len(), &one.knee), (vec!["one"], 0, &None));
    let two = frontier(&[sample("a", 20.0, 1.0), sample("b", 21.0, 2.0)], Direction::Higher, Axis::Seconds, 0.1);
    assert_eq!((labels(&two), two.prices.len(), &two.knee), (vec!["a", "b"], 1, &None));
    let broken = [
        sample("good", 20.0, 1.0),
        sample("quality", f64::NAN, 0.5),
        sample("cost", 30.0, f64::INFINITY),
        sample("free", 30.0, 0.0),
        Sample { secs: Err("no timing pass".to_owned()), ..sample("untimed", 30.0, 1.0) },
        Sample { quality: Err("no target".to_owned()), ..sample("unscored", 30.0, 0.1) },
    ];
    let found = frontier(&broken, Direction::Higher, Axis::Seconds, 0.1);
    assert_eq!(labels(&found), ["good"]);
    let left_out: Vec<_> = found.left_out.iter().map(|(label, reason)| format!("{label}: {reason}")).collect();
    let expected = [
        "quality: nothing was scored",
        "cost: inf seconds",
        "free: 0 seconds",
        "untimed: no timing pass",
        "unscored: nothing was scored: no target",
    ];
    assert_eq!(left_out, expected);
}

#[test]
fn a_straight_or_sagging_frontier_has_no_knee() {
    let points = |middle| [sample("a", 20.0, 1.0), sample("b", middle, 10.0), sample("c", 24.0, 100.0)];
    let knee = |middle| frontier(&points(middle), Direction::Higher, Axis::Seconds, 0.1).knee;
    assert_eq!(knee(20.5), None, "sagging");
    assert_eq!(knee(23.5).as_deref(), Some("b"));
}

/// The line runs from 20 to 26 over the logarithm of the seconds: its height is 20.9 at 2 s, 23 at 10 s and 24.4 at 30 s.
#[test]
fn the_knee_is_the_point_farthest_above_the_line() {
    let knee = |points: &[(f64, f64)]| {
        let ends = [(1.0, 20.0), (100.0, 26.0)];
        let points = points.iter().chain(&ends).map(|(secs, quality)| sample(&format!("{secs} s"), *quality, *secs));
        frontier(&points.collect::<Vec<_>>(), Direction::Higher, Axis::Seconds, 0.1).knee
    };
    assert_eq!(knee(&[(2.0, 22.5), (30.0, 24.2)]).as_deref(), Some("2 s"));
    assert_eq!(knee(&[(30.0, 22.0)]), None);
    assert_eq!(knee(&[(2.0, 21.5), (10.0, 25.0)]).as_deref(), Some("10 s"));
    assert_eq!(knee(&[(2.0, 24.0), (10.0, 25.0)]).as_deref(), Some("2 s"));
}

proptest! {
    /// The definition of a Pareto frontier, for every order of the samples.
    #[test]
    fn frontier_points_are_not_dominated(
        places in prop::collection::vec((0u8..8, 1u8..8), 0..12),
        rotation in 0usize..12,
    ) {
        let mut samples: Vec<Sample> = places
            .iter()
            .enumerate()
            .map(|(at, (quality, secs))| sample(&format!("{at:02}"), f64::from(*quality), f64::from(*secs)))
            .collect();
        let found = frontier(&samples, Direction::Higher, Axis::Seconds, 0.1);
        for (position, point) in found.points.iter().enumerate() {
            let (quality, secs) = (point.quality, point.cost);
            let dominates = |other: &&Point| {
                other.quality >= quality && other.cost <= secs && (other.quality > quality || other.cost < secs)
            };
            // Of equal points only the first is on the frontier.
            let twin = found.points[..position].iter().any(|other| (other.quality, other.cost) == (quality, secs));
            prop_assert_eq!(point.on_frontier(), !twin && !found.points.iter().any(|other| dominates(&other)));
        }
        let by = rotation.checked_rem(samples.len()).unwrap_or(0);
        samples.rotate_left(by);
        let rotated = frontier(&samples, Direction::Higher, Axis::Seconds, 0.1);
        prop_assert_eq!(standings(&rotated), standings(&found));
    }
}

#[test]
fn samples_summarise_a_store() {
    let mut store = results("a", "psnr", &[("x", 0, vec![20.0, 22.0]), ("y", 0, vec![30.0])]);
    let mut failed = results("failed", "psnr", &[("x", 0, vec![0.0; 2])]);
    failed.trials[0].status = TrialStatus::Failed;
    for row in &mut failed.targets {
        row.status = TargetStatus::Failed;
        row.scores.clear();
    }
    store.trials.extend(failed.trials);
    store.targets.extend(failed.targets);
    for name in ["a", "never ran", "failed"] {
        store.provenance.methods.push(MethodRecord { name: name.to_owned(), ..MethodRecord::default() });
    }
    store.timings = vec![timing("a", "x", &[0.5, 0.5, 0.9], &[0.01, 0.01])];
    let found =
        scored(&store, machine_of(&store, PRESET).as_ref(), PRESET, "psnr", Leaked::Included, Aggregation::SceneMeans);
    let [Scored { sample, .. }, Scored { sample: failed, .. }] = &found[..] else { panic!("{found:?}") };
    assert_eq!([&sample.label, &failed.label], ["a", "failed"], "one that failed is not dropped");
    assert_eq!((failed.quality.is_err(), failed.gaussians), (true, None));
    let secs = sample.secs.as_ref().unwrap().median;
    let values = [*sample.quality.as_ref().unwrap(), secs, sample.gaussians.unwrap()];
    Tolerance::F64.assert(values, [25.5, 0.51, 23_040.0], "quality, seconds, Gaussians");
    Tolerance::EXACT.assert([quality_step("psnr"), quality_step("lpips")], [0.1, 0.01], "steps");
}

#[test]
fn targets_that_methods_were_given_are_counted_or_left_out() {
    let mut store = results("a", "psnr", &[("x", 0, vec![20.0, 22.0, 60.0]), ("y", 0, vec![30.0])]);
    store.targets[2].leaked = true;
    store.timings.push(timing("a", "x", &[0.5], &[]));
    store.provenance.methods.push(MethodRecord { name: "a".to_owned(), ..MethodRecord::default() });
    store.provenance.presets.push(preset_record(PRESET));
    let said = "sampled: 1 of 4 targets are context views";
    for (leaked, targets, given, quality, is_said) in
        [(Leaked::Included, 4, 1, 32.0, true), (Leaked::Excluded, 3, 0, 25.5, false)]
    {
        let found = tradeoffs(&store, &["psnr"], leaked).unwrap();
        assert_eq!((found[0].targets, found[0].leaked), (targets, given));
        Tolerance::F64.assert([found[0].frontiers[0].points[0].quality], [quality], "mean over scenes");
        let text = TradeoffReport { tradeoffs: found, unfinished: Vec::new() }.to_string();
        assert_eq!(text.contains(said), is_said, "{text}");
    }
}

/// Two that lose different targets are both named, as is one whose rows are missing; one without a mean has another reason.
#[test]
fn settings_with_fewer_scored_targets_are_named() {
    let scenes = [("x", 0, vec![30.0, 32.0]), ("y", 0, vec![20.0])];
    let mut store = Results::default();
    for name in ["whole", "half", "unfinished", "broken"] {
        let rows = results(name, "psnr", if name == "unfinished" { &scenes[1..] } else { &scenes[..] });
        store.trials.extend(rows.trials);
        store.targets.extend(rows.targets.into_iter().map(|row| {
            let status = match (name, row.key.scene.as_str(), row.target) {
                ("broken", ..) | ("half", "y", _) => TargetStatus::Failed,
                ("half", "x", 1) => TargetStatus::NonFinite,
                _ => row.status,
            };
            TargetRow { status, ..row }
        }));
        store.provenance.methods.push(MethodRecord { name: name.to_owned(), ..MethodRecord::default() });
    }
    store.provenance.presets.push(preset_record(PRESET));
    let tradeoffs = tradeoffs(&store, &["psnr"], Leaked::Included).unwrap();
    let of = |label: &str, counts| Incomplete { label: label.to_owned(), counts, of_scenes: 2, of_targets: 3 };
    let one = Counts { scenes: 1, targets: 1, ..Counts::default() };
    let half = of("half", Counts { failed: 1, non_finite: 1, ..one });
    assert_eq!(tradeoffs[0].incomplete, [half, of("unfinished", one)]);
    // The row that is missing was never written.
    store.provenance.presets[0].entries = 2;
    let report = TradeoffReport { tradeoffs, unfinished: store.interrupted() };
    let text = report.to_string();
    let ended = format!("{PRESET}: the run of unfinished is unfinished: its means are over 1 of 2 index entries\n");
    assert!(text.ends_with(&ended), "{text}");
    let why = "its mean is over fewer targets than the others'\n";
    for line in
        ["half: 1 of 2 scenes, 1 of 3 targets (1 failed, 1 not finite)", "unfinished: 1 of 2 scenes, 1 of 3 targets"]
    {
        assert!(text.contains(&format!("\n  {line}: {why}")), "{line}: {text}");
    }
    assert_eq!(text.matches(why).count(), 2, "{text}");
    assert!(text.contains("from half, without 2 targets that only one of them has"), "{text}");
    let json = serde_json::to_value(&report).unwrap();
    let half = &json["tradeoffs"][0]["incomplete"][0];
    assert_eq!(
        ["scenes", "of-scenes", "failed", "non-finite"].map(|count| half[count].as_u64().unwrap()),
        [1, 2, 1, 1]
    );
}

/// Copies the first trial, target and timing to another protocol.
fn copy_first_to(store: &mut Results, preset: &str) {
    let key = TrialKey { preset: preset.to_owned(), ..store.targets[0].key.clone() };
    store.targets.push(TargetRow { key: key.clone(), ..store.targets[0].clone() });
    store.timings.push(TimingRow { key: key.clone(), ..store.timings[0].clone() });
    store.trials.push(TrialRow { key, ..store.trials[0].clone() });
}

/// Most trials were timed on the fast machine, but both protocols on the slow one.
#[test]
fn protocols_are_compared_on_one_machine() {
    let scenes = [("x", 0, vec![20.0]), ("y", 0, vec![24.0])];
    let mut store = results("a", "psnr", &scenes);
    let only_fast = results("b", "psnr", &scenes);
    let on = |processor: &str, method: &str, scene: &str, secs: f64| {
        let row = timing(method, scene, &[secs], &[]);
        TimingRow { machine: Machine { processor: processor.to_owned(), ..row.machine }, ..row }
    };
    store.timings = vec![on("slow", "a", "x", 4.0)];
    copy_first_to(&mut store, "other");
    store.timings.extend([on("fast", "a", "x", 0.5), on("fast", "a", "y", 0.5), on("fast", "b", "x", 0.25)]);
    store.trials.extend(only_fast.trials);
    store.targets.extend(only_fast.targets);
    store.provenance.presets.extend([PRESET, "other"].map(preset_record));
    let record = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
    store.provenance.methods.extend(["a", "b"].map(record));
    let found = across(&store, "psnr", Leaked::Included).unwrap();
    assert_eq!(found.machines.iter().map(|machine| machine.processor.as_str()).collect::<Vec<_>>(), ["slow"]);
    let seconds = &found.frontiers[0];
    let secs: Vec<_> = seconds.points.iter().map(|point| (point.label.as_str(), point.cost)).collect();
    assert_eq!(secs, [("a, sampled", 4.0), ("a, other", 4.0)], "at equal cost the better first");
    let [(label, why)] = &seconds.left_out[..] else { panic!("{:?}", seconds.left_out) };
    assert_eq!((label.as_str(), why.starts_with("timed on another machine: fast, ")), ("b, sampled", true), "{why}");
    // Each protocol alone has the machine with most of its trials.
    let apart = tradeoffs(&store, &["psnr"], Leaked::Included).unwrap();
    assert_eq!([0, 1].map(|at: usize| apart[at].machines[0].processor.as_str()), ["fast", "slow"]);
}

/// Both take half a second, of which the process needs a part for its files.
#[test]
fn times_of_whole_answers_are_marked() {
    let mut store = results("a", "psnr", &[("x", 0, vec![20.0])]);
    let other = results("b", "psnr", &[("x", 0, vec![21.0])]);
    store.trials.extend(other.trials);
    store.targets.extend(other.targets);
    store.timings.extend(["a", "b"].map(|method| timing(method, "x", &[0.5], &[])));
    store.provenance.presets.push(preset_record(PRESET));
    let record = |name: &str, kind: &str| MethodRecord {
        name: name.to_owned(),
        kind: kind.to_owned(),
        ..MethodRecord::default()
    };
    store.provenance.methods.extend([record("a", "exec"), record("b", "atsplat")]);
    let tradeoffs = tradeoffs(&store, &["psnr"], Leaked::Included).unwrap();
    let marked: Vec<_> =
        tradeoffs[0].frontiers[0].points.iter().map(|point| (point.label.as_str(), point.whole_answer)).collect();
    assert_eq!(marked, [("b", false), ("a", true)]);
    let printed = TradeoffReport { tradeoffs, unfinished: Vec::new() }.to_string();
    assert!(printed.contains("500.0 ±0.0‡") && printed.contains("500.0 ±0.0 "), "{printed}");
    assert!(printed.contains("‡ The whole answer of a process"), "{printed}");
}

#[test]
fn protocols_share_a_frontier_only_on_request() {
    let mut store = results("a", "psnr", &[("x", 0, vec![20.0])]);
    store.timings.push(timing("a", "x", &[0.5], &[]));
    copy_first_to(&mut store, "other");
    store.provenance.methods.push(MethodRecord { name: "a".to_owned(), ..MethodRecord::default() });
    store.provenance.presets.extend([PRESET, "other"].map(preset_record));
    let apart = tradeoffs(&store, &["psnr"], Leaked::Included).unwrap();
    assert_eq!(apart.iter().map(|found| found.frontiers[0].points.len()).collect::<Vec<_>>(), [1, 1]);
    let found = across(&store, "psnr", Leaked::Included).unwrap();
    let standings: Vec<_> =
        found.frontiers[0].points.iter().map(|point| (point.label.as_str(), point.standing)).collect();
    assert_eq!(standings, [("a, other", On), ("a, sampled", Unclear)], "one scene has no interval");
    assert!(found.frontiers[0].points[1].against.is_some() && found.incomplete.is_empty(), "of the same frame");
    store.targets[1].frame = 7;
    let found = across(&store, "psnr", Leaked::Included).unwrap();
    assert_eq!(found.frontiers[0].points[1].against, None, "another frame at the same position");
    assert_eq!(found.incomplete.iter().map(|setting| setting.of_targets).collect::<Vec<_>>(), [2, 2]);
    // A protocol that cannot be parsed must not silently change how its scores are averaged.
    store.provenance.presets[1].toml = store.provenance.presets[1].toml.replace("aggregation", "agregation");
    let message =
        [tradeoffs(&store, &["psnr"], Leaked::Included).map(drop), across(&store, "psnr", Leaked::Included).map(drop)];
    for message in message.map(|outcome| outcome.unwrap_err().to_string()) {
        assert!(message.contains("presets, other, toml") && message.contains("agregation"), "{message}");
    }
}

/// Each protocol's methods in their order, of which one is the other's too.
#[test]
fn the_methods_of_all_protocols_are_named_with_their_adapter() {
    let of = |preset: &str, labels: [&str; 2]| Tradeoff {
        preset: preset.to_owned(),
        protocol: String::new(),
        metric: "psnr".to_owned(),
        unit: String::new(),
        targets: 1,
        leaked: 0,
        frontiers: Vec::new(),
        machines: Vec::new(),
        incomplete: Vec::new(),
        unscored: Vec::new(),
        notes: Vec::new(),
        devices: [("renderer on a card".to_owned(), labels.map(str::to_owned).to_vec())].into(),
    };
    let tradeoffs = vec![of("x", ["b", "c"]), of("y", ["a", "b"])];
    let text = TradeoffReport { tradeoffs, unfinished: Vec::new() }.to_string();
    assert!(text.contains("\nb, c, a: renderer on a card.\n"), "{text}");
}
