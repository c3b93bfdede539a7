//! Metrics and scenes that are added to existing results.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crate::common::{Run, Walls, baselines, dataset, entry, rows, suite, write_zero_weights};
use atsplat_eval::method::{Method, MethodError, Prediction, Rendered, TrialInput, Warp};
use atsplat_eval::runner::{KeepImages, named_metrics, run};
use atsplat_eval::timing::TimingPlan;
use atsplat_metrics::learned::{LpipsNetwork, WeightsFolders};
use atsplat_metrics::{Networks, Suite};
use atsplat_results::store::images::image_path;
use atsplat_results::{GapKind, MethodRecord, Results, RunWarning, TargetRow, WEIGHTS_ABSENT};

const TIMING: TimingPlan =
    TimingPlan { trials: 2, warm_up: 0, warm_up_until: Duration::MAX, repetitions: 1, long: Duration::MAX };

/// Baselines, or the plane warp alone, on five scenes; no target is also a context frame.
fn run_of(methods: Vec<Arc<dyn Method>>, metrics: &[&str]) -> Run {
    let datasets = vec![dataset(Walls::new(5, 8), &[entry(&[0, 4], &[1, 6])])];
    Run { suite: suite(metrics), ..Run::new(datasets, methods) }
}

fn warp() -> Vec<Arc<dyn Method>> {
    vec![Arc::new(Warp)]
}

/// The rows of a run into a new store.
fn fresh(run: &Run) -> Results {
    run.run(tempfile::tempdir().unwrap().path()).unwrap().0
}

/// How many targets have a score of a metric, of the warp and of the nearest view.
fn scored(results: &Results, metric: &str) -> [usize; 2] {
    ["warp", "nearest-view"].map(|method| {
        let has_score = |row: &&TargetRow| row.key.method == method && row.scores.contains_key(metric);
        results.targets.iter().filter(has_score).count()
    })
}

#[test]
fn results_without_a_metric_are_evaluated_again_with_their_times_and_images() {
    let folder = tempfile::tempdir().unwrap();
    let first = Run { timing: Some(TIMING), images: KeepImages::All, ..run_of(baselines(), &["psnr"]) };
    let (before, _) = first.run(folder.path()).unwrap();
    let more = run_of(warp(), &["psnr", "ssim"]);
    // Killed before its first trial.
    drop(more.store(folder.path()).unwrap());
    assert_eq!(scored(&Results::read(folder.path()).unwrap(), "ssim"), [0, 0]);
    let (added, summary) = more.run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed, scored(&added, "ssim")), (5, 0, [10, 0]));
    assert!(!before.timings.is_empty());
    assert_eq!(added.timings, before.timings);
    let has_image = |row: &TargetRow| image_path(folder.path(), &row.key, row.frame).is_file();
    assert!(added.targets.iter().all(has_image), "the renders are the same");
    let without = run_of(baselines(), &["psnr"]).run(folder.path()).unwrap_err().to_string();
    assert!(without.contains("ssim: then computed, now not requested"), "{without}");
    let all = run_of(baselines(), &["psnr", "ssim"]);
    let (joined, summary) = all.run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed, scored(&joined, "ssim")), (5, 5, [10, 10]));
    let expected = fresh(&all);
    assert_eq!(rows(&joined), rows(&expected));
    assert_eq!(joined.provenance.metrics, expected.provenance.metrics);
}

#[test]
fn a_metric_is_added_once_its_weights_are_there() {
    let [store, weights] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let metrics = ["psnr", "lpips-alex"];
    let absent = run_of(baselines(), &metrics);
    let (before, _) = absent.run(store.path()).unwrap();
    assert!(before.targets.iter().all(|row| row.not_computed["lpips-alex"] == WEIGHTS_ABSENT));
    let (_, summary) = absent.run(store.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed), (0, 10), "nothing can be added");
    write_zero_weights(weights.path(), LpipsNetwork::LpipsAlex);
    let present = |methods| Run { suite: with_weights(&metrics, weights.path()), ..run_of(methods, &[]) };
    let (added, summary) = present(warp()).run(store.path()).unwrap();
    assert_eq!((summary.evaluated, scored(&added, "lpips-alex")), (5, [10, 0]));
    let now_absent = absent.run(store.path()).unwrap_err().to_string();
    assert!(now_absent.contains("now not computed, because its weights alexnet-owt-7be5be79.pth were not found"));
    let (joined, _) = present(baselines()).run(store.path()).unwrap();
    let expected = fresh(&present(baselines()));
    assert_eq!((rows(&joined), &joined.provenance.metrics), (rows(&expected), &expected.provenance.metrics));
}

fn with_weights(metrics: &[&str], folder: &Path) -> Suite {
    let definitions = named_metrics(metrics.iter().copied()).unwrap();
    let networks = Networks::for_definitions(&definitions, &WeightsFolders::new(vec![folder.to_owned()])).unwrap();
    Suite::new(definitions, networks, 0)
}

#[test]
fn scenes_that_a_limit_left_out_are_added() {
    let folder = tempfile::tempdir().unwrap();
    let limited = |methods, limit| {
        let mut run = run_of(methods, &["psnr"]);
        run.selection.limit = limit;
        run
    };
    limited(baselines(), Some(2)).run(folder.path()).unwrap();
    let uneven = limited(baselines(), Some(3)).run(folder.path()).unwrap_err().to_string();
    assert!(uneven.contains("then 2 scenes, now 3 scenes"), "{uneven}");
    let (some, summary) = limited(warp(), Some(4)).run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed, some.provenance.presets[0].entries), (2, 2, 4));
    let unfinished: Vec<_> = some.unfinished().into_iter().map(|run| (run.method, run.entries, run.total)).collect();
    assert_eq!(unfinished, [("nearest-view".to_owned(), 2, 4)]);
    let (whole, summary) = limited(baselines(), None).run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed, whole.provenance.limit), (4, 6, None));
    let expected = fresh(&limited(baselines(), None));
    assert_eq!((rows(&whole), &whole.provenance.presets), (rows(&expected), &expected.provenance.presets));
    assert!(limited(baselines(), Some(4)).run(folder.path()).is_err(), "a limit does not remove scenes");
}

/// The data lack the second of five scenes, as a chunk of it.
#[test]
fn scenes_that_the_data_lacked_are_added() {
    let folder = tempfile::tempdir().unwrap();
    let with = |is_there: bool| {
        let mut run = run_of(baselines(), &["psnr"]);
        if !is_there {
            let mut walls = Walls::new(5, 8);
            walls.keys[1] = "another".to_owned();
            run.datasets[0].source = Arc::new(walls);
        }
        run
    };
    let (some, summary) = with(false).run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.missing_scenes, some.provenance.presets[0].entries), (8, 1, 4));
    let (whole, summary) = with(true).run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed, summary.missing_scenes), (2, 8, 0));
    let expected = fresh(&with(true));
    assert_eq!((rows(&whole), &whole.provenance.presets), (rows(&expected), &expected.provenance.presets));
    assert_eq!((&whole.provenance.warnings, whole.gaps()), (&expected.provenance.warnings, Vec::new()));
    let fewer = with(false).run(folder.path()).unwrap_err().to_string();
    assert!(fewer.contains("then 5 entries of the index, now 4; restore the data"), "{fewer}");
}

/// Both runs take a part of the scenes of one index, in different orders.
#[test]
fn limits_over_another_order_are_rejected() {
    let limited = |limit, is_reversed: bool| {
        let mut run = run_of(warp(), &["psnr"]);
        run.selection.limit = limit;
        if is_reversed {
            run.datasets[0].index.index.scenes.reverse();
        }
        run
    };
    let [some, all] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (before, _) = limited(Some(2), false).run(some.path()).unwrap();
    for limit in [Some(2), Some(4), None] {
        let refused = limited(limit, true).run(some.path()).unwrap_err().to_string();
        assert!(refused.starts_with("scenes under walls of the two runs differ: "), "{limit:?}: {refused}");
    }
    assert_eq!(Results::read(some.path()).unwrap(), before);
    limited(None, false).run(all.path()).unwrap();
    assert_eq!(limited(None, true).run(all.path()).unwrap().1.resumed, 5, "all scenes, in whichever order");
}

/// The plane warp, which fails in these scenes.
#[derive(Debug)]
struct FailingIn([&'static str; 2]);

impl Method for FailingIn {
    fn record(&self) -> MethodRecord {
        Warp.record()
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        if self.0.contains(&input.trial.scene()) {
            return Err(MethodError::Failed("out of memory".to_owned()));
        }
        Warp.predict(input)
    }
}

/// The plane warp, which fails to render this many of a trial's first targets.
#[derive(Debug)]
struct FailingTargets(usize);

impl Method for FailingTargets {
    fn record(&self) -> MethodRecord {
        Warp.record()
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        Ok(Box::new(WithoutFirst(Warp.predict(input)?, self.0)))
    }
}

struct WithoutFirst<'a>(Box<dyn Prediction + 'a>, usize);

impl Prediction for WithoutFirst<'_> {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let rendered = self.0.render(targets).into_iter().zip(targets);
        rendered.map(|(image, target)| if *target < self.1 { Err("out of memory".to_owned()) } else { image }).collect()
    }
}

/// One of two targets of each trial fails, then both, then none.
#[test]
fn failed_trials_are_tried_again_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let of = |failing: usize| run_of(vec![Arc::new(FailingTargets(failing))], &["psnr"]);
    let retry = |failing: usize| {
        let settings = of(failing);
        let store = settings.store(folder.path()).unwrap().retry_failed();
        run(&settings.plan(), store, &|_| ()).unwrap()
    };
    let (before, summary) = of(1).run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.incomplete), (5, 5));
    assert_eq!(of(0).run(folder.path()).unwrap().1.evaluated, 0, "not without the request");
    let (kept, summary) = retry(2);
    assert_eq!((summary.evaluated, summary.resumed, summary.incomplete), (0, 5, 5), "counted once");
    assert_eq!(rows(&kept), rows(&before), "a result with more scores stays");
    let (whole, summary) = retry(0);
    assert_eq!((summary.evaluated, summary.incomplete), (5, 0));
    assert_eq!(rows(&whole), rows(&fresh(&of(0))));
    assert_eq!(retry(0).1.evaluated, 0, "nothing has failed");
}

/// Two of five results fail when a metric is added.
#[test]
fn a_result_that_fails_when_it_is_evaluated_again_stays() {
    let folder = tempfile::tempdir().unwrap();
    let first = Run { images: KeepImages::All, ..run_of(warp(), &["psnr"]) };
    let (before, _) = first.run(folder.path()).unwrap();
    let failing = run_of(vec![Arc::new(FailingIn(["wall-1", "wall-3"]))], &["psnr", "l1"]);
    let (some, summary) = Run { images: KeepImages::All, ..failing }.run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed, summary.incomplete), (3, 2, 2));
    assert_eq!([scored(&some, "psnr")[0], scored(&some, "l1")[0]], [10, 6]);
    let of_failed = |results: &Results| -> Vec<TargetRow> {
        results.targets.iter().filter(|row| row.key.scene == "wall-3").cloned().collect()
    };
    assert_eq!(of_failed(&some), of_failed(&before));
    let mut warnings = some.provenance.warnings.iter();
    let warning = warnings.find(|warning| warning.kind == RunWarning::FailedAgain.about("warp")).unwrap();
    assert_eq!((warning.count, warning.example.as_str()), (2, "wall-1: out of memory"));
    let gaps: Vec<_> = some.gaps().iter().map(|gap| (gap.kind, gap.count)).collect();
    assert_eq!(gaps, [(GapKind::Unfinished, 2), (GapKind::Incomplete, 2)]);
    for row in &some.targets {
        let image = image_path(folder.path(), &row.key, row.frame);
        let files = std::fs::read_dir(image.parent().unwrap()).unwrap().count();
        assert_eq!((image.is_file(), files), (true, 2), "{}", row.key.scene);
    }
    let whole = run_of(warp(), &["psnr", "l1"]);
    let (done, summary) = whole.run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed, summary.incomplete), (2, 3, 0), "it is tried again");
    assert_eq!((rows(&done), done.gaps()), (rows(&fresh(&whole)), Vec::new()));
}
