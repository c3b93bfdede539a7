//! Which times a store keeps, and which are measured again.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use crate::common::methods::{counted_method, grey_after, method, timed_method};
use crate::common::{Run, Walls, dataset, entry};
use atsplat_eval::method::{Method, MethodError, Timed};
use atsplat_eval::runner;
use atsplat_eval::timing::TimingPlan;
use atsplat_results::times::{Load, TimingRow, times};
use atsplat_results::{Results, Store};

/// Rejects the first scene, and counts its calls.
fn picky() -> (Arc<dyn Method>, Arc<AtomicUsize>) {
    counted_method("picky", |input| match input.trial.scene() {
        "wall-0" => Err(MethodError::NotApplicable("not this one".to_owned())),
        _ => Ok(grey_after(Duration::ZERO)),
    })
}

fn run(folder: &Path, scenes: usize, methods: &[Arc<dyn Method>], timing: TimingPlan) -> Results {
    let datasets = vec![dataset(Walls::new(scenes, 8), &[entry(&[0, 4], &[1, 2, 3, 5])])];
    Run { timing: Some(timing), ..Run::new(datasets, methods.to_vec()) }.run(folder).unwrap().0
}

/// Changes the stored times as if one trial's, if any, had been measured on a busy machine and all others on a quiet one.
fn disturb(folder: &Path, scene: Option<&str>) {
    let store = Store::open(folder).unwrap();
    let changed = store.timings().unwrap().into_iter().map(|row| {
        let others = Some(if Some(row.key.scene.as_str()) == scene { 0.5 } else { 0.0 });
        TimingRow { load: Load { others, ..Load::default() }, ..row }
    });
    store.add_timings(changed.collect()).unwrap();
}

const SHORT: TimingPlan =
    TimingPlan { trials: 3, warm_up: 0, warm_up_until: Duration::MAX, repetitions: 1, long: Duration::MAX };

/// Three of five trials are timed; one was rejected before.
#[test]
fn a_rejected_trial_does_not_stand_in_for_a_disturbed_one() {
    let folder = tempfile::tempdir().unwrap();
    let (picky, calls) = picky();
    let calls_of = |scenes| {
        let results = run(folder.path(), scenes, std::slice::from_ref(&picky), SHORT);
        (calls.swap(0, Ordering::Relaxed), results.timings)
    };
    let (_, first) = calls_of(5);
    assert_eq!((first.len(), first.iter().filter(|row| row.is_timed()).count()), (4, 3), "{first:?}");
    disturb(folder.path(), None);
    assert_eq!(calls_of(5).0, 0, "nothing is left");
    for scene in ["wall-1", "wall-3"] {
        disturb(folder.path(), Some(scene));
        let (calls, again) = calls_of(5);
        assert!(calls > 3 && again.len() == 4, "{scene} is measured again: {calls} calls");
        disturb(folder.path(), None);
    }
    // Times of one trial are missing, as after a change of its data.
    let store = Store::open(folder.path()).unwrap();
    let kept = store.timings().unwrap().into_iter().filter(|row| row.key.scene != "wall-3");
    store.add_timings(kept.collect()).unwrap();
    drop(store);
    assert_eq!(calls_of(5).1.iter().filter(|row| row.is_timed()).count(), 3);
}

/// With two trials that it accepts, it has times of two.
#[test]
fn a_method_that_was_tried_on_every_trial_is_not_tried_again() {
    let folder = tempfile::tempdir().unwrap();
    let (picky, calls) = picky();
    let methods = [picky];
    assert_eq!(run(folder.path(), 3, &methods, SHORT).timings.len(), 3);
    disturb(folder.path(), None);
    calls.store(0, Ordering::Relaxed);
    run(folder.path(), 3, &methods, SHORT);
    assert_eq!(calls.load(Ordering::Relaxed), 0);
}

/// Fails on every trial, until it is mended.
fn mended(is_mended: bool) -> Arc<dyn Method> {
    method("mended", move |_| {
        if is_mended { Ok(grey_after(Duration::ZERO)) } else { Err(MethodError::Failed("out of memory".to_owned())) }
    })
}

/// What the timing pass noted of its failure is not true of the new result.
#[test]
fn a_result_that_is_tried_again_is_timed_again() {
    let folder = tempfile::tempdir().unwrap();
    let are_timed = |results: &Results| results.timings.iter().map(TimingRow::is_timed).collect::<Vec<_>>();
    assert_eq!(are_timed(&run(folder.path(), 2, &[mended(false)], SHORT)), [false], "one row for all trials");
    disturb(folder.path(), None);
    assert_eq!(are_timed(&run(folder.path(), 2, &[mended(true)], SHORT)), [false], "not without the request");
    let datasets = vec![dataset(Walls::new(2, 8), &[entry(&[0, 4], &[1, 2, 3, 5])])];
    let mended = Run { timing: Some(SHORT), ..Run::new(datasets, vec![mended(true)]) };
    let store = mended.store(folder.path()).unwrap().retry_failed();
    let (results, _) = runner::run(&mended.plan(), store, &|_| ()).unwrap();
    assert_eq!(are_timed(&results), [true; 2]);
}

/// The memory of a card is full while its times are measured again, or for the first time.
#[test]
fn a_passing_failure_costs_no_times_and_is_tried_again() {
    let (folder, is_full) = (tempfile::tempdir().unwrap(), Arc::new(AtomicBool::new(false)));
    let full = Arc::clone(&is_full);
    let methods = [method("card", move |_| {
        let is_full = full.load(Ordering::Relaxed);
        if is_full { Err(MethodError::Failed("out of memory".to_owned())) } else { Ok(grey_after(Duration::ZERO)) }
    })];
    let run_when = |folder: &Path, full: bool| {
        is_full.store(full, Ordering::Relaxed);
        run(folder, 3, &methods, SHORT).timings
    };
    let are_timed = |rows: &[TimingRow]| rows.iter().map(TimingRow::is_timed).collect::<Vec<_>>();
    assert_eq!(are_timed(&run_when(folder.path(), false)), [true; 3]);
    disturb(folder.path(), Some("wall-1"));
    let disturbed = Store::open(folder.path()).unwrap().timings().unwrap();
    assert_eq!(run_when(folder.path(), true), disturbed, "a busy machine's times are better than none");
    let again = run_when(folder.path(), false);
    assert!(are_timed(&again) == [true; 3] && again[1].encode != disturbed[1].encode, "{again:?}");

    let fresh = tempfile::tempdir().unwrap();
    let datasets = vec![dataset(Walls::new(3, 8), &[entry(&[0, 4], &[1, 2, 3, 5])])];
    Run::new(datasets, methods.to_vec()).run(fresh.path()).unwrap();
    assert_eq!(are_timed(&run_when(fresh.path(), true)), [false]);
    disturb(fresh.path(), None);
    assert_eq!(are_timed(&run_when(fresh.path(), false)), [true; 3], "the evaluation had images of all targets");
}

/// As they are if the run is killed then.
#[test]
fn the_times_of_a_method_are_stored_before_the_next_one_is_timed() {
    let folder = tempfile::tempdir().unwrap();
    // The most times that the store has while the second method runs.
    let most = Arc::new(AtomicUsize::new(0));
    let (store, seen) = (folder.path().to_owned(), Arc::clone(&most));
    let looking = method("looking", move |_| {
        let known = Results::read(&store).map_err(|error| MethodError::Failed(error.to_string()))?;
        seen.fetch_max(known.timings.len(), Ordering::Relaxed);
        Ok(grey_after(Duration::from_millis(100)))
    });
    let results = run(folder.path(), 3, &[picky().0, looking], SHORT);
    assert_eq!((most.load(Ordering::Relaxed), results.timings.len()), (3, 6));
}

/// Three of four targets are rendered in each repetition.
#[test]
fn repetitions_are_not_images() {
    let folder = tempfile::tempdir().unwrap();
    // What was made elsewhere is rendered.
    let methods = [timed_method("rendering", Timed::RENDERING, |_| Ok(grey_after(Duration::from_millis(30))))];
    let timed = |repetitions| {
        let results = run(folder.path(), 1, &methods, TimingPlan { trials: 1, repetitions, ..SHORT });
        (times(&results, "walls", "rendering").unwrap().repetitions, results.timings[0].render.len())
    };
    assert_eq!(timed(5), (5, 15));
    assert_eq!(timed(9), (9, 27), "five are not nine");
}
