//! Times are those of the method alone, or marked as disturbed.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::common::methods::{Grey, counted_method, grey_after, method, timed_method};
use crate::common::{Run, Walls, dataset, entry, record};
use atsplat_eval::method::{Cost, Method, MethodError, NearestView, Prediction, Timed, TrialInput};
use atsplat_eval::runner::{Dataset, KeepImages};
use atsplat_eval::timing::TimingPlan;
use atsplat_numeric::median;
use atsplat_protocol::trial::Trial;
use atsplat_results::times::{Load, TimingRow, times};
use atsplat_results::{MethodRecord, Results, Store, TrialStatus};
use atsplat_scene::{Scene, SceneError, SceneSource, Warnings};
use atsplat_tests::on_threads;
use rayon::prelude::*;

/// Times of an encoding and of an image. A pass repeats work until a quarter of a second has passed: with these it needs two
/// repetitions.
const COST: Duration = Duration::from_millis(70);
const IMAGE: Duration = Duration::from_millis(60);

/// As [`COST`] and [`IMAGE`], for tests that count calls: with the five repetitions of the default plan, a pass needs no more.
const SHORT_COST: Duration = Duration::from_millis(34);
const SHORT_IMAGE: Duration = Duration::from_millis(20);

/// Work of known cost: it sleeps, and yields once inside rayon as a parallel loop does while it waits for its last part.
///
/// Sleeping takes the same time on a busy processor as on an idle one, but a thread that waits inside rayon steals other work
/// if there is some.
fn encode(cost: Duration) {
    sleep(cost);
    rayon::yield_now();
}

/// What a method of known cost predicts.
fn slept(cost: Duration, image: Duration) -> Box<dyn Prediction> {
    encode(cost);
    let stages = [("sleep".to_owned(), cost.as_secs_f64())].into();
    Box::new(Grey { wait: image, cost: Cost { stages, ..Cost::default() } })
}

fn rejecting() -> Arc<dyn Method> {
    method("rejecting", |_| Err(MethodError::NotApplicable("three views are too many".to_owned())))
}

fn timed_run(
    folder: &Path,
    datasets: Vec<Dataset>,
    methods: &[Arc<dyn Method>],
    timing: Option<TimingPlan>,
) -> Results {
    Run { timing, ..Run::new(datasets, methods.to_vec()) }.run(folder).unwrap().0
}

fn walls(scenes: usize) -> Vec<Dataset> {
    vec![dataset(Walls::new(scenes, 8), &[entry(&[0, 4], &[2])])]
}

/// Marks the stored times as measured while other programs took this share of the processors; returns them.
fn as_if_others_took(folder: &Path, share: f64) -> Vec<TimingRow> {
    let store = Store::open(folder).unwrap();
    let load = Load { others: Some(share), ..Load::default() };
    let rows = store.timings().unwrap().into_iter().map(|row| TimingRow { load, ..row });
    store.add_timings(rows.collect()).unwrap();
    store.timings().unwrap()
}

fn secs_of(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Keeps rayon's global pool busy until `stop` is set.
fn keep_busy(stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        rayon::scope(|scope| (0..2 * rayon::current_num_threads()).for_each(|_| scope.spawn(|_| encode(COST))));
    }
}

#[test]
fn a_known_cost_is_measured_within_15_percent_under_contention() {
    let threads = rayon::current_num_threads();
    let sleeper = [method("sleeper", |_| Ok(slept(COST, IMAGE)))];
    let alone = on_threads(threads, || median((0..5).map(|_| secs_of(|| encode(COST))))).unwrap();
    let image = median((0..5).map(|_| secs_of(|| sleep(IMAGE)))).unwrap();
    let (stop, folders) = (AtomicBool::new(false), [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()]);
    let (shared, results) = std::thread::scope(|scope| {
        scope.spawn(|| keep_busy(&stop));
        // A clock around the same work while trials share the pool, as in an evaluation.
        let shared: Vec<f64> = (0..4 * threads).into_par_iter().map(|_| secs_of(|| encode(COST))).collect();
        // Another evaluation in the same process.
        scope.spawn(|| timed_run(folders[0].path(), walls(5), &sleeper, None));
        let timing = Some(TimingPlan { trials: 2, ..TimingPlan::default() });
        let results = timed_run(folders[1].path(), walls(3), &sleeper, timing);
        stop.store(true, Ordering::Relaxed);
        (median(shared).unwrap(), results)
    });
    assert!(shared > 1.15 * alone, "the contention is real: {shared} s with others, {alone} s alone");
    let found = times(&results, "walls", "sleeper").unwrap();
    let encoding = found.encode.unwrap();
    assert!((encoding.median / alone - 1.0).abs() <= 0.15, "{} s, and {alone} s alone", encoding.median);
    let render = found.render.unwrap().median;
    assert!((render / image - 1.0).abs() <= 0.15, "{render} s for an image");
    assert_eq!((found.trials, found.trials_there, found.repetitions, found.warm_up), (2, 3, 5, 1));
    assert_eq!((encoding.samples, found.stages["sleep"].samples), (10, 10));
    assert!(encoding.quartiles[0] <= encoding.median && encoding.median <= encoding.quartiles[1], "{encoding:?}");
}

#[test]
fn long_work_needs_no_warm_up_and_two_repetitions() {
    let runs = |warm_up_until, long, cold| {
        let calls = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&calls);
        let sleeper = method("sleeper", move |_| {
            // A call that takes longer than others, as when a model is loaded.
            if Some(counter.fetch_add(1, Ordering::Relaxed)) == cold {
                sleep(COST);
            }
            Ok(slept(COST, IMAGE))
        });
        let folder = tempfile::tempdir().unwrap();
        let plan = TimingPlan { trials: 1, warm_up_until, repetitions: 3, long, ..TimingPlan::default() };
        let results = timed_run(folder.path(), walls(1), &[sleeper], Some(plan));
        let found = times(&results, "walls", "sleeper").unwrap();
        // Without the evaluation itself.
        let calls = calls.load(Ordering::Relaxed) - 1;
        (found.warm_up, found.repetitions, found.encode.unwrap().samples, calls)
    };
    let (one, never) = (COST + IMAGE, Duration::MAX);
    assert_eq!(runs(one, never, None), (0, 3, 3, 3));
    assert_eq!(runs(4 * one, never, None), (1, 3, 3, 4));
    // The call after the evaluation's is the first of the timing pass.
    assert_eq!(runs(one, never, Some(1)), (2, 3, 3, 5));
    assert_eq!(runs(one, one, None), (0, 2, 2, 2), "two are enough");
    assert_eq!(runs(4 * one, one, None), (1, 2, 2, 3));
}

/// Reading and rendering take 130 ms, rendering alone 60 ms.
#[test]
fn work_that_is_not_timed_does_not_make_a_warm_up_a_repetition() {
    let folder = tempfile::tempdir().unwrap();
    let plan = TimingPlan { trials: 1, warm_up_until: COST + IMAGE, repetitions: 2, ..TimingPlan::default() };
    let reading = timed_method("reading", Timed::RENDERING, |_| Ok(slept(COST, IMAGE)));
    let results = timed_run(folder.path(), walls(1), &[reading], Some(plan));
    let found = times(&results, "walls", "reading").unwrap();
    assert_eq!((found.warm_up, found.repetitions), (1, 2));
}

/// Allocates 64 MiB while it encodes; rejects one scene.
fn allocating() -> Arc<dyn Method> {
    timed_method("allocating", Timed { encoding: true, rendering: false }, |input| {
        let held = vec![1u8; 64 << 20];
        match input.trial.scene() {
            "wall-1" => Err(MethodError::NotApplicable("not this one".to_owned())),
            _ if held.iter().map(|byte| u64::from(*byte)).sum::<u64>() == 64 << 20 => Ok(grey_after(Duration::ZERO)),
            _ => Err(MethodError::Failed("forgetful".to_owned())),
        }
    })
}

#[test]
fn untimed_methods_have_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let broken = method("broken", |_| panic!("a bug"));
    let methods: [Arc<dyn Method>; 4] = [Arc::new(NearestView), allocating(), rejecting(), broken];
    let results = timed_run(folder.path(), walls(3), &methods, Some(TimingPlan::default()));
    let nearest = times(&results, "walls", "nearest-view").unwrap();
    assert!(nearest.encode.is_none() && nearest.render == nearest.first_image, "it does no work on its context");
    assert!(nearest.repetitions > 5, "short work is repeated until it can be measured");
    let allocating = times(&results, "walls", "allocating").unwrap();
    assert!(allocating.render.is_none() && allocating.stages.is_empty());
    assert_eq!((allocating.trials, allocating.trials_there), (2, 3), "one trial is rejected");
    for row in results.timings.iter().filter(|row| row.key.method == "allocating") {
        if let (Some(held), Some(peak)) = (row.held_bytes, row.peak_bytes) {
            assert!(peak >= held + (60 << 20), "{held} bytes before, {peak} at the most");
        }
        assert!(row.load.average_before.is_some() == Path::new("/proc/loadavg").exists());
    }
    assert!(times(&results, "walls", "rejecting").unwrap_err().contains("three views are too many"));
    assert!(times(&results, "walls", "broken").unwrap_err().contains("panicked"));
    assert!(times(&results, "walls", "unknown").unwrap_err().contains("--timing"));
    assert!(results.trials.iter().any(|trial| trial.status == TrialStatus::Done), "and nothing else is lost");
    assert_eq!(Results::read(folder.path()).unwrap(), results);
    let undisturbed = as_if_others_took(folder.path(), 0.0);
    let again = timed_run(folder.path(), walls(3), &methods, Some(TimingPlan::default()));
    assert!(again.timings == undisturbed, "rejected trials are not tried again");
}

#[test]
fn undisturbed_times_are_not_measured_again() {
    let folder = tempfile::tempdir().unwrap();
    let (sleeper, counter) = counted_method("sleeper", |_| Ok(slept(SHORT_COST, SHORT_IMAGE)));
    let methods = [sleeper];
    let calls = || counter.swap(0, Ordering::Relaxed);
    let untimed = timed_run(folder.path(), walls(2), &methods, None);
    assert_eq!((calls(), untimed.timings.len()), (2, 0));
    let timed = timed_run(folder.path(), walls(2), &methods, Some(TimingPlan::default()));
    assert_eq!((calls(), timed.timings.len()), (12, 2), "a warm-up and five repetitions of both trials");
    assert_eq!(timed.trials, untimed.trials, "the pass changes no row");
    let undisturbed = as_if_others_took(folder.path(), 0.0);
    let again = timed_run(folder.path(), walls(2), &methods, Some(TimingPlan::default()));
    assert_eq!((calls(), again.timings == undisturbed), (0, true));
    // One of three entries has no trial.
    let damaged = || vec![dataset(Walls { damaged: Some((1, 0)), ..Walls::new(3, 8) }, &[entry(&[0, 4], &[2])])];
    let lacking = tempfile::tempdir().unwrap();
    let timed = timed_run(lacking.path(), damaged(), &methods, Some(TimingPlan::default()));
    assert_eq!(timed.timings.len(), 2, "{:?}", timed.provenance.skipped);
    as_if_others_took(lacking.path(), 0.0);
    calls();
    timed_run(lacking.path(), damaged(), &methods, Some(TimingPlan::default()));
    assert_eq!(calls(), 0);
    let more = TimingPlan { repetitions: 6, ..TimingPlan::default() };
    let more = timed_run(folder.path(), walls(2), &methods, Some(more));
    assert_eq!((calls(), more.timings.len(), more.timings[0].encode.len()), (14, 2, 6));
    // Other context images make another trial.
    let other = vec![dataset(Walls::new(2, 8), &[entry(&[0, 6], &[2])])];
    let known = as_if_others_took(folder.path(), 0.5);
    assert!(times(&Results::read(folder.path()).unwrap(), "walls", "sleeper").unwrap().busy);
    calls();
    timed_run(folder.path(), walls(2), &methods, Some(TimingPlan::default()));
    assert_eq!(calls(), 12, "a disturbed pass is repeated");
    let fresh = tempfile::tempdir().unwrap();
    let changed = timed_run(fresh.path(), other, &methods, Some(TimingPlan::default()));
    assert_ne!(changed.timings[0].trial_hash, known[0].trial_hash);
}

/// Counts how often a scene is loaded.
struct Counting(Walls, Arc<AtomicUsize>);

impl SceneSource for Counting {
    fn keys(&self) -> &[String] {
        self.0.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.load(key, warnings)
    }
}

/// All of four scenes are evaluated again to see whether their data changed; two are timed.
#[test]
fn trials_that_are_timed_are_not_prepared_again() {
    let folder = tempfile::tempdir().unwrap();
    let loads = Arc::new(AtomicUsize::new(0));
    let methods: [Arc<dyn Method>; 2] = [Arc::new(NearestView), rejecting()];
    let run = |timing| {
        let mut datasets = walls(4);
        datasets[0].source = Arc::new(Counting(Walls::new(4, 8), Arc::clone(&loads)));
        let results = timed_run(folder.path(), datasets, &methods, timing);
        (loads.swap(0, Ordering::Relaxed), results.timings.len())
    };
    let plan = Some(TimingPlan { trials: 2, warm_up: 0, repetitions: 1, ..TimingPlan::default() });
    let (untimed, none) = run(None);
    let (timed, rows) = run(plan);
    assert!(timed > untimed && (none, rows) == (0, 3), "{untimed} and {timed} loads, {rows} rows");
    // As on a machine without other work.
    as_if_others_took(folder.path(), 0.0);
    assert_eq!(run(plan), (untimed, 3), "nothing is left");
    let more = Some(TimingPlan { trials: 3, warm_up: 0, repetitions: 1, ..TimingPlan::default() });
    let (loads, rows) = run(more);
    assert!(loads > untimed && rows == 4, "{loads} loads, {rows} rows");
}

/// Renders what was made elsewhere: a file for each scene.
#[derive(Debug)]
struct Imported(PathBuf);

impl Method for Imported {
    fn record(&self) -> MethodRecord {
        record("imported")
    }

    fn files(&self, trial: &Trial) -> Vec<Option<PathBuf>> {
        vec![Some(self.0.join(trial.scene()))]
    }

    fn timed(&self) -> Timed {
        Timed::RENDERING
    }

    fn predict<'a>(&'a self, _input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        Ok(grey_after(Duration::ZERO))
    }
}

#[test]
fn times_of_replaced_files_are_dropped_and_measured_again() {
    let [store, files] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let write = |scene: &str, text: &str| std::fs::write(files.path().join(scene), text).unwrap();
    write("wall-0", "first");
    write("wall-1", "first");
    let methods: [Arc<dyn Method>; 2] = [Arc::new(Imported(files.path().to_owned())), Arc::new(NearestView)];
    let run = |timing| timed_run(store.path(), walls(2), &methods, timing);
    let plan = TimingPlan { trials: 2, warm_up: 0, repetitions: 1, ..TimingPlan::default() };
    let before = run(Some(plan));
    assert_eq!(before.timings.len(), 4);
    write("wall-1", "the second");
    let untimed = run(None);
    let mut kept = before.timings.clone();
    kept.retain(|row| (row.key.method.as_str(), row.key.scene.as_str()) != ("imported", "wall-1"));
    assert_eq!((kept.len(), untimed.timings), (3, kept), "only those of the row that was replaced are dropped");
    assert_eq!(Results::read(store.path()).unwrap().timings.len(), 3);
    // Both scenes have changed since they were timed.
    write("wall-0", "the third");
    let again = run(Some(plan));
    let imported = |results: &Results| times(results, "walls", "imported").unwrap().trials;
    assert_eq!((again.timings.len(), imported(&again)), (4, 2));
    let scene = |results: &Results| {
        let row = results.timings.iter().find(|row| row.key.method == "imported" && row.key.scene == "wall-0");
        row.unwrap().render.clone()
    };
    assert_ne!(scene(&again), scene(&before), "these are measured");
    // Rows that are only evaluated again for their images stay timed.
    let settings = Run::new(walls(2), methods.to_vec());
    let (with_images, summary) = Run { images: KeepImages::All, ..settings }.run(store.path()).unwrap();
    assert_eq!((summary.evaluated, with_images.timings), (4, again.timings));
}

/// The sleeper, with other work on every processor during one of its trials.
#[test]
fn a_burst_marks_the_trial_that_it_disturbs_and_the_times_of_the_method() {
    if !Path::new("/proc/stat").exists() {
        return;
    }
    let disturbed = method("disturbed", |input| {
        if input.trial.scene() == "wall-1" {
            let begin = Instant::now();
            std::thread::scope(|scope| {
                for _ in 0..std::thread::available_parallelism().unwrap().get() {
                    scope.spawn(|| while begin.elapsed() < 2 * SHORT_COST {});
                }
            });
        }
        Ok(slept(SHORT_COST, SHORT_IMAGE))
    });
    let folder = tempfile::tempdir().unwrap();
    let results = timed_run(folder.path(), walls(3), &[disturbed], Some(TimingPlan::default()));
    let load = |scene: &str| results.timings.iter().find(|row| row.key.scene == scene).unwrap().load;
    let [before, burst, after] = ["wall-0", "wall-1", "wall-2"].map(load);
    assert!(burst.is_busy() && burst.others.unwrap() > 0.3, "{burst:?}");
    // Other tests may run at the same time, but the load is measured for each row.
    assert!(before != burst && after != burst, "{before:?} {after:?}");
    let found = times(&results, "walls", "disturbed").unwrap();
    assert!(found.busy && found.others >= burst.others, "{:?}", found.others);
}
