mod aggregation;
mod trend;

use atsplat_metrics::DECIBEL_CAP;
use atsplat_numeric::{SplitMix64, Tolerance};
use atsplat_protocol::{Aggregation, BinRule, OverlapBins};
use atsplat_tests::on_threads;
use serde::Deserialize;

use super::bootstrap::interval_of_resamples;
use super::significance::{normal_tail, student_quantile};
use super::*;
use crate::sample_rows::{PRESET, key, results, target, trial};
use crate::{MethodRecord, Results, StatedCost, TargetStatus, TrialStatus};

/// Reference values of numpy and scipy (`oracle/make_statistics.py`).
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Oracle {
    intervals: Vec<Resampled>,
    sign_tests: Vec<(u64, u64, f64)>,
    student_quantiles: Vec<(usize, f64, f64)>,
    normal_tails: Vec<(f64, f64)>,
}

#[derive(Deserialize)]
struct Resampled {
    clusters: Vec<[f64; 2]>,
    resamples: usize,
    interval: [f64; 2],
}

fn oracle() -> Oracle {
    serde_json::from_str(include_str!("../../tests/fixtures/statistics.json")).unwrap()
}

fn query(method: &str) -> MetricQuery<'_> {
    let (leaked, identical) = (Leaked::Included, Identical::Excluded);
    MetricQuery { preset: PRESET, method, metric: "psnr", leaked, identical }
}

fn psnr(scenes: &[(&str, u32, Vec<f64>)]) -> Results {
    results("m", "psnr", scenes)
}

#[test]
fn intervals_and_tests_agree_with_scipy() {
    let Oracle { intervals, sign_tests, student_quantiles, normal_tails } = oracle();
    for Resampled { clusters, resamples, interval } in intervals {
        let found = interval_of_resamples(&clusters, resamples).unwrap();
        Tolerance::relative(1e-12).assert(found, interval, &format!("interval of {} clusters", clusters.len()));
    }
    for (wins, losses, expected) in sign_tests {
        Tolerance::relative(1e-10).assert([sign_test(wins, losses)], [expected], &format!("{wins} to {losses}"));
    }
    for (freedom, probability, expected) in student_quantiles {
        let found = student_quantile(probability, freedom);
        Tolerance::relative(1e-10).assert([found], [expected], &format!("t of {freedom} at {probability}"));
    }
    for (value, expected) in normal_tails {
        Tolerance::relative(1e-10).assert([normal_tail(value)], [expected], &format!("beyond {value}"));
    }
    Tolerance::EXACT.assert([sign_test(0, 0)], [1.0], "no games");
}

/// The ATSplat paper's overlap table: bin means over NoPoSplat's scenes, and the printed average of four methods.
#[test]
fn published_averages_follow_from_published_bins() {
    let table = [
        ("pixelSplat", [20.28, 23.73, 27.15], 23.86),
        ("MVSplat", [20.37, 23.81, 27.47], 24.01),
        ("DepthSplat", [22.82, 25.38, 28.32], 25.59),
        ("iLRM", [23.82, 26.54, 29.43], 26.70),
    ];
    let bins = OverlapBins::noposplat(BinRule::Published);
    for (method, means, average) in table {
        let mut store = Results::default();
        for ((mean, overlap), count) in means.into_iter().zip([0.2, 0.4, 0.7]).zip([1403, 2568, 1630]) {
            for scene in 0..count {
                let scene = format!("{overlap} {scene:04}");
                let rows = [mean - 1.5, mean, mean + 1.5].into_iter().zip(0..);
                store.targets.extend(rows.map(|(score, at)| crate::TargetRow {
                    overlap: Some(overlap),
                    ..target(method, &scene, 0, at, "psnr", score)
                }));
            }
        }
        // Of one method with intervals, because resampling thousands of scenes takes long.
        let binned = if method == "pixelSplat" {
            by_overlap(&store, &query(method), &bins, Aggregation::SceneMeans)
        } else {
            let mean = |chosen: &[SelectedTarget<'_>]| summary_without_interval(chosen, Aggregation::SceneMeans);
            breakdown::binned(&select(&store, &query(method)), &bins, mean)
        };
        let found = binned.average.mean.unwrap();
        Tolerance::absolute(0.005).assert([found], [average], method);
        let of_bins = binned.bins.iter().map(|(_, summary)| summary.mean.unwrap());
        Tolerance::absolute(1e-9).assert(of_bins.clone(), means, "bins");
        assert!((of_bins.sum::<f64>() / 3.0 - average).abs() > 0.05, "the mean of bins is another number");
        let counts: Vec<_> = binned.bins.iter().map(|(name, summary)| (name.as_str(), summary.scenes)).collect();
        assert_eq!(counts, [("small", 1403), ("medium", 2568), ("large", 1630)]);
        assert_eq!((binned.average.scenes, binned.average.targets, binned.ignored), (5601, 16_803, 0));
    }
}

#[test]
fn scene_means_and_image_means_differ() {
    let uneven = psnr(&[("a", 0, vec![20.0]), ("b", 0, vec![30.0, 30.0, 30.0]), ("c", 0, vec![40.0, 20.0])]);
    let scenes = summary(&uneven, &query("m"), Aggregation::SceneMeans);
    let images = summary(&uneven, &query("m"), Aggregation::AllImages);
    Tolerance::F64.assert(scenes.mean, [80.0 / 3.0], "scenes");
    Tolerance::F64.assert(images.mean, [170.0 / 6.0], "images");
    assert_eq!((scenes.scenes, scenes.targets, images.targets), (3, 6, 6));
    // latentSplat's index: each entry of a scene has a vote, and the scene is still one cluster.
    let entries = psnr(&[("a", 0, vec![10.0]), ("a", 1, vec![20.0, 40.0]), ("b", 0, vec![30.0])]);
    Tolerance::F64.assert(summary(&entries, &query("m"), Aggregation::SceneMeans).mean, [70.0 / 3.0], "entries");
    let of_scenes = scene_means(&entries, &query("m"));
    assert_eq!(of_scenes.iter().map(|s| (s.scene.as_str(), s.targets)).collect::<Vec<_>>(), [("a", 3), ("b", 1)]);
    Tolerance::F64.assert(of_scenes.iter().map(|s| s.mean), [20.0, 30.0], "scene means");
}

#[test]
fn missing_scores_are_counted_and_never_averaged() {
    let mut store =
        psnr(&[("a", 0, vec![20.0, f64::NAN, 22.0]), ("b", 0, vec![f64::INFINITY, 30.0]), ("c", 0, vec![0.0; 4])]);
    for (row, status) in store.targets.iter_mut().skip(5).zip([
        TargetStatus::Identical,
        TargetStatus::NonFinite,
        TargetStatus::Failed,
        TargetStatus::Identical,
    ]) {
        row.status = status;
        row.scores.clear();
    }
    store.targets[8].not_computed.insert("psnr".to_owned(), "too small".to_owned());
    let capped = MetricQuery { identical: Identical::Capped, ..query("m") };
    let found = summary(&store, &capped, Aggregation::SceneMeans);
    Tolerance::F64.assert(found.mean, [(21.0 + 30.0 + DECIBEL_CAP) / 3.0], "mean");
    assert_eq!((found.scenes, found.targets, found.identical), (3, 4, 1));
    assert_eq!((found.non_finite, found.failed, found.uncomputed), (3, 1, 1));
    assert_eq!(found.not_computed.as_deref(), Some("too small"));
    let absent = summary(&store, &MetricQuery { metric: "lpips", ..query("m") }, Aggregation::SceneMeans);
    assert_eq!((absent.mean, absent.interval, absent.uncomputed), (None, None, 7), "an absent metric is not capped");
    assert!(absent.not_computed.unwrap().contains("not among"));
    assert_eq!(summary(&store, &query("other"), Aggregation::SceneMeans), Summary::default());
}

/// Of five targets without a score, two are of a trial that the method does not support.
#[test]
fn targets_of_unsupported_trials_are_told_apart_from_failed_ones() {
    let mut store = psnr(&[("a", 0, vec![0.0; 3]), ("b", 0, vec![0.0; 2]), ("c", 0, vec![20.0])]);
    store.trials[0].status = TrialStatus::Failed;
    store.trials[1].status = TrialStatus::NotApplicable;
    for row in &mut store.targets[..5] {
        row.status = TargetStatus::Failed;
        row.scores.clear();
    }
    let found = summary(&store, &query("m"), Aggregation::SceneMeans);
    assert_eq!((found.failed, found.not_applicable, found.targets), (3, 2, 1));
}

/// Images that are identical after rounding: the row has the reason instead of a number.
#[test]
fn infinite_scores_of_one_metric_count_as_the_cap() {
    let mut store = results("m", "psnr-8bit-truncated", &[("a", 0, vec![20.0, 0.0])]);
    store.targets[1].scores.clear();
    store.targets[1].not_computed.insert("psnr-8bit-truncated".to_owned(), "identical".to_owned());
    let of = MetricQuery { metric: "psnr-8bit-truncated", identical: Identical::Capped, ..query("m") };
    let found = summary(&store, &of, Aggregation::SceneMeans);
    Tolerance::F64.assert(found.mean, [f64::midpoint(20.0, DECIBEL_CAP)], "mean");
    assert_eq!((found.identical, found.uncomputed), (1, 0));
}

#[test]
fn leaked_targets_can_be_excluded() {
    let mut store = psnr(&[("a", 0, vec![20.0, 90.0]), ("b", 0, vec![90.0])]);
    store.targets[1].leaked = true;
    store.targets[2].leaked = true;
    let clean = MetricQuery { leaked: Leaked::Excluded, ..query("m") };
    Tolerance::F64.assert(summary(&store, &query("m"), Aggregation::SceneMeans).mean, [72.5], "with");
    let without = summary(&store, &clean, Aggregation::SceneMeans);
    Tolerance::F64.assert(without.mean, [20.0], "without");
    assert_eq!((without.scenes, without.targets, without.interval), (1, 1, None));
}

#[test]
fn pairs_match_targets_and_respect_the_metrics_direction() {
    let mut store = results(
        "a",
        "lpips",
        &[("x", 0, vec![0.1, 0.2]), ("y", 0, vec![0.4]), ("z", 0, vec![0.3]), ("w", 1, vec![9.0])],
    );
    let b = results("b", "lpips", &[("x", 0, vec![0.2, 0.2]), ("y", 0, vec![0.3]), ("z", 0, vec![0.3, 0.9])]);
    store.trials.extend(b.trials.clone());
    store.targets.extend(b.targets.clone());
    let of = |method| MetricQuery { metric: "lpips", ..query(method) };
    let found = paired(&store, &of("a"), &of("b"), Aggregation::SceneMeans).unwrap();
    Tolerance::F64.assert([found.difference], [(-0.05 + 0.1 + 0.0) / 3.0], "difference");
    assert_eq!((found.wins, found.ties, found.losses, found.scenes), (1, 1, 1, 3));
    assert_eq!((found.targets, found.unpaired), (4, 2));
    Tolerance::EXACT.assert([found.sign_test], [1.0], "sign test");
    let swapped = paired(&store, &of("b"), &of("a"), Aggregation::SceneMeans).unwrap();
    Tolerance::EXACT.assert([swapped.difference], [-found.difference], "swapped");
    assert_eq!(paired_between((&store, &of("a")), (&b, &of("b")), Aggregation::SceneMeans), Some(found));
    assert_eq!(paired(&store, &of("a"), &of("unknown"), Aggregation::SceneMeans), None);
    // Without the target of z that b alone has.
    let means = paired_scene_means(&store, &of("a"), &of("b"), Aggregation::SceneMeans);
    assert_eq!(means.iter().map(|(scene, _)| scene.as_str()).collect::<Vec<_>>(), ["x", "y", "z"]);
    let means = means.iter().flat_map(|(_, means)| *means);
    Tolerance::F64.assert(means, [0.15, 0.2, 0.4, 0.3, 0.3, 0.3], "means of a and of b");
}

/// Three scenes of four with more of the metric, one with less: three wins where higher is better, one where lower is.
#[test]
fn wins_follow_the_metrics_direction() {
    for (metric, expected) in [
        ("psnr", [3, 0, 1]),
        ("ssim", [3, 0, 1]),
        ("lpips", [1, 0, 3]),
        ("st-lpips", [1, 0, 3]),
        ("l1", [1, 0, 3]),
        ("depth-error", [1, 0, 3]),
    ] {
        let scenes = ["w", "x", "y", "z"].map(|scene| (scene, 0, vec![0.5]));
        let b = results("b", metric, &scenes);
        let mut a = results("a", metric, &scenes);
        for (row, by) in a.targets.iter_mut().zip([0.1, 0.1, 0.1, -0.2]) {
            row.scores.values_mut().for_each(|score| *score += by);
        }
        let of = |method| MetricQuery { metric, ..query(method) };
        let found = paired_between((&a, &of("a")), (&b, &of("b")), Aggregation::SceneMeans).unwrap();
        assert_eq!([found.wins, found.ties, found.losses], expected, "{metric}");
        Tolerance::F64.assert([found.difference], [0.025], "the difference has no direction");
        let swapped = paired_between((&b, &of("b")), (&a, &of("a")), Aggregation::SceneMeans).unwrap();
        assert_eq!([swapped.losses, swapped.ties, swapped.wins], expected, "{metric}, swapped");
        // Of four fair coins, one or fewer (or three or more) of a side: 2 · (1 + 4) / 16.
        Tolerance::F64.assert([found.sign_test, swapped.sign_test], [0.625; 2], "sign test");
    }
}

#[test]
fn distances_are_means_over_scenes() {
    let mut store = psnr(&[("a", 0, vec![20.0, 22.0, 10.0]), ("b", 0, vec![30.0])]);
    for (row, distance) in store.targets.iter_mut().zip([-1, -1, 2, -1]) {
        row.signed_distance = distance;
    }
    let found = by_distance_steps(&store, &query("m"), 1, Aggregation::SceneMeans);
    Tolerance::F64.assert(found.iter().map(|(distance, _)| *distance), [-1.0, 2.0], "distances");
    assert_eq!(found.iter().map(|(_, s)| (s.scenes, s.targets)).collect::<Vec<_>>(), [(2, 3), (1, 1)]);
    Tolerance::F64.assert(found.iter().filter_map(|(_, s)| s.mean), [25.5, 10.0], "means");
}

#[test]
fn steps_of_distance_begin_at_the_window_on_either_side() {
    let mut store = psnr(&[("a", 0, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0])]);
    for (row, distance) in store.targets.iter_mut().zip([-6, -5, 0, 1, 5, 6]) {
        row.signed_distance = distance;
    }
    let found = by_distance_steps(&store, &query("m"), 5, Aggregation::SceneMeans);
    // −6 to −10, −1 to −5, the window, 1 to 5, 6 to 10.
    Tolerance::F64.assert(found.iter().map(|(middle, _)| *middle), [-8.0, -3.0, 0.0, 3.0, 8.0], "middles");
    Tolerance::F64.assert(found.iter().filter_map(|(_, s)| s.mean), [1.0, 2.0, 3.0, 4.5, 6.0], "means");
    let each: Vec<f64> = by_distance_steps(&store, &query("m"), 1, Aggregation::SceneMeans)
        .into_iter()
        .map(|(middle, _)| middle)
        .collect();
    Tolerance::F64.assert(each, [-6.0, -5.0, 0.0, 1.0, 5.0, 6.0], "steps of one frame");
}

#[test]
fn worst_scenes_follow_the_metrics_direction() {
    let scenes = [("a", 0, vec![0.3]), ("b", 0, vec![0.1]), ("c", 0, vec![0.3])];
    let names = |metric: &str| {
        let query = MetricQuery { metric, ..query("m") };
        worst(&results("m", metric, &scenes), &query, 2).into_iter().map(|s| s.scene).collect::<Vec<_>>()
    };
    assert_eq!(names("psnr"), ["b", "a"]);
    assert_eq!(names("lpips"), ["a", "c"]);
    assert_eq!(names("depth-error"), ["a", "c"]);
}

#[test]
fn cost_is_means_and_extremes() {
    let mut store = psnr(&[("a", 0, vec![1.0]), ("b", 0, vec![1.0]), ("c", 0, vec![1.0]), ("d", 0, vec![1.0])]);
    for (row, gaussians) in store.trials.iter_mut().zip([10, 20, 60, 30]) {
        row.gaussians = Some(gaussians);
    }
    store.trials[1].peak_bytes = Some(3 << 20);
    store.trials[3].status = TrialStatus::Partial;
    let mut failed = trial("m", "e", 0, 1);
    (failed.status, failed.gaussians, failed.key) = (TrialStatus::Failed, Some(1000), key("m", "e", 0));
    store.trials.push(failed);
    let found = cost(&store, PRESET, "m");
    assert_eq!((found.trials, found.failed, found.gaussians_min, found.gaussians_max), (4, 1, Some(10), Some(60)));
    Tolerance::F64.assert(found.gaussians, [30.0], "mean Gaussians");
    assert_eq!(found.peak_bytes, Some(3 << 20), "the largest");
    let stated = [(PRESET, 5), ("other", 9000)]
        .map(|(preset, count)| (preset.to_owned(), StatedCost { gaussians: Some(count), seconds: None }));
    let method = MethodRecord { name: "m".to_owned(), stated: stated.into(), ..MethodRecord::default() };
    store.provenance.methods = vec![method];
    store.trials[0].gaussians = None;
    let found = cost(&store, PRESET, "m");
    assert_eq!((found.gaussians_min, found.gaussians_max), (Some(20), Some(60)), "a stated mean is no extreme");
    Tolerance::F64.assert(found.gaussians, [28.75], "stated for this preset, and counted");
    assert_eq!(cost(&store, PRESET, "unknown"), Cost::default());
    store.trials[1].gaussians_drawn = Some(f64::NAN);
    assert!(cost(&store, PRESET, "m").gaussians_drawn.is_some_and(f64::is_nan), "it is not left out");
}

#[test]
fn intervals_need_two_scenes_and_finite_numbers() {
    assert_eq!(interval_of_mean(&[]), None);
    assert_eq!(interval_of_mean(&[[20.0, 1.0]]), None);
    assert_eq!(interval_of_mean(&[[20.0, 1.0], [f64::NAN, 1.0]]), None);
    assert_eq!(interval_of_mean(&[[20.0, 1.0], [20.0, 0.0]]), None);
    Tolerance::EXACT.assert(interval_of_mean(&[[20.0, 1.0]; 5]).unwrap(), [20.0; 2], "no spread");
}

#[test]
fn intervals_do_not_depend_on_threads() {
    let mut random = SplitMix64::new(3);
    let clusters: Vec<[f64; 2]> = (0..50).map(|_| [20.0 + 10.0 * random.unit(), 1.0]).collect();
    let interval = || interval_of_mean(&clusters).unwrap();
    Tolerance::EXACT.assert(on_threads(1, interval), on_threads(7, interval), "threads");
}

/// Coverage of 95 % intervals over samples of normal and of skewed scenes.
#[test]
fn intervals_have_their_nominal_coverage() {
    let mut random = SplitMix64::new(11);
    let normal = |random: &mut SplitMix64| (0..12).map(|_| random.unit()).sum::<f64>() - 6.0;
    let exponential = |random: &mut SplitMix64| -(1.0 - random.unit()).ln() - 1.0;
    let samples = 500;
    for (name, draw, scenes, least) in [
        ("normal", &normal as &dyn Fn(&mut SplitMix64) -> f64, 8, 0.92),
        ("normal", &normal, 20, 0.93),
        ("normal", &normal, 100, 0.93),
        ("exponential", &exponential, 20, 0.89),
        ("exponential", &exponential, 100, 0.92),
    ] {
        let mut held = 0;
        for _ in 0..samples {
            let clusters: Vec<[f64; 2]> = (0..scenes).map(|_| [draw(&mut random), 1.0]).collect();
            let [low, high] = interval_of_resamples(&clusters, 1000).unwrap();
            held += u32::from(low <= 0.0 && 0.0 <= high);
        }
        let coverage = f64::from(held) / f64::from(samples);
        println!("{name}, {scenes} scenes: {coverage}");
        assert!((least..=0.985).contains(&coverage), "{name}, {scenes} scenes: {coverage}");
    }
}

/// Two targets of three are identical to the truth: one of PSNR 100 dB would lift the mean of its scene by 40 dB.
#[test]
fn identical_targets_are_counted_and_left_out_of_every_mean() {
    let mut store = psnr(&[("a", 0, vec![20.0, 0.0]), ("b", 0, vec![0.0]), ("c", 0, vec![26.0, 28.0])]);
    for row in [1, 2] {
        store.targets[row].status = TargetStatus::Identical;
        store.targets[row].scores = [("ssim".to_owned(), 1.0)].into();
    }
    store.targets[0].scores.insert("ssim".to_owned(), 0.5);
    let of = |identical, metric| {
        let found = summary(&store, &MetricQuery { metric, identical, ..query("m") }, Aggregation::SceneMeans);
        (found.mean, [found.scenes, found.targets, found.identical])
    };
    for (identical, metric, expected, counts) in [
        // Scene b has no other target.
        (Identical::Excluded, "psnr", 23.5, [2, 3, 2]),
        (Identical::Capped, "psnr", (60.0 + DECIBEL_CAP + 27.0) / 3.0, [3, 5, 2]),
        // The same targets for every metric.
        (Identical::Excluded, "ssim", 0.5, [1, 1, 2]),
    ] {
        let (mean, found) = of(identical, metric);
        Tolerance::F64.assert(mean, [expected], metric);
        assert_eq!(found, counts, "{metric}, {identical:?}");
    }
    // Against another method, the identical targets have no partner.
    let mut other = store.clone();
    other.targets.iter_mut().for_each(|row| row.status = TargetStatus::Scored);
    for row in &mut other.targets {
        row.scores.insert("psnr".to_owned(), 25.0);
    }
    let pair = paired_between((&store, &query("m")), (&other, &query("m")), Aggregation::SceneMeans).unwrap();
    Tolerance::F64.assert([pair.difference], [f64::midpoint(-5.0, 2.0)], "over scenes a and c");
    assert_eq!((pair.scenes, pair.targets, pair.unpaired), (2, 3, 2));
}

#[test]
fn fewer_than_six_scenes_have_no_published_interval() {
    let names = ["a", "b", "c", "d", "e", "f"];
    for (count, expected) in [(5, false), (6, true)] {
        let scenes: Vec<_> =
            (0u8..).zip(&names[..count]).map(|(at, name)| (*name, 0, vec![20.0 + f64::from(at)])).collect();
        let store = psnr(&scenes);
        assert_eq!(
            summary(&store, &query("m"), Aggregation::SceneMeans).interval.is_some(),
            expected,
            "{count} scenes"
        );
        let pair = paired_between((&store, &query("m")), (&store, &query("m")), Aggregation::SceneMeans).unwrap();
        assert_eq!(pair.interval.is_some(), expected, "pairs of {count} scenes");
    }
}

#[test]
fn distances_are_selected_on_both_sides() {
    let mut store = psnr(&[("a", 0, vec![30.0, 20.0, 22.0, 10.0])]);
    for (row, distance) in store.targets.iter_mut().zip([0, -3, 5, 6]) {
        row.signed_distance = distance;
    }
    let mean = |range| within_distances(&store, &query("m"), range, Aggregation::SceneMeans).mean;
    Tolerance::F64.assert([mean(0..=0), mean(1..=5), mean(6..=9)].map(Option::unwrap), [30.0, 21.0, 10.0], "means");
    assert_eq!(mean(7..=9), None);
}

fn scene_mean(scene: &str, mean: f64) -> SceneMean {
    SceneMean { scene: scene.to_owned(), mean, weight: 1.0, targets: 1, identical: 0 }
}

/// Three trainings of six scenes by hand: the spread of scenes is 2 dB apart in steps, that of trainings 0.3 dB.
#[test]
fn trainings_and_scenes_have_separate_deviations() {
    let training = |offset: f64| {
        (0..6u8).map(|at| scene_mean(&format!("{at}"), 20.0 + 2.0 * f64::from(at) + offset)).collect::<Vec<_>>()
    };
    let trainings = [training(-0.3), training(0.0), training(0.3)];
    let found = mean_over_seeds(&trainings).unwrap();
    Tolerance::relative(1e-9).assert(
        [found.mean, found.training_deviation, found.scene_deviation],
        [25.0, 0.3, 14.0f64.sqrt()],
        "mean and deviations",
    );
    assert_eq!((found.seeds, found.scenes), (3, 6));
    // Var = 14/6 + 0.09/3; Satterthwaite: its square over (14/6)²/5 + 0.03²/2 is 5.13 degrees of freedom, so 5.
    let half = 2.570_581_835_636_314 * (14.0 / 6.0 + 0.03f64).sqrt();
    Tolerance::relative(1e-9).assert(found.interval.unwrap(), [25.0 - half, 25.0 + half], "interval");
    assert_eq!(mean_over_seeds(&trainings[..1]), None, "one training has no spread");

    // The difference to one other network: heights of scenes cancel, the spread of trainings does not.
    let found = difference_of_seeds(&trainings, &[training(1.0)]).unwrap();
    Tolerance::relative(1e-9).assert([found.mean, found.training_deviation], [-1.0, 0.3], "difference");
    Tolerance::absolute(1e-9).assert([found.scene_deviation], [0.0], "scenes");
    let half = 4.302_652_729_749_464 * 0.03f64.sqrt();
    Tolerance::relative(1e-9).assert(found.interval.unwrap(), [-1.0 - half, -1.0 + half], "two degrees of freedom");
    let swapped = difference_of_seeds(&[training(1.0)], &trainings).unwrap();
    Tolerance::relative(1e-9).assert([swapped.mean], [1.0], "swapped");
}

/// Both trainings of one network fail at the harder target of every scene; those of the other are half a decibel better at the easier.
#[test]
fn several_trainings_are_compared_over_the_targets_that_all_have() {
    let store = |easy: f64, hard: f64| {
        let scenes = ["a", "b", "c", "d", "e", "f"].map(|scene| (scene, 0, vec![easy, hard]));
        psnr(&scenes)
    };
    let lose = |results: &mut Results, is_lost: fn(&str, u32) -> bool| {
        for row in results.targets.iter_mut().filter(|row| is_lost(&row.key.scene, row.target)) {
            row.status = TargetStatus::NonFinite;
            row.scores.clear();
        }
    };
    let difference = |first: [&Results; 2], second: [&Results; 2]| {
        let queries = [first[0], first[1], second[0], second[1]].map(|results| (results, query("m")));
        let mut means = common_scene_means(&queries, Aggregation::SceneMeans);
        let of_second = means.split_off(2);
        difference_of_seeds(&means, &of_second).map(|found| (found.mean, found.scenes, found.seeds))
    };
    let whole = store(20.5, 10.5);
    let mut lacking = store(20.0, 10.0);
    lose(&mut lacking, |_, target| target == 1);
    let (mean, scenes, seeds) = difference([&lacking; 2], [&whole; 2]).unwrap();
    Tolerance::F64.assert([mean], [-0.5], "not 20 against the mean of 20.5 and 10.5");
    assert_eq!((scenes, seeds), (6, 4));
    // What one training of the other side lacks is left out too.
    let mut without_scene = whole.clone();
    lose(&mut without_scene, |scene, target| scene == "c" && target == 0);
    let (mean, scenes, _) = difference([&without_scene, &whole], [&lacking; 2]).unwrap();
    Tolerance::F64.assert([mean], [0.5], "the other way round");
    assert_eq!(scenes, 5);
    let mut only_hard = whole.clone();
    lose(&mut only_hard, |_, target| target == 0);
    assert_eq!(difference([&lacking; 2], [&whole, &only_hard]), None, "no target in common");
    assert!(common_scene_means(&[], Aggregation::SceneMeans).is_empty());
    let unpaired = |all: [&Results; 3]| unpaired_targets(&all.map(|results| (results, query("m"))));
    assert_eq!(unpaired([&without_scene, &whole, &lacking]), 7, "six harder targets and one easier");
    assert_eq!(unpaired([&lacking; 3]), 0, "what none has");
}
