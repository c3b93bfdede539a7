//! Rows are tied to the data they were computed from; changed data and wrong numbers of images are detected.

use crate::common;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::common::methods::{Grey, method};
use crate::common::{Run, SIZE, Walls, baselines, dataset, entry, grey, record, rows};
use atsplat_camera::PoseNormalisation;
use atsplat_eval::EvalError;
use atsplat_eval::method::{Cost, Method, MethodError, NearestView, Prediction, Rendered, Renders, TrialInput, Warp};
use atsplat_eval::runner::{KeepImages, current_provenance, run};
use atsplat_pixels::{DecodeLimits, ImageU8, decode, encode_png};
use atsplat_protocol::IndexEntry;
use atsplat_results::RunCounts;
use atsplat_results::store::images::image_path;
use atsplat_results::{MethodRecord, Results, Store, TargetRow, TargetStatus, TrialKey, TrialStatus};

fn evaluate(folder: &Path, walls: Walls, methods: Vec<Arc<dyn Method>>) -> Result<(Results, RunCounts), EvalError> {
    Run::new(vec![dataset(walls, &[entry(&[0, 4], &[1, 6])])], methods).run(folder)
}

fn nearest() -> Vec<Arc<dyn Method>> {
    vec![Arc::new(NearestView)]
}

fn replaced(frame: usize) -> Walls {
    Walls { replaced: vec![(1, frame)], ..Walls::new(3, 8) }
}

#[test]
fn a_changed_image_is_recomputed_to_the_rows_of_a_fresh_store() {
    // A context image, and a target's.
    for frame in [4, 6] {
        let [store, fresh] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let (before, _) = evaluate(store.path(), Walls::new(3, 8), baselines()).unwrap();
        let (after, summary) = evaluate(store.path(), replaced(frame), baselines()).unwrap();
        assert_eq!((summary.evaluated, summary.resumed), (2, 4), "frame {frame}");
        let (expected, _) = evaluate(fresh.path(), replaced(frame), baselines()).unwrap();
        assert_eq!(rows(&after), rows(&expected), "frame {frame}");
        assert_ne!(rows(&after), rows(&before), "frame {frame}");
        assert_eq!(rows(&Results::read(store.path()).unwrap()), rows(&expected));
        let (_, again) = evaluate(store.path(), replaced(frame), baselines()).unwrap();
        assert_eq!((again.evaluated, again.resumed), (0, 6));
    }
    // An unused image changes nothing.
    let store = tempfile::tempdir().unwrap();
    evaluate(store.path(), Walls::new(3, 8), baselines()).unwrap();
    assert_eq!(evaluate(store.path(), replaced(5), baselines()).unwrap().1.evaluated, 0);
}

#[test]
fn a_new_method_on_changed_data_is_rejected_until_the_others_run_too() {
    let [store, fresh] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (before, _) = evaluate(store.path(), Walls::new(3, 8), nearest()).unwrap();
    let error = evaluate(store.path(), replaced(4), vec![Arc::new(Warp)]).unwrap_err();
    assert!(matches!(error, EvalError::DataChanged { count: 1, .. }), "{error}");
    let message = error.to_string();
    assert!(
        message.contains("nearest-view on walls, scene \"wall-1\"") && message.contains("run these methods too"),
        "{message}"
    );
    assert_eq!(rows(&Results::read(store.path()).unwrap()), rows(&before), "nothing was computed");
    let (both, summary) = evaluate(store.path(), replaced(4), baselines()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed), (4, 2));
    assert_eq!(rows(&both), rows(&evaluate(fresh.path(), replaced(4), baselines()).unwrap().0));
    // With unchanged data a new method can be added.
    let (_, joined) = evaluate(fresh.path(), replaced(4), vec![gives(2)]).unwrap();
    assert_eq!(joined.evaluated, 3);
}

/// Scenes of several entries, some of which have results.
#[test]
fn resuming_counts_results_and_warnings_once() {
    let [store, fresh] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let entries = [entry(&[0, 4], &[1, 6]), entry(&[0, 4], &[2]), entry(&[0, 40], &[2])];
    let evaluate = |folder: &tempfile::TempDir, walls: Walls, methods: Vec<Arc<dyn Method>>| {
        Run::new(vec![dataset(Walls { warns: true, ..walls }, &entries)], methods).run(folder.path()).unwrap()
    };
    evaluate(&store, Walls::new(3, 8), nearest());
    let (joined, summary) = evaluate(&store, Walls::new(3, 8), baselines());
    assert_eq!((summary.evaluated, summary.resumed, summary.skipped), (6, 6, 3));
    let (expected, _) = evaluate(&fresh, Walls::new(3, 8), baselines());
    assert_eq!(joined.provenance.warnings, expected.provenance.warnings);
    assert_eq!(joined.provenance.warnings[0].count, 3);
    assert_eq!(joined.provenance.skipped, expected.provenance.skipped);
    // Of the second scene's two trials, one reads frame 6.
    let (_, summary) = evaluate(&store, replaced(6), baselines());
    assert_eq!((summary.evaluated, summary.resumed), (2, 10));
}

/// A method with the poses and planes of a paper's method.
#[derive(Debug)]
struct WithPosesOf(&'static str);

impl Method for WithPosesOf {
    fn record(&self) -> MethodRecord {
        record(self.0)
    }

    fn setting(&self) -> &str {
        self.0
    }

    fn predict<'a>(&'a self, _input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        Ok(Box::new(FixedCount(2)))
    }
}

fn with_poses_of(names: &[&'static str]) -> Vec<Arc<dyn Method>> {
    names.iter().copied().map(|name| Arc::new(WithPosesOf(name)) as Arc<dyn Method>).collect()
}

/// Of a preset in which pixelSplat's poses refuse context views that are closer than half a unit.
fn run_with_least_baseline(walls: Walls, entries: &[IndexEntry], methods: &[&'static str]) -> Run {
    let mut walls = dataset(walls, entries);
    let pixelsplat = walls.preset.methods.iter_mut().find(|setting| setting.method == "pixelSplat").unwrap();
    pixelsplat.pose_normalisation = PoseNormalisation::BaselineOne { minimum: 0.5, maximum: None };
    Run::new(vec![walls], with_poses_of(methods))
}

/// Methods with other poses read every scene again.
#[test]
fn methods_with_other_poses_count_a_scenes_warnings_and_skipped_entries_once() {
    let store = tempfile::tempdir().unwrap();
    let entries = [entry(&[0, 4], &[1, 6]), entry(&[0, 40], &[2, 3])];
    let mut methods: Vec<Arc<dyn Method>> = vec![Arc::new(NearestView)];
    for (poses, evaluated) in [("MVSplat", 6), ("pixelSplat", 3)] {
        methods.push(Arc::new(WithPosesOf(poses)));
        let walls = Walls { warns: true, ..Walls::new(3, 8) };
        let run = Run::new(vec![dataset(walls, &entries)], methods.clone());
        let (results, summary) = run.run(store.path()).unwrap();
        assert_eq!((summary.evaluated, summary.skipped), (evaluated, 3), "{poses}");
        let warnings = &results.provenance.warnings;
        let found = warnings.iter().find(|warning| warning.kind == "off-centre-principal-point").unwrap();
        assert_eq!((found.count, found.example.as_str()), (3, "wall-0: for the test"), "{poses}");
    }
}

/// NoPoSplat's settings are those of another preset. A misspelt name would mean the preset's own.
#[test]
fn a_setting_that_a_preset_lacks_is_rejected_or_noted() {
    let run = |names: &[&'static str]| {
        Run::new(vec![dataset(Walls::new(2, 8), &[entry(&[0, 4], &[1, 6])])], with_poses_of(names))
    };
    let folder = tempfile::tempdir().unwrap();
    let refused = run(&["MVSplat", "MVSplt"]).run(folder.path()).unwrap_err().to_string();
    assert!(refused.contains("\"MVSplt\"") && refused.contains("MVSplat, NoPoSplat"), "{refused}");
    let (results, summary) = run(&["mvsplat", "NoPoSplat", "atsplat"]).run(folder.path()).unwrap();
    let warnings = results.provenance.warnings.iter();
    let warnings = warnings.filter(|warning| warning.kind.contains("the preset's own poses and planes"));
    let counted: Vec<_> = warnings.map(|warning| (warning.count, warning.example.as_str())).collect();
    assert_eq!(counted, [(1, "NoPoSplat names NoPoSplat")]);
    assert_eq!((summary.evaluated, results.gaps()), (6, Vec::new()));
    // The rows stay when other methods run, and so does the warning; each method has another.
    let (again, _) = run(&["mvsplat"]).run(folder.path()).unwrap();
    assert_eq!(again.provenance.warnings, results.provenance.warnings);
    let (both, _) = run(&["YoNoSplat"]).run(folder.path()).unwrap();
    let examples: Vec<&str> = both.provenance.warnings.iter().map(|warning| warning.example.as_str()).collect();
    assert_eq!(examples, ["NoPoSplat names NoPoSplat", "YoNoSplat names YoNoSplat"]);
}

/// pixelSplat's poses refuse the second entry of each scene, whose context views are too close to each other.
#[test]
fn entries_skipped_for_one_methods_poses_are_not_done_for_another() {
    let [store, fresh] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let run = |methods: &[&'static str]| {
        run_with_least_baseline(Walls::new(2, 8), &[entry(&[0, 4], &[1, 6]), entry(&[0, 2], &[1, 3])], methods)
    };
    let both = run(&["pixelSplat", "MVSplat"]);
    let (alone, summary) = run(&["pixelSplat"]).run(store.path()).unwrap();
    assert_eq!((summary.evaluated, summary.skipped, alone.unfinished().len()), (2, 2, 0));
    // A run that is killed before its first trial.
    drop(both.store(store.path()).unwrap());
    let killed = Results::read(store.path()).unwrap().unfinished();
    let left: Vec<_> = killed.iter().map(|run| (run.method.as_str(), run.entries, run.total)).collect();
    assert_eq!(left, [("MVSplat", 0, 4)]);
    // Its poses refuse nothing, and what it records does not replace what the other method's run found.
    let (joined, summary) = run(&["MVSplat"]).run(store.path()).unwrap();
    assert_eq!((summary.evaluated, summary.skipped, joined.unfinished().len()), (4, 0, 0));
    let (expected, _) = both.run(fresh.path()).unwrap();
    assert_eq!(joined.provenance.skipped, expected.provenance.skipped);
    let reasons: Vec<&str> = expected.provenance.skipped.iter().map(|skipped| skipped.reason.as_str()).collect();
    assert_eq!(reasons, ["baseline"; 2]);
}

/// With other cameras, pixelSplat's poses refuse an entry that has a row from the old ones.
#[test]
fn a_row_of_old_cameras_whose_entry_is_skipped_now_stops_the_run() {
    for methods in [&["pixelSplat"][..], &["pixelSplat", "MVSplat"]] {
        let folder = tempfile::tempdir().unwrap();
        let run = |close: bool| {
            let walls = Walls { close, ..Walls::new(1, 8) };
            run_with_least_baseline(walls, &[entry(&[0, 4], &[1, 6])], methods).run(folder.path())
        };
        assert_eq!(run(false).unwrap().0.trials.len(), methods.len());
        let error = run(true).unwrap_err();
        assert!(matches!(error, EvalError::DataChanged { count: 1, .. }), "{error}");
        let text = error.to_string();
        assert!(
            text.contains("pixelSplat") && text.contains("baseline") && text.contains("restore the data"),
            "{text}"
        );
    }
}

/// A context image of one scene, or the ground truth of one of two targets, was cut short after the run; or it always was.
#[test]
fn an_image_that_was_damaged_since_does_not_replace_scores() {
    let damaged = |frame| Walls { damaged: Some((1, frame)), ..Walls::new(3, 8) };
    for (frame, what) in [(4, "a context image: "), (6, "the ground-truth image: ")] {
        let store = tempfile::tempdir().unwrap();
        let (before, _) = evaluate(store.path(), Walls::new(3, 8), baselines()).unwrap();
        let error = evaluate(store.path(), damaged(frame), baselines()).unwrap_err();
        assert!(matches!(error, EvalError::DataChanged { count: 2, .. }), "{error}");
        let text = error.to_string();
        assert!(text.contains("scene \"wall-1\"") && text.contains(what), "{text}");
        assert!(text.contains("restore the data, or choose another folder"), "{text}");
        let (restored, summary) = evaluate(store.path(), Walls::new(3, 8), baselines()).unwrap();
        assert_eq!((summary.evaluated, rows(&restored)), (0, rows(&before)));
    }
    let store = tempfile::tempdir().unwrap();
    let brighter = |frame| Walls { brighter: Some((1, 0, 9)), ..damaged(frame) };
    evaluate(store.path(), damaged(6), baselines()).unwrap();
    let (_, summary) = evaluate(store.path(), brighter(6), baselines()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed), (2, 4), "another image changed: no score is lost");
}

#[test]
fn results_whose_data_are_missing_are_named() {
    let store = tempfile::tempdir().unwrap();
    evaluate(store.path(), Walls::new(3, 8), baselines()).unwrap();
    let fewer = evaluate(store.path(), Walls::new(3, 5), baselines()).unwrap_err().to_string();
    assert!(fewer.contains("frame-out-of-range") && fewer.contains("restore the data"), "{fewer}");
    let mut absent = Walls::new(3, 8);
    absent.keys[2] = "renamed".to_owned();
    let entries = [entry(&[0, 4], &[1, 6])];
    let mut renamed = dataset(absent, &entries);
    renamed.index = dataset(Walls::new(3, 8), &entries).index;
    let settings = Run::new(vec![renamed], baselines());
    let plan = settings.plan();
    let mut provenance = plan.provenance(current_provenance("0", None, Vec::new())).unwrap();
    provenance.presets[0].entries = 3;
    let opened = Store::resume(store.path(), provenance).unwrap();
    let error = run(&plan, opened, &|_| ()).unwrap_err().to_string();
    assert!(error.contains("scene \"wall-2\"") && error.contains("no longer in the data"), "{error}");
}

/// This many images, whatever the number of targets.
struct FixedCount(usize);

impl Prediction for FixedCount {
    fn render(&self, _targets: &[usize]) -> Vec<Result<Rendered, String>> {
        (0..self.0).map(|_| Ok(grey())).collect()
    }
}

fn gives(count: usize) -> Arc<dyn Method> {
    method(&format!("gives {count}"), move |_| Ok(Box::new(FixedCount(count))))
}

#[test]
fn a_wrong_number_of_images_fails_the_trial_with_both_numbers() {
    for given in [0, 1, 3] {
        let store = tempfile::tempdir().unwrap();
        let (results, summary) = evaluate(store.path(), Walls::new(1, 8), vec![gives(given)]).unwrap();
        assert_eq!((results.trials[0].status, summary.incomplete), (TrialStatus::Failed, 1));
        let message = format!("expected an image for each of 2 targets, the method returned {given}");
        assert_eq!(results.trials[0].detail.as_deref(), Some(message.as_str()));
        assert_eq!(results.targets.len(), 2, "every target has its row");
        assert!(
            results.targets.iter().all(|row| row.status == TargetStatus::Failed && row.detail == Some(message.clone()))
        );
    }
    let store = tempfile::tempdir().unwrap();
    let (results, _) = evaluate(store.path(), Walls::new(1, 8), vec![gives(2)]).unwrap();
    assert_eq!(results.gaps(), []);
}

/// A method whose optimisation reproduces the context views.
#[test]
fn an_infinite_psnr_on_the_context_views_is_a_note() {
    let store = tempfile::tempdir().unwrap();
    let exact = method("exact", |_| {
        let cost = Cost { context_psnr: Some(f64::INFINITY), ..Cost::default() };
        Ok(Box::new(Grey { cost, ..Grey::default() }))
    });
    let (results, _) = evaluate(store.path(), Walls::new(1, 8), vec![exact]).unwrap();
    let trial = &results.trials[0];
    assert_eq!((trial.status, trial.context_psnr), (TrialStatus::Done, None));
    assert!(trial.notes.iter().any(|note| note == "the PSNR on the context views is inf"), "{:?}", trial.notes);
}

/// Images that another method wrote are data too.
#[test]
fn imported_images_that_changed_are_scored_again() {
    let [store, renders] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let scene = renders.path().join("wall-0");
    std::fs::create_dir(&scene).unwrap();
    let write = |frame: usize, shade: u8| {
        let image =
            ImageU8::new(SIZE.width, SIZE.height, vec![shade; (SIZE.width * SIZE.height * 3) as usize]).unwrap();
        std::fs::write(scene.join(format!("{frame:06}.png")), encode_png(&image).unwrap()).unwrap();
    };
    let score = || {
        let method: Arc<dyn Method> = Arc::new(Renders::new(renders.path(), Some("theirs")).unwrap());
        evaluate(store.path(), Walls::new(1, 8), vec![method]).unwrap()
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
fn scenes_whose_keys_differ_only_in_punctuation_have_separate_images() {
    let store = tempfile::tempdir().unwrap();
    let mut walls = Walls::new(4, 8);
    walls.keys = ["a/b", "a_b", "A_b", "a%2Fb"].map(str::to_owned).to_vec();
    let settings = Run::new(vec![dataset(walls, &[entry(&[0, 4], &[1, 6])])], nearest());
    let (results, _) = Run { images: KeepImages::All, ..settings }.run(store.path()).unwrap();
    let read = |row: &TargetRow| {
        let bytes = std::fs::read(image_path(store.path(), &row.key, row.frame)).unwrap();
        decode(&bytes, &DecodeLimits::default()).unwrap()
    };
    for row in results.targets.iter().filter(|row| row.frame == 1) {
        let scene = ["a/b", "a_b", "A_b", "a%2Fb"].iter().position(|key| *key == row.key.scene).unwrap();
        assert_eq!(read(row), common::image(scene, 0), "{}: the nearest view is of this scene", row.key.scene);
    }
}

/// Path of an image in a store.
fn stored(store: &Path, method: &str, scene: usize, frame: u64) -> PathBuf {
    let (preset, method, scene) = ("walls".to_owned(), method.to_owned(), format!("wall-{scene}"));
    image_path(store, &TrialKey { preset, method, scene, entry: 0 }, frame)
}

#[test]
fn images_that_are_asked_for_later_are_added() {
    let store = tempfile::tempdir().unwrap();
    let run = |keep| {
        let walls = Walls { damaged: Some((2, 6)), ..Walls::new(3, 8) };
        let settings = Run::new(vec![dataset(walls, &[entry(&[0, 4], &[1, 6])])], nearest());
        let (results, summary) = Run { images: keep, ..settings }.run(store.path()).unwrap();
        (results, (summary.evaluated, summary.resumed))
    };
    let image = |scene, frame| stored(store.path(), "nearest-view", scene, frame);
    let (before, counts) = run(KeepImages::Nothing);
    assert_eq!((counts, image(1, 6).exists()), ((3, 0), false));
    let (after, counts) = run(KeepImages::All);
    assert_eq!((counts, rows(&after)), ((3, 0), rows(&before)), "evaluated again, with the same numbers");
    let compared = after.targets.iter().filter(|row| row.status != TargetStatus::Failed);
    let mut paths = compared.map(|row| image_path(store.path(), &row.key, row.frame));
    assert!(paths.all(|path| path.is_file()) && stored(store.path(), "truth", 1, 6).is_file());
    // Its ground truth is damaged, so it was not compared.
    std::fs::remove_file(image(2, 6)).unwrap();
    assert_eq!(run(KeepImages::All).1, (0, 3));
    std::fs::remove_file(image(1, 6)).unwrap();
    // As file managers leave them.
    let path = image(1, 6);
    let folder = path.ancestors().find(|folder| folder.ends_with("nearest-view")).unwrap();
    std::fs::write(folder.join(".DS_Store"), "").unwrap();
    assert_eq!(run(KeepImages::Worst).1, (0, 3), "they keep what there is");
    assert_eq!(run(KeepImages::All).1, (1, 2));
    assert!(image(1, 6).is_file());
}

/// In object storage, after a writer was killed between two uploads.
#[test]
fn old_images_next_to_new_rows_are_replaced() {
    let store = tempfile::tempdir().unwrap();
    let run = |replaced: &[(usize, usize)]| {
        let walls = Walls { replaced: replaced.to_vec(), ..Walls::new(2, 8) };
        let settings = Run::new(vec![dataset(walls, &[entry(&[0, 4], &[6])])], nearest());
        Run { images: KeepImages::All, ..settings }.run(store.path()).unwrap().1.evaluated
    };
    let files = [("truth", 6), ("nearest-view", 6), ("context", 4)];
    let files = files.map(|(method, frame)| stored(store.path(), method, 1, frame));
    let read = || files.each_ref().map(|file| std::fs::read(file).unwrap());
    let replaced = [(1, 4), (1, 6)];
    assert_eq!(run(&[]), 2);
    let before = read();
    assert_eq!(run(&replaced), 1);
    let after = read();
    for ((file, old), new) in files.iter().zip(&before).zip(&after) {
        assert_ne!(old, new);
        std::fs::write(file, old).unwrap();
        assert_eq!(run(&replaced), 1, "{}", file.display());
        assert_eq!(std::fs::read(file).unwrap(), *new);
    }
    assert_eq!(run(&replaced), 0);
}

/// A page shows a row with the image in its place, so that may not be another row's.
#[test]
fn images_of_replaced_rows_are_removed() {
    let [store, renders] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let render = |scene: usize, shade: u8| {
        let samples = vec![shade; (SIZE.width * SIZE.height * 3) as usize];
        let image = ImageU8::new(SIZE.width, SIZE.height, samples).unwrap();
        let folder = renders.path().join(format!("wall-{scene}"));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("000006.png"), encode_png(&image).unwrap()).unwrap();
        image
    };
    let run = |replaced: &[(usize, usize)], keep| {
        let walls = Walls { replaced: replaced.to_vec(), ..Walls::new(2, 8) };
        let theirs: Arc<dyn Method> = Arc::new(Renders::new(renders.path(), Some("theirs")).unwrap());
        let settings = Run::new(vec![dataset(walls, &[entry(&[0, 4], &[6])])], vec![theirs, Arc::new(NearestView)]);
        Run { images: keep, ..settings }.run(store.path()).unwrap().1.evaluated
    };
    let there = |scene| {
        let images = [("theirs", 6), ("nearest-view", 6), ("truth", 6), ("context", 4)];
        images.map(|(method, frame)| stored(store.path(), method, scene, frame).is_file())
    };
    render(0, 100);
    render(1, 100);
    assert_eq!(run(&[], KeepImages::All), 4);
    assert_eq!([there(0), there(1)], [[true; 4]; 2]);
    render(0, 200);
    assert_eq!(run(&[], KeepImages::Nothing), 1);
    assert_eq!([there(0), there(1)], [[false, true, true, true], [true; 4]], "only what the row was made with");
    // Other data: every method's images of the trial, and the data's own.
    assert_eq!(run(&[(1, 6)], KeepImages::Nothing), 2);
    assert_eq!([there(0), there(1)], [[false, true, true, true], [false; 4]]);
    let shown = render(1, 50);
    assert_eq!(run(&[(1, 6)], KeepImages::All), 3);
    assert_eq!([there(0), there(1)], [[true; 4]; 2]);
    let read = |method| decode(&std::fs::read(stored(store.path(), method, 1, 6)).unwrap(), &DecodeLimits::default());
    assert_eq!((read("theirs").unwrap(), read("truth").unwrap()), (shown, common::image(101, 6)));
}
