//! What is taken for a repetition of a run.

use super::*;

/// Something that makes results another run than the one they repeat.
type Change = fn(&mut Results);

#[test]
fn only_finished_runs_of_the_same_plan_on_the_same_data_are_repetitions() {
    let run = store(false, 4, 0.5, 1);
    let with = |change: fn(&mut Results)| {
        let mut repeat = store(false, 4, 0.5, 2);
        repeat.provenance.presets[0].dataset = "a copy".to_owned();
        (repeat.provenance.processor, repeat.provenance.threads) = ("another".to_owned(), 7);
        change(&mut repeat);
        check_repetition(&run, &repeat)
    };
    with(|_| ()).unwrap();
    with(|repeat| repeat.targets.reverse()).unwrap();
    with(|repeat| _ = repeat.provenance.methods[0].parameters.insert("folder".to_owned(), "renders-2".into())).unwrap();
    let cases: [(Change, &str); 10] = [
        (
            |repeat| _ = repeat.provenance.methods[0].parameters.insert("step".to_owned(), "2".into()),
            "method m, step: 2 instead of none",
        ),
        (|repeat| repeat.provenance.presets[0].entries = 5, "a finished run, found a store is not done: 4 of 5"),
        (|repeat| repeat.targets.iter_mut().for_each(|row| row.scores.clear()), "expected results with scores"),
        (|repeat| repeat.provenance.presets[0].hash = "b".to_owned(), "preset sampled, hash: b instead of a"),
        (|repeat| repeat.provenance.presets[0].index_sha256 = "c".to_owned(), "sampled, index-sha256: c instead of "),
        (
            |repeat| repeat.provenance.methods[0].weights_sha256 = Some("d".to_owned()),
            "method m, weights-sha256: d instead of none",
        ),
        (|repeat| repeat.provenance.metrics.clear(), "metric psnr, convention: none instead of "),
        (|repeat| drop(repeat.targets.remove(4)), "no target 1 of m on sampled, scene \"scene 001\", entry 0"),
        (|repeat| repeat.targets[11].target = 3, "found no target 2 of m on sampled, scene \"scene 003\", entry 0"),
        (
            |repeat| repeat.trials[2].data_hash = Some("e".to_owned()),
            "other images or cameras in m on sampled, scene \"scene 002\", entry 0",
        ),
    ];
    for (change, expected) in cases {
        let error = with(change).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    // The other way round.
    let mut part = run.clone();
    part.targets.remove(4);
    let error = check_repetition(&part, &run).unwrap_err().to_string();
    assert!(error.ends_with("target 1 of m on sampled, scene \"scene 001\", entry 0, which the run lacks"), "{error}");
}
