//! Bins, distances and paired differences average as the protocol does.

use super::*;

/// Scenes of three, one, two and one targets. Bins, or distances, that hold all of them have the protocol's mean between them.
#[test]
fn under_all_images_parts_have_the_overall_mean_between_them() {
    let scenes =
        [("a", 0, vec![20.0, 22.0, 24.0]), ("b", 0, vec![30.0]), ("c", 0, vec![10.0, 12.0]), ("d", 0, vec![40.0])];
    let mut store = psnr(&scenes);
    let properties = [(0.1, 0), (0.1, 0), (0.1, 3), (0.2, 3), (0.7, -2), (0.7, 0), (0.7, 0)];
    for (row, (overlap, distance)) in store.targets.iter_mut().zip(properties) {
        (row.overlap, row.signed_distance) = (Some(overlap), distance);
    }
    let all = summary(&store, &query("m"), Aggregation::AllImages);
    Tolerance::F64.assert(all.mean, [158.0 / 7.0], "all targets");
    let weighted = |parts: &[Summary]| {
        let sum: f64 = parts.iter().map(|part| part.mean.unwrap_or_default() * part.targets as f64).sum();
        (sum / 7.0, parts.iter().map(|part| part.targets).sum::<u64>())
    };
    let is_overall = |parts: &[Summary], what: &str| {
        let (mean, targets) = weighted(parts);
        assert_eq!(targets, 7, "{what}");
        Tolerance::F64.assert([mean], [158.0 / 7.0], what);
    };
    let binned =
        |aggregation| by_overlap(&store, &query("m"), &OverlapBins::noposplat(BinRule::Published), aggregation);
    let within = |range, aggregation| within_distances(&store, &query("m"), range, aggregation);
    for (aggregation, of_bins, inside) in
        [(Aggregation::SceneMeans, [26.0, 25.5], 73.0 / 3.0), (Aggregation::AllImages, [24.0, 62.0 / 3.0], 23.5)]
    {
        let found = binned(aggregation).bins.into_iter().filter_map(|(_, summary)| summary.mean);
        Tolerance::F64.assert(found, of_bins, "small and large");
        Tolerance::F64.assert(within(0..=0, aggregation).mean, [inside], "inside the window");
    }
    let Binned { bins, average, ignored } = binned(Aggregation::AllImages);
    assert_eq!((average.mean, average.targets, ignored), (all.mean, 7, 0));
    is_overall(&bins.into_iter().map(|(_, summary)| summary).collect::<Vec<_>>(), "bins");
    is_overall(&[0..=0, 1..=u64::MAX].map(|range| within(range, Aggregation::AllImages)), "inside and outside");
    let steps = by_distance_steps(&store, &query("m"), 1, Aggregation::AllImages);
    is_overall(&steps.into_iter().map(|(_, summary)| summary).collect::<Vec<_>>(), "distances");
}

/// Scenes of one to seven targets, in which the first is better by 0, 1, 4, 9 to 36. The second lost a target of the last scene.
#[test]
fn a_difference_is_that_of_the_means_over_the_same_targets() {
    let store = |gain: fn(f64) -> f64| {
        let scenes = ["a", "b", "c", "d", "e", "f", "g"].into_iter().zip(0u8..);
        let of_scene =
            |(scene, at): (&'static str, u8)| (scene, 0, vec![20.0 + gain(f64::from(at)); usize::from(at) + 1]);
        psnr(&scenes.map(of_scene).collect::<Vec<_>>())
    };
    let (mut first, mut second) = (store(|at| at * at), store(|_| 0.0));
    let lost = second.targets.last_mut().unwrap();
    lost.status = TargetStatus::NonFinite;
    lost.scores.clear();
    let of = query("m");
    let pair = |aggregation| paired_between((&first, &of), (&second, &of), aggregation).unwrap();
    let found = pair(Aggregation::AllImages);
    Tolerance::F64.assert([found.difference], [496.0 / 27.0], "all images");
    Tolerance::F64.assert([pair(Aggregation::SceneMeans).difference], [13.0], "scene means");
    assert_eq!((found.scenes, found.targets, found.unpaired), (7, 27, 1));
    let clusters: Vec<[f64; 2]> =
        [(0.0, 1.0), (1.0, 2.0), (4.0, 3.0), (9.0, 4.0), (16.0, 5.0), (25.0, 6.0), (36.0, 6.0)]
            .map(|(gain, targets)| [gain * targets, targets])
            .to_vec();
    Tolerance::F64.assert(found.interval.unwrap(), interval_of_mean(&clusters).unwrap(), "whole scenes are drawn");
    // Against two trainings, each scene weighs as many targets as all have.
    let mut means = common_scene_means(&[(&first, of), (&second, of), (&second, of)], Aggregation::AllImages);
    let others = means.split_off(1);
    Tolerance::F64.assert([difference_of_seeds(&means, &others).unwrap().mean], [found.difference], "two trainings");
    first.targets.pop();
    let [one, other] = [&first, &second].map(|store| summary(store, &of, Aggregation::AllImages).mean.unwrap());
    Tolerance::F64.assert([one - other], [found.difference], "two rows");
}

/// Two entries of a scene, of one and two targets.
#[test]
fn means_of_a_scene_are_over_entries_or_over_targets() {
    let store = psnr(&[("a", 0, vec![10.0]), ("a", 1, vec![20.0, 40.0])]);
    for (aggregation, expected) in [(Aggregation::SceneMeans, 20.0), (Aggregation::AllImages, 70.0 / 3.0)] {
        let means = paired_scene_means(&store, &query("m"), &query("m"), aggregation);
        Tolerance::F64.assert(means.into_iter().flat_map(|(_, means)| means), [expected; 2], "a scene");
    }
}

/// Five and six scenes, of one to six targets.
#[test]
fn a_mean_without_an_interval_has_the_same_bits() {
    let scenes: Vec<(&str, u32, Vec<f64>)> = ["a", "b", "c", "d", "e", "f"]
        .into_iter()
        .zip(1u8..)
        .map(|(scene, targets)| (scene, 0, (0..targets).map(|at| f64::from(targets * 7 + at) / 3.0).collect()))
        .collect();
    for (count, is_published) in [(5, false), (6, true)] {
        let store = psnr(&scenes[..count]);
        for aggregation in [Aggregation::SceneMeans, Aggregation::AllImages] {
            let selected = select(&store, &query("m"));
            let (published, whole) = (summary(&store, &query("m"), aggregation), summary_of(&selected, aggregation));
            let without = Summary { interval: None, ..whole.clone() };
            assert_eq!(summary_without_interval(&selected, aggregation), without);
            let interval = whole.interval.filter(|_| is_published);
            assert!(whole.interval.is_some());
            assert_eq!(published, Summary { interval, ..whole });
            assert_eq!(mean_of(&selected, aggregation), without.mean);
        }
    }
}
