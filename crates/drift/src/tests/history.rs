//! The history of a number agrees with its verdicts, also where runs have different targets.

use super::*;

/// The history of the only number of `now`.
fn history_of(baseline: &Baseline, now: &Results) -> NumberHistory {
    histories(baseline, &compare(now, baseline)).remove(0)
}

/// The second run has the scores of the first, but lacks its two worst scenes, so that its mean is another.
#[test]
fn targets_that_a_run_lacks_move_no_number() {
    let whole = store(true, 6, 0.0, 1);
    let mut part = whole.clone();
    let is_left_out = |scene: &str| ["scene 000", "scene 005"].contains(&scene);
    part.trials.retain(|row| !is_left_out(&row.key.scene));
    part.targets.retain(|row| !is_left_out(&row.key.scene));
    let baseline = baseline_of(&whole);
    let accepted = baseline.accept(&part, &[], acceptance("a part"));
    assert!((accepted.numbers[1].mean - accepted.numbers[0].mean).abs() > 0.1, "{:?}", accepted.numbers);
    let (checked, after) = (history_of(&baseline, &part), history_of(&accepted, &part));
    for run in [&checked.runs[1], &after.runs[1]] {
        assert_eq!((run.verdict == Some(DriftVerdict::Drifted), run.moved), (run.label == "now", Some(0.0)), "{run:?}");
        let [low, high] = run.limits.unwrap();
        Tolerance::absolute(1e-9).assert([low, high], [run.mean; 2], "nothing moved");
    }
    // The other way round, and moved by 0.25 dB.
    let mut more = whole.clone();
    shift(&mut more, 0.25);
    let back = accepted.accept(&more, &[], acceptance("all of it"));
    let run = &history_of(&back, &more).runs[2];
    let [low, high] = run.limits.unwrap();
    Tolerance::absolute(1e-9).assert([low, high, run.moved.unwrap()], [run.mean - 0.25, run.mean - 0.25, 0.25], "up");
}

/// LPIPS has no weights when the second run is accepted.
#[test]
fn nothing_is_compared_across_an_acceptance_without_the_number() {
    let with = |lpips: Option<f64>| {
        let mut run = store(true, 4, 0.0, 1);
        run.targets.iter_mut().for_each(|row| row.scores.extend(lpips.map(|score| ("lpips".to_owned(), score))));
        run
    };
    let first = baseline_of(&with(Some(0.25)));
    let second = first.accept(&with(None), &[], acceptance("no weights"));
    let third = second.accept(&with(Some(0.5)), &[], acceptance("weights again"));
    let now = with(Some(0.5));
    let history =
        histories(&third, &compare(&now, &third)).into_iter().find(|number| number.metric == "lpips").unwrap();
    let found: Vec<_> = history.runs.iter().map(|run| (run.why.as_deref(), run.moved, run.limits.is_some())).collect();
    let expected = [(Some("first"), None, false), (Some("weights again"), None, false), (None, Some(0.0), true)];
    assert_eq!((found.as_slice(), history.unknown), (&expected[..], 1));
}

/// As older versions wrote them.
#[test]
fn accepted_numbers_without_a_difference_are_compared_by_their_means() {
    let mut baseline = baseline_of(&moved(0.0)).accept(&moved(0.5), &[], acceptance("second"));
    assert_eq!(baseline.numbers[1].difference, Some(0.5));
    baseline.numbers.iter_mut().for_each(|number| number.difference = None);
    let text = serde_json::to_string(&baseline.numbers).unwrap();
    assert!(!text.contains("difference"), "{text}");
    assert_eq!(serde_json::from_str::<Vec<AcceptedNumber>>(&text).unwrap(), baseline.numbers);
    let run = &history_of(&baseline, &moved(0.5)).runs[1];
    assert_eq!((run.moved, run.limits), (Some(0.5), Some([baseline.numbers[0].mean; 2])));
}
