use super::*;

/// Scenes differ by 10 dB in height and every one of them falls by 2 dB per doubling: pooled, the missing points would tilt
/// the line.
#[test]
fn slopes_over_settings_compare_within_scenes() {
    let setting = |x: f64, scenes: std::ops::Range<usize>| {
        (x, scenes.map(|at| scene_mean(&format!("{at}"), 10.0 * at as f64 - 2.0 * x)).collect::<Vec<_>>())
    };
    let found = along_setting(&[setting(2.0, 0..7), setting(3.0, 0..7), setting(5.0, 1..9)]).unwrap();
    Tolerance::absolute(1e-9).assert([found.slope], [-2.0], "per unit");
    Tolerance::absolute(1e-9).assert(found.interval.unwrap(), [-2.0; 2], "every scene agrees");
    assert_eq!(found.scenes, 6, "those that all settings have");
    let few = |found| Err(NoTrend::FewScenes { expected: 6, found });
    assert_eq!(along_setting(&[setting(2.0, 0..7)]), few(0), "one setting has no slope");
    assert_eq!(along_setting(&[setting(2.0, 0..5), setting(4.0, 0..5)]), few(5), "five scenes");
}

/// Against the least-squares line through nine points, by hand: Σ(x − x̄)(y − ȳ) / Σ(x − x̄)².
#[test]
fn slopes_over_overlap_and_distance_are_least_squares() {
    let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i"];
    let points: Vec<(f64, f64)> = (0..9u8).map(|at| (0.1 * f64::from(at), 20.0 + f64::from(at * at % 7))).collect();
    let scenes: Vec<_> = names.iter().zip(&points).map(|(name, (_, y))| (*name, 0, vec![*y])).collect();
    let mut store = psnr(&scenes);
    for (row, (overlap, _)) in store.targets.iter_mut().zip(&points) {
        row.overlap = Some(*overlap);
    }
    let (mx, my) = (0.4, points.iter().map(|(_, y)| y).sum::<f64>() / 9.0);
    let by_hand = points.iter().map(|(x, y)| (x - mx) * (y - my)).sum::<f64>()
        / points.iter().map(|(x, _)| (x - mx).powi(2)).sum::<f64>();
    let found = along_overlap(&store, &query("m")).unwrap();
    Tolerance::relative(1e-9).assert([found.slope], [by_hand], "overlap");
    let [low, high] = found.interval.unwrap();
    assert!(low < found.slope && found.slope < high && low < 0.0 && high > 0.0, "no trend in noise: {low} to {high}");

    // 3 dB per frame on either side, whatever the height of the scene; targets inside the window do not count.
    let scenes: Vec<_> = names
        .iter()
        .zip(0u8..)
        .map(|(name, at)| (*name, 0, vec![99.0, 40.0 - f64::from(at), 31.0 - f64::from(at)]))
        .collect();
    let mut store = psnr(&scenes);
    for (row, distance) in store.targets.iter_mut().zip([0, -1, 4].into_iter().cycle()) {
        row.signed_distance = distance;
    }
    let found = along_distance(&store, &query("m")).unwrap();
    Tolerance::relative(1e-9).assert([found.slope], [-3.0], "distance");
    let none = NoTrend::FewScenes { expected: 6, found: 0 };
    assert_eq!(along_overlap(&store, &query("m")), Err(none), "no overlaps");
    assert_eq!(none.to_string(), "expected at least 6 scenes, found 0");
}

/// Seven scenes, of which each has 1 dB more than the one before.
#[test]
fn overlaps_that_differ_by_less_than_a_tenth_have_no_slope_per_tenth() {
    let over = |step: f64| {
        let scenes = ["a", "b", "c", "d", "e", "f", "g"].into_iter().zip(0u8..);
        let mut store = psnr(&scenes.map(|(name, at)| (name, 0, vec![20.0 + f64::from(at)])).collect::<Vec<_>>());
        for (row, at) in store.targets.iter_mut().zip(0u8..) {
            row.overlap = Some(0.3 + step * f64::from(at));
        }
        along_overlap(&store, &query("m"))
    };
    for (step, range) in [(0.0, 0.0), (0.002, 0.012), (0.016, 0.096)] {
        let Err(NoTrend::CloseOverlaps { expected, found }) = over(step) else { panic!("a slope at steps of {step}") };
        Tolerance::absolute(1e-12).assert([expected, found], [0.1, range], "least and found difference");
    }
    let said = over(0.002).unwrap_err().to_string();
    assert_eq!(said, "expected overlaps that differ by at least 0.1, found 0.012");
    Tolerance::relative(1e-9).assert([over(0.1 / 6.0).unwrap().slope], [60.0], "a tenth, except for rounding");
}

/// Six scenes with three targets each: a third of the resamples draw only scenes of the first overlap, whose spread is what rounding
/// leaves. With four other scenes among twenty it is 1 in 87 of them, fewer than lie beyond an end of the interval.
#[test]
fn resamples_of_one_overlap_have_no_slope() {
    let over = |scenes: u32, others: u32| {
        let names: Vec<String> = (0..scenes).map(|at| format!("{at:02}")).collect();
        let is_other = |at: u32| at >= scenes - others;
        let scores = |at: u32| {
            let height = 20.0 + f64::from(at * at % 7) + if is_other(at) { 5.0 } else { 0.0 };
            vec![height, height + 0.7, height - 0.4]
        };
        let scored: Vec<_> = names.iter().zip(0..).map(|(name, at)| (name.as_str(), 0, scores(at))).collect();
        let mut store = psnr(&scored);
        for (row, at) in store.targets.iter_mut().zip((0..scenes).flat_map(|at| [at; 3])) {
            row.overlap = Some(if is_other(at) { 0.55 } else { 0.3 });
        }
        along_overlap(&store, &query("m")).unwrap()
    };
    let few = over(6, 1);
    assert!(few.slope.is_finite() && few.interval.is_none(), "{few:?}");
    let many = over(20, 4);
    let [low, high] = many.interval.unwrap();
    assert!(0.0 < low && low < many.slope && many.slope < high && high < 60.0, "{many:?}");
}

/// Nine scenes, of which only some have two distances: the others must neither narrow the interval nor be counted.
#[test]
fn scenes_without_two_distances_are_no_evidence_for_a_slope() {
    let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i"];
    let with_two_distances = |informative: usize| {
        let scores = |at: u8| vec![30.0 + f64::from(at), 25.0 - f64::from(at * at % 5)];
        let scenes: Vec<_> = names.iter().zip(0u8..).map(|(name, at)| (*name, 0, scores(at))).collect();
        let mut store = psnr(&scenes);
        for (row, at) in store.targets.iter_mut().zip(0..) {
            row.signed_distance = if at / 2 < informative { [-2, 5][at % 2] } else { 5 };
        }
        along_distance(&store, &query("m"))
    };
    let alone = |informative: usize| {
        let names = &names[..informative];
        let scores = |at: u8| vec![30.0 + f64::from(at), 25.0 - f64::from(at * at % 5)];
        let mut store = psnr(&names.iter().zip(0u8..).map(|(name, at)| (*name, 0, scores(at))).collect::<Vec<_>>());
        for (row, distance) in store.targets.iter_mut().zip([-2, 5].into_iter().cycle()) {
            row.signed_distance = distance;
        }
        along_distance(&store, &query("m"))
    };
    for informative in [6, 8] {
        let found = with_two_distances(informative).unwrap();
        assert_eq!((found.scenes, found.interval.is_some()), (informative as u64, true), "{found:?}");
        assert_eq!(Ok(found), alone(informative), "as without the other scenes");
    }
    for informative in [0, 1, 5] {
        let few = NoTrend::FewScenes { expected: 6, found: informative as u64 };
        assert_eq!(with_two_distances(informative), Err(few));
    }
}

/// Two methods that share up to 18 dB of noise: it cancels in their lead, whose slopes are exact.
#[test]
fn slopes_of_a_lead_are_paired_by_target() {
    let names = ["a", "b", "c", "d", "e", "f", "g", "h"];
    let scenes = |height: f64, fall: f64, per_scene: f64| -> Vec<(&str, u32, Vec<f64>)> {
        let scores = |at: u8| {
            let top = height + 3.0 * f64::from(at * at % 7) + per_scene * f64::from(at);
            vec![top - fall, top - 5.0 * fall]
        };
        names.into_iter().zip(0..).map(|(name, at)| (name, 0, scores(at))).collect()
    };
    let mut store = results("first", "psnr", &scenes(30.0, 1.0, -2.0));
    store.targets.extend(results("second", "psnr", &scenes(33.0, 3.0, 0.0)).targets);
    for (row, scene) in store.targets.iter_mut().zip((0..8u8).chain(0..8).flat_map(|scene| [scene, scene])) {
        row.signed_distance = [-1, 5][row.target as usize];
        row.overlap = Some(0.1 * f64::from(scene));
    }
    let (first, second) = (query("first"), query("second"));
    let [lead, back] = [[&first, &second], [&second, &first]].map(|pair| pair.map(|query| (&store, query)));
    let by_distance = lead_along_distance(lead[0], lead[1]).unwrap();
    Tolerance::absolute(1e-9).assert([by_distance.slope], [2.0], "one falls by 1 dB a frame, the other by 3");
    Tolerance::absolute(1e-9).assert(by_distance.interval.unwrap(), [2.0; 2], "the noise cancels");
    let by_overlap = lead_along_overlap(lead[0], lead[1]).unwrap();
    Tolerance::absolute(1e-9).assert([by_overlap.slope], [-20.0], "2 dB for each 0.1 of overlap");
    Tolerance::absolute(1e-9).assert(
        [lead_along_overlap(back[0], back[1]).unwrap().slope],
        [20.0],
        "the other way round",
    );
    assert!(along_overlap(&store, &first).unwrap().interval.unwrap()[1] > -19.0, "alone, the noise stays");
}

/// Coverage of slopes over 30 scenes with scattered overlaps and noise.
#[test]
fn slopes_have_their_nominal_coverage() {
    let mut random = SplitMix64::new(5);
    let samples = 60;
    let mut held = 0;
    for _ in 0..samples {
        let names: Vec<String> = (0..30).map(|at| format!("{at:02}")).collect();
        let xs: Vec<f64> = names.iter().map(|_| random.unit()).collect();
        let noise = |random: &mut SplitMix64| (0..12).map(|_| random.unit()).sum::<f64>() - 6.0;
        let scenes: Vec<_> = names
            .iter()
            .zip(&xs)
            .map(|(name, x)| (name.as_str(), 0, vec![20.0 + 4.0 * x + noise(&mut random)]))
            .collect();
        let mut store = psnr(&scenes);
        for (row, x) in store.targets.iter_mut().zip(&xs) {
            row.overlap = Some(*x);
        }
        let [low, high] = along_overlap(&store, &query("m")).unwrap().interval.unwrap();
        held += u32::from(low <= 4.0 && 4.0 <= high);
    }
    assert!((52..=60).contains(&held), "{held} of {samples} intervals contain the slope");
}
