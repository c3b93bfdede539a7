//! Rows belong to the data that they were made from, and to a method that did what it was asked.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use atsplat_eval::method::{Answer, Cost, Method, NearestView, Question, Refusal, Rendered, Renders, Warp};
use atsplat_eval::runner::{Dataset, KeepPictures, Plan, Selection, Summary, here, named_metrics, picture_path, run};
use atsplat_eval::{EvalError, MethodRecord, Results, Store, TargetRow, TargetStatus, TrialRow, TrialStatus};
use atsplat_metrics::{Networks, Suite};
use atsplat_pixels::{Image, ImageU8, decode, encode_png};
use atsplat_protocol::trial::Prefetch;
use common::{SIZE, Walls, dataset, entry};

fn evaluate(
    folder: &Path,
    walls: Walls,
    methods: &[Arc<dyn Method>],
    pictures: KeepPictures,
) -> Result<(Results, Summary), EvalError> {
    let datasets = [dataset(walls, &[entry(&[0, 4], &[1, 6])])];
    evaluate_on(folder, &datasets, methods, pictures)
}

fn evaluate_on(
    folder: &Path,
    datasets: &[Dataset],
    methods: &[Arc<dyn Method>],
    pictures: KeepPictures,
) -> Result<(Results, Summary), EvalError> {
    let suite = Suite::new(named_metrics(["psnr"]).unwrap(), Networks::default(), 0);
    let plan = Plan {
        datasets,
        methods,
        suite: &suite,
        selection: Selection::default(),
        timing: None,
        pictures,
        prefetch: Prefetch::default(),
    };
    let steps = AtomicU64::new(0);
    let store = Store::resume(folder, plan.provenance(here("0", None, Vec::new()))?)?;
    let made = run(&plan, store, &|| _ = steps.fetch_add(1, Ordering::Relaxed))?;
    assert_eq!(steps.into_inner(), plan.results(), "every result is a step");
    Ok(made)
}

fn go(folder: &Path, walls: Walls, methods: &[Arc<dyn Method>]) -> Result<(Results, Summary), EvalError> {
    evaluate(folder, walls, methods, KeepPictures::Nothing)
}

fn nearest() -> Arc<dyn Method> {
    Arc::new(NearestView)
}

fn floors() -> Vec<Arc<dyn Method>> {
    vec![nearest(), Arc::new(Warp)]
}

fn bare(results: &Results) -> (Vec<TrialRow>, Vec<TargetRow>) {
    (results.trials.clone(), results.targets.clone())
}

fn replaced(frame: usize) -> Walls {
    Walls { replaced: vec![(1, frame)], ..Walls::new(3, 8) }
}

#[test]
fn a_changed_picture_is_computed_again_and_the_table_is_that_of_a_fresh_store() {
    // A context picture, and a target's.
    for frame in [4, 6] {
        let [store, fresh] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let (before, _) = go(store.path(), Walls::new(3, 8), &floors()).unwrap();
        let (after, summary) = go(store.path(), replaced(frame), &floors()).unwrap();
        assert_eq!((summary.evaluated, summary.resumed), (2, 4), "frame {frame}");
        let (expected, _) = go(fresh.path(), replaced(frame), &floors()).unwrap();
        assert_eq!(bare(&after), bare(&expected), "frame {frame}");
        assert_ne!(bare(&after), bare(&before), "frame {frame}");
        assert_eq!(bare(&Results::read(store.path()).unwrap()), bare(&expected));
        let (_, again) = go(store.path(), replaced(frame), &floors()).unwrap();
        assert_eq!((again.evaluated, again.resumed), (0, 6));
    }
    // A picture that nobody reads changes nothing.
    let store = tempfile::tempdir().unwrap();
    go(store.path(), Walls::new(3, 8), &floors()).unwrap();
    assert_eq!(go(store.path(), replaced(5), &floors()).unwrap().1.evaluated, 0);
}

#[test]
fn a_method_that_joins_after_data_changed_is_refused_until_the_others_run_too() {
    let [store, fresh] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (before, _) = go(store.path(), Walls::new(3, 8), &[nearest()]).unwrap();
    let error = go(store.path(), replaced(4), &[Arc::new(Warp)]).unwrap_err();
    assert!(matches!(error, EvalError::DataChanged { count: 1, .. }), "{error}");
    let message = error.to_string();
    assert!(
        message.contains("nearest-view on walls, scene \"wall-1\"") && message.contains("run these methods too"),
        "{message}"
    );
    assert_eq!(bare(&Results::read(store.path()).unwrap()), bare(&before), "nothing was computed");
    let (both, summary) = go(store.path(), replaced(4), &floors()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed), (4, 2));
    assert_eq!(bare(&both), bare(&go(fresh.path(), replaced(4), &floors()).unwrap().0));
    // Data that did not change let any method join.
    let (_, joined) = go(fresh.path(), replaced(4), &[Arc::new(Halves(2))]).unwrap();
    assert_eq!(joined.evaluated, 3);
}

/// Scenes of several entries, some of them answered: nothing is counted twice.
#[test]
fn going_on_counts_results_and_warnings_once() {
    let [store, fresh] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let asked = [entry(&[0, 4], &[1, 6]), entry(&[0, 4], &[2]), entry(&[0, 40], &[2])];
    let datasets = |walls: Walls| [dataset(Walls { warns: true, ..walls }, &asked)];
    let go = |folder: &tempfile::TempDir, walls: Walls, methods: &[Arc<dyn Method>]| {
        evaluate_on(folder.path(), &datasets(walls), methods, KeepPictures::Nothing).unwrap()
    };
    go(&store, Walls::new(3, 8), &[nearest()]);
    let (joined, summary) = go(&store, Walls::new(3, 8), &floors());
    assert_eq!((summary.evaluated, summary.resumed, summary.skipped), (6, 6, 3));
    let (expected, _) = go(&fresh, Walls::new(3, 8), &floors());
    assert_eq!(joined.provenance.warnings, expected.provenance.warnings);
    assert_eq!(joined.provenance.warnings[0].count, 3);
    assert_eq!(joined.provenance.skipped, expected.provenance.skipped);
    // Of the second scene's two trials, one reads frame 6.
    let (_, summary) = go(&store, replaced(6), &floors());
    assert_eq!((summary.evaluated, summary.resumed), (2, 10));
}

#[test]
fn results_whose_data_are_gone_are_named() {
    let store = tempfile::tempdir().unwrap();
    go(store.path(), Walls::new(3, 8), &floors()).unwrap();
    let fewer = go(store.path(), Walls::new(3, 5), &floors()).unwrap_err().to_string();
    assert!(fewer.contains("frame-out-of-range") && fewer.contains("bring the data back"), "{fewer}");
    let mut absent = Walls::new(3, 8);
    absent.keys[2] = "renamed".to_owned();
    let datasets_index = |walls: Walls| {
        let mut one = dataset(walls, &[entry(&[0, 4], &[1, 6])]);
        one.index = dataset(Walls::new(3, 8), &[entry(&[0, 4], &[1, 6])]).index;
        one
    };
    let datasets = [datasets_index(absent)];
    let suite = Suite::new(named_metrics(["psnr"]).unwrap(), Networks::default(), 0);
    let plan = Plan {
        datasets: &datasets,
        methods: &floors(),
        suite: &suite,
        selection: Selection::default(),
        timing: None,
        pictures: KeepPictures::Nothing,
        prefetch: Prefetch::default(),
    };
    let mut provenance = plan.provenance(here("0", None, Vec::new())).unwrap();
    provenance.presets[0].entries = 3;
    let opened = Store::resume(store.path(), provenance).unwrap();
    let error = run(&plan, opened, &|| ()).unwrap_err().to_string();
    assert!(error.contains("scene \"wall-2\"") && error.contains("not in the data any more"), "{error}");
}

/// Gives so many pictures, whatever it is asked for.
#[derive(Debug)]
struct Halves(usize);

impl Method for Halves {
    fn record(&self) -> MethodRecord {
        MethodRecord { name: format!("gives {}", self.0), kind: "test".to_owned(), ..MethodRecord::default() }
    }

    fn begin<'a>(&'a self, _question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal> {
        Ok(Box::new(Given(self.0, Cost::default())))
    }
}

struct Given(usize, Cost);

impl Answer for Given {
    fn cost(&self) -> &Cost {
        &self.1
    }

    fn render(&self, _targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let image = Image::new(SIZE.width, SIZE.height, vec![0.5; (SIZE.width * SIZE.height * 3) as usize]).unwrap();
        (0..self.0).map(|_| Ok(Rendered { image: image.clone(), drawn: None, effects: Vec::new() })).collect()
    }
}

#[test]
fn another_number_of_pictures_than_targets_is_a_failed_trial_with_both_numbers() {
    for given in [0, 1, 3] {
        let store = tempfile::tempdir().unwrap();
        let (results, summary) = go(store.path(), Walls::new(1, 8), &[Arc::new(Halves(given))]).unwrap();
        assert_eq!((results.trials[0].status, summary.incomplete), (TrialStatus::Failed, 1));
        let message = format!("expected a picture for each of 2 targets, the method gave {given}");
        assert_eq!(results.trials[0].detail.as_deref(), Some(message.as_str()));
        assert_eq!(results.targets.len(), 2, "every target has its row");
        assert!(
            results.targets.iter().all(|row| row.status == TargetStatus::Failed && row.detail == Some(message.clone()))
        );
    }
    let store = tempfile::tempdir().unwrap();
    assert!(go(store.path(), Walls::new(1, 8), &[Arc::new(Halves(2))]).unwrap().1.is_complete());
}

/// Pictures that another method wrote are data too.
#[test]
fn imported_pictures_that_changed_are_scored_again() {
    let [store, renders] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let scene = renders.path().join("wall-0");
    std::fs::create_dir(&scene).unwrap();
    let write = |frame: usize, shade: u8| {
        let picture =
            ImageU8::new(SIZE.width, SIZE.height, vec![shade; (SIZE.width * SIZE.height * 3) as usize]).unwrap();
        std::fs::write(scene.join(format!("{frame:06}.png")), encode_png(&picture).unwrap()).unwrap();
    };
    let score = || {
        let method: Arc<dyn Method> = Arc::new(Renders::new(renders.path(), Some("theirs")).unwrap());
        go(store.path(), Walls::new(1, 8), &[method]).unwrap()
    };
    write(1, 100);
    let (incomplete, _) = score();
    assert_eq!(incomplete.trials[0].status, TrialStatus::Partial);
    write(6, 100);
    let (first, summary) = score();
    assert_eq!((first.trials[0].status, summary.evaluated), (TrialStatus::Done, 1), "what was missing has come");
    assert_eq!(score().1.resumed, 1);
    write(6, 200);
    let (second, summary) = score();
    assert_eq!(summary.evaluated, 1);
    assert_ne!(second.targets[1].scores, first.targets[1].scores);
    assert_eq!(second.targets[0].scores, first.targets[0].scores);
}

#[test]
fn scenes_whose_keys_differ_in_a_slash_alone_keep_pictures_of_their_own() {
    let store = tempfile::tempdir().unwrap();
    let mut walls = Walls::new(4, 8);
    walls.keys = ["a/b", "a_b", "A_b", "a%2Fb"].map(str::to_owned).to_vec();
    let (results, _) = evaluate(store.path(), walls, &[nearest()], KeepPictures::All).unwrap();
    let read = |row: &TargetRow| {
        let bytes = std::fs::read(picture_path(store.path(), &row.key, row.frame)).unwrap();
        decode(&bytes, &atsplat_pixels::DecodeLimits::default()).unwrap()
    };
    for row in results.targets.iter().filter(|row| row.frame == 1) {
        let scene = ["a/b", "a_b", "A_b", "a%2Fb"].iter().position(|key| *key == row.key.scene).unwrap();
        assert_eq!(read(row), common::picture(scene, 0), "{}: the nearest view is its own scene's", row.key.scene);
    }
}
