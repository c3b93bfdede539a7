//! Which times a store keeps, and which are measured again.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::common::{Run, Walls, dataset, entry, grey, record};
use atsplat_eval::method::{Method, MethodError, Prediction, Rendered, Timed, TrialInput};
use atsplat_eval::runner::{self, current_provenance};
use atsplat_eval::timing::TimingPlan;
use atsplat_results::times::{Load, TimingRow, times};
use atsplat_results::{MethodRecord, Results, Store};

struct Grey(Duration);

impl Prediction for Grey {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let one = |_: &usize| {
            std::thread::sleep(self.0);
            Ok(grey())
        };
        targets.iter().map(one).collect()
    }
}

/// Rejects the first scene, and counts its calls.
#[derive(Debug, Default)]
struct Picky(AtomicUsize);

impl Method for Picky {
    fn record(&self) -> MethodRecord {
        record("picky")
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        self.0.fetch_add(1, Ordering::Relaxed);
        match input.trial.scene() {
            "wall-0" => Err(MethodError::NotApplicable("not this one".to_owned())),
            _ => Ok(Box::new(Grey(Duration::ZERO))),
        }
    }
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
    let picky = Arc::new(Picky::default());
    let methods = [Arc::clone(&picky) as Arc<dyn Method>];
    let calls_of = |scenes| {
        let results = run(folder.path(), scenes, &methods, SHORT);
        (picky.0.swap(0, Ordering::Relaxed), results.timings)
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
    let picky = Arc::new(Picky::default());
    let methods = [Arc::clone(&picky) as Arc<dyn Method>];
    assert_eq!(run(folder.path(), 3, &methods, SHORT).timings.len(), 3);
    disturb(folder.path(), None);
    picky.0.store(0, Ordering::Relaxed);
    run(folder.path(), 3, &methods, SHORT);
    assert_eq!(picky.0.load(Ordering::Relaxed), 0);
}

/// Fails on every trial, until it is mended.
#[derive(Debug)]
struct Mended(bool);

impl Method for Mended {
    fn record(&self) -> MethodRecord {
        record("mended")
    }

    fn predict<'a>(&'a self, _input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        if self.0 { Ok(Box::new(Grey(Duration::ZERO))) } else { Err(MethodError::Failed("out of memory".to_owned())) }
    }
}

/// What the timing pass noted of its failure is not true of the new result.
#[test]
fn a_result_that_is_tried_again_is_timed_again() {
    let folder = tempfile::tempdir().unwrap();
    let are_timed = |results: &Results| results.timings.iter().map(TimingRow::is_timed).collect::<Vec<_>>();
    assert_eq!(are_timed(&run(folder.path(), 2, &[Arc::new(Mended(false))], SHORT)), [false], "one row for all trials");
    disturb(folder.path(), None);
    assert_eq!(are_timed(&run(folder.path(), 2, &[Arc::new(Mended(true))], SHORT)), [false], "not without the request");
    let datasets = vec![dataset(Walls::new(2, 8), &[entry(&[0, 4], &[1, 2, 3, 5])])];
    let mended = Run { timing: Some(SHORT), ..Run::new(datasets, vec![Arc::new(Mended(true))]) };
    let plan = mended.plan();
    let provenance = plan.provenance(current_provenance("0", None, Vec::new())).unwrap();
    let store = Store::resume(folder.path(), provenance).unwrap().retry_failed();
    let (results, _) = runner::run(&plan, store, &|_| ()).unwrap();
    assert_eq!(are_timed(&results), [true; 2]);
}

/// Counts the times that the store has while this method runs.
#[derive(Debug)]
struct Looking {
    store: PathBuf,
    seen: AtomicUsize,
}

impl Method for Looking {
    fn record(&self) -> MethodRecord {
        record("looking")
    }

    fn predict<'a>(&'a self, _input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let known = Results::read(&self.store).map_err(|error| MethodError::Failed(error.to_string()))?;
        self.seen.fetch_max(known.timings.len(), Ordering::Relaxed);
        Ok(Box::new(Grey(Duration::from_millis(100))))
    }
}

/// As they are if the run is killed then.
#[test]
fn the_times_of_a_method_are_stored_before_the_next_one_is_timed() {
    let folder = tempfile::tempdir().unwrap();
    let looking = Arc::new(Looking { store: folder.path().to_owned(), seen: AtomicUsize::new(0) });
    let methods: [Arc<dyn Method>; 2] = [Arc::new(Picky::default()), Arc::clone(&looking) as _];
    let results = run(folder.path(), 3, &methods, SHORT);
    assert_eq!((looking.seen.load(Ordering::Relaxed), results.timings.len()), (3, 6));
}

/// Renders what was made elsewhere, each image in 30 ms.
#[derive(Debug)]
struct Rendering;

impl Method for Rendering {
    fn record(&self) -> MethodRecord {
        record("rendering")
    }

    fn timed(&self) -> Timed {
        Timed::RENDERING
    }

    fn predict<'a>(&'a self, _input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        Ok(Box::new(Grey(Duration::from_millis(30))))
    }
}

/// Three of four targets are rendered in each repetition.
#[test]
fn repetitions_are_not_images() {
    let folder = tempfile::tempdir().unwrap();
    let methods: [Arc<dyn Method>; 1] = [Arc::new(Rendering)];
    let timed = |repetitions| {
        let results = run(folder.path(), 1, &methods, TimingPlan { trials: 1, repetitions, ..SHORT });
        (times(&results, "walls", "rendering").unwrap().repetitions, results.timings[0].render.len())
    };
    assert_eq!(timed(5), (5, 15));
    assert_eq!(timed(9), (9, 27), "five are not nine");
}
