//! Times are those of a method alone, or marked.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use atsplat_eval::method::{Answer, Cost, Method, NearestView, Question, Refusal, Rendered, Timed};
use atsplat_eval::runner::{Dataset, KeepPictures, Plan, Selection, here, named_metrics, run};
use atsplat_eval::timing::{TimingPlan, times};
use atsplat_eval::{MethodRecord, Results, Store, TrialStatus};
use atsplat_metrics::{Networks, Suite};
use atsplat_numeric::median;
use atsplat_pixels::Image;
use atsplat_protocol::trial::Prefetch;
use common::{SIZE, Walls, dataset, entry};
use rayon::prelude::*;

/// A method of known cost: it sleeps, and waits once inside rayon as a parallel loop does for its last part.
///
/// Sleeping takes as long on a busy processor as on a quiet one. But a thread that waits inside rayon takes up other work, where
/// there is some.
#[derive(Debug, Default)]
struct Sleeper {
    asked: AtomicUsize,
}

const COST: Duration = Duration::from_millis(100);
const PICTURE: Duration = Duration::from_millis(60);

impl Method for Sleeper {
    fn record(&self) -> MethodRecord {
        MethodRecord { name: "sleeper".to_owned(), kind: "test".to_owned(), ..MethodRecord::default() }
    }

    fn begin<'a>(&'a self, _question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal> {
        self.asked.fetch_add(1, Ordering::Relaxed);
        encode();
        let stages = [("sleep".to_owned(), COST.as_secs_f64())].into();
        Ok(Box::new(Slept(Cost { stages, ..Cost::default() })))
    }
}

fn encode() {
    std::thread::sleep(COST);
    rayon::yield_now();
}

struct Slept(Cost);

impl Answer for Slept {
    fn cost(&self) -> &Cost {
        &self.0
    }

    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let one = |_: &usize| {
            std::thread::sleep(PICTURE);
            Ok(grey())
        };
        targets.iter().map(one).collect()
    }
}

fn grey() -> Rendered {
    let samples = vec![0.5; (SIZE.width * SIZE.height * 3) as usize];
    Rendered { image: Image::new(SIZE.width, SIZE.height, samples).unwrap(), drawn: None, effects: Vec::new() }
}

fn timed_run(folder: &Path, datasets: &[Dataset], methods: &[Arc<dyn Method>], timing: Option<TimingPlan>) -> Results {
    let suite = Suite::new(named_metrics(["psnr"]).unwrap(), Networks::default(), 0);
    let plan = Plan {
        datasets,
        methods,
        suite: &suite,
        selection: Selection::default(),
        timing,
        pictures: KeepPictures::Nothing,
        prefetch: Prefetch::default(),
    };
    let store = Store::resume(folder, plan.provenance(here("0", None, Vec::new())).unwrap()).unwrap();
    let steps = AtomicUsize::new(0);
    let (results, _) = run(&plan, store, &|| _ = steps.fetch_add(1, Ordering::Relaxed)).unwrap();
    assert_eq!(steps.into_inner() as u64, plan.steps(), "every result and every timed method is a step");
    results
}

fn walls(scenes: usize) -> [Dataset; 1] {
    [dataset(Walls::new(scenes, 8), &[entry(&[0, 4], &[2])])]
}

fn secs_of(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Keeps rayon's global pool full of other trials' work until it is told to stop.
fn keep_busy(stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        rayon::scope(|scope| (0..2 * rayon::current_num_threads()).for_each(|_| scope.spawn(|_| encode())));
    }
}

#[test]
fn a_known_cost_is_told_within_15_percent_under_contention() {
    let threads = rayon::current_num_threads();
    let own = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let alone = own.install(|| median((0..9).map(|_| secs_of(encode)))).unwrap();
    let picture = median((0..9).map(|_| secs_of(|| std::thread::sleep(PICTURE)))).unwrap();
    let (stop, folders) = (AtomicBool::new(false), [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()]);
    let (shared, results) = std::thread::scope(|scope| {
        scope.spawn(|| keep_busy(&stop));
        // A clock around the same work where trials share the pool, as evaluations do.
        let shared: Vec<f64> = (0..4 * threads).into_par_iter().map(|_| secs_of(encode)).collect();
        // Another evaluation of the same process, before, beside and after.
        scope.spawn(|| timed_run(folders[0].path(), &walls(6), &[Arc::new(Sleeper::default())], None));
        let timing = Some(TimingPlan::default());
        let results = timed_run(folders[1].path(), &walls(4), &[Arc::new(Sleeper::default())], timing);
        stop.store(true, Ordering::Relaxed);
        (median(shared).unwrap(), results)
    });
    assert!(shared > 1.15 * alone, "the contention is real: {shared} s beside others, {alone} s alone");
    let found = times(&results, "walls", "sleeper").unwrap();
    let encoding = found.encode.unwrap();
    assert!((encoding.median / alone - 1.0).abs() <= 0.15, "{} s, and {alone} s alone", encoding.median);
    let render = found.render.unwrap().median;
    assert!((render / picture - 1.0).abs() <= 0.15, "{render} s for a picture");
    assert_eq!((found.trials, found.trials_there, found.repetitions, found.warm_up), (3, 4, 5, 1));
    assert_eq!((encoding.samples, found.stages["sleep"].samples), (15, 15));
    assert!(encoding.quartiles[0] <= encoding.median && encoding.median <= encoding.quartiles[1], "{encoding:?}");
}

/// Holds 64 MiB while it encodes.
#[derive(Debug)]
struct Hoarder;

impl Method for Hoarder {
    fn record(&self) -> MethodRecord {
        MethodRecord { name: "hoarder".to_owned(), kind: "test".to_owned(), ..MethodRecord::default() }
    }

    fn timed(&self) -> Timed {
        Timed { encoding: true, rendering: false }
    }

    fn begin<'a>(&'a self, question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal> {
        let held = vec![1u8; 64 << 20];
        match question.trial.scene() {
            "wall-1" => Err(Refusal::NotApplicable("not this one".to_owned())),
            _ if held.iter().map(|byte| u64::from(*byte)).sum::<u64>() == 64 << 20 => {
                Ok(Box::new(Slept(Cost::default())))
            }
            _ => Err(Refusal::Failed("forgetful".to_owned())),
        }
    }
}

/// Takes part in no trial.
#[derive(Debug)]
struct Unwilling(&'static str);

impl Method for Unwilling {
    fn record(&self) -> MethodRecord {
        MethodRecord { name: self.0.to_owned(), kind: "test".to_owned(), ..MethodRecord::default() }
    }

    fn begin<'a>(&'a self, _question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal> {
        assert!(self.0 != "broken", "a bug");
        Err(Refusal::NotApplicable("three views are too many".to_owned()))
    }
}

#[test]
fn what_is_timed_and_why_the_rest_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let methods: [Arc<dyn Method>; 4] =
        [Arc::new(NearestView), Arc::new(Hoarder), Arc::new(Unwilling("unwilling")), Arc::new(Unwilling("broken"))];
    let results = timed_run(folder.path(), &walls(3), &methods, Some(TimingPlan::default()));
    let nearest = times(&results, "walls", "nearest-view").unwrap();
    assert!(nearest.encode.is_none() && nearest.render == nearest.first_picture, "it makes nothing of its context");
    assert!(nearest.repetitions > 5, "short work is repeated until its time can be told");
    let hoarder = times(&results, "walls", "hoarder").unwrap();
    assert!(hoarder.render.is_none() && hoarder.stages.is_empty());
    assert_eq!((hoarder.trials, hoarder.trials_there), (2, 3), "of one trial it makes nothing");
    for row in results.timings.iter().filter(|row| row.key.method == "hoarder") {
        if let (Some(held), Some(peak)) = (row.held_bytes, row.peak_bytes) {
            assert!(peak >= held + (60 << 20), "{held} bytes before, {peak} at the most");
        }
        assert!(row.load.average_before.is_some() == Path::new("/proc/loadavg").exists());
    }
    assert!(times(&results, "walls", "unwilling").unwrap_err().contains("three views are too many"));
    assert!(times(&results, "walls", "broken").unwrap_err().contains("panicked"));
    assert!(times(&results, "walls", "nobody").unwrap_err().contains("--timing"));
    assert!(results.trials.iter().any(|trial| trial.status == TrialStatus::Done), "and nothing else is lost");
    assert_eq!(Results::read(folder.path()).unwrap(), results);
}

#[test]
fn what_was_timed_is_not_timed_again_unless_disturbed() {
    let folder = tempfile::tempdir().unwrap();
    let sleeper = Arc::new(Sleeper::default());
    let methods = [Arc::clone(&sleeper) as Arc<dyn Method>];
    let asked = || sleeper.asked.swap(0, Ordering::Relaxed);
    let untimed = timed_run(folder.path(), &walls(2), &methods, None);
    assert_eq!((asked(), untimed.timings.len()), (2, 0));
    let timed = timed_run(folder.path(), &walls(2), &methods, Some(TimingPlan::default()));
    assert_eq!((asked(), timed.timings.len()), (12, 2), "a warm-up and five repetitions of both trials");
    assert_eq!(timed.trials, untimed.trials, "the pass changes no row");
    let quiet = !timed.timings.iter().any(|row| row.load.is_busy());
    let again = timed_run(folder.path(), &walls(2), &methods, Some(TimingPlan::default()));
    assert_eq!(asked(), if quiet { 0 } else { 12 });
    assert!(!quiet || again.timings == timed.timings);
    let more = TimingPlan { repetitions: 6, ..TimingPlan::default() };
    let more = timed_run(folder.path(), &walls(2), &methods, Some(more));
    assert_eq!((asked(), more.timings.len(), more.timings[0].encode.len()), (14, 2, 6));
    // Other pictures: what was timed is another trial.
    let other = [dataset(Walls::new(2, 8), &[entry(&[0, 6], &[2])])];
    let store = Store::open(folder.path()).unwrap();
    let known = store.timings().unwrap();
    let mut disturbed = known.clone();
    for row in &mut disturbed {
        row.load.others = Some(0.5);
    }
    store.add_timings(disturbed).unwrap();
    drop(store);
    assert!(times(&Results::read(folder.path()).unwrap(), "walls", "sleeper").unwrap().busy);
    asked();
    timed_run(folder.path(), &walls(2), &methods, Some(TimingPlan::default()));
    assert_eq!(asked(), 12, "a pass that was disturbed is made again");
    let fresh = tempfile::tempdir().unwrap();
    let changed = timed_run(fresh.path(), &other, &methods, Some(TimingPlan::default()));
    assert_ne!(changed.timings[0].trial_hash, known[0].trial_hash);
}

/// Work of the processor, so that it does suffer beside other work: the pass says so.
#[test]
fn a_pass_on_a_busy_machine_is_marked() {
    if !Path::new("/proc/stat").exists() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let results = std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().unwrap().get() {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let results = timed_run(folder.path(), &walls(3), &[Arc::new(Sleeper::default())], Some(TimingPlan::default()));
        stop.store(true, Ordering::Relaxed);
        results
    });
    let found = times(&results, "walls", "sleeper").unwrap();
    assert!(found.busy && found.others.unwrap() > 0.5, "{:?}", found.others);
}

/// Two floors on two simulated yards, as atsplat wrote them when `--timing` put times into the rows (`atsplat run tiny.toml --data
/// data/test --method warp --method nearest-view --metrics psnr --timing`, schema version 1).
#[test]
fn times_of_an_older_store_are_not_read() {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/store-v1");
    let results = Results::read(&fixture).unwrap();
    assert_eq!((results.trials.len(), results.targets.len(), results.timings.len()), (4, 8, 0));
    assert!(results.targets.iter().all(|row| row.scores.contains_key("psnr")), "everything else is read");
    let reason = times(&results, "tiny", "warp").unwrap_err();
    assert!(reason.contains("older atsplat") && reason.contains("--timing"), "{reason}");
    let copy = tempfile::tempdir().unwrap();
    for file in std::fs::read_dir(&fixture).unwrap().map(|file| file.unwrap()) {
        std::fs::copy(file.path(), copy.path().join(file.file_name())).unwrap();
    }
    let error = Store::resume(copy.path(), results.provenance.clone()).unwrap_err().to_string();
    assert!(error.contains("schema versions") && error.contains("another folder"), "{error}");
    let merged = Results::merge(vec![results.clone()]).unwrap().results;
    assert_eq!((merged.trials, merged.timings.len()), (results.trials, 0));
}
