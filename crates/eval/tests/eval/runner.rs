//! Runs: rows for every outcome, resuming, shards, threads.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::methods::{counted_method, method};
use crate::common::{Run, SIZE, Walls, baselines, dataset, entry, rows, suite, write_zero_weights};
use atsplat_eval::method::{Method, MethodError, Prediction, Rendered, Warp};
use atsplat_eval::runner::{IndexNotice, KeepImages, Missing, PlannedIndex, Selection, current_provenance};
use atsplat_metrics::learned::LpipsNetwork;
use atsplat_pixels::Image;
use atsplat_protocol::{KnownIndex, SamplingRule};
use atsplat_results::store::images::image_path;
use atsplat_results::{
    Gap, GapKind, IDENTICAL, Results, RunReport, RunWarning, Shard, TargetStatus, TrialKey, TrialStatus,
};
use atsplat_scene::Warnings;
use atsplat_tests::on_threads;

/// Fails in a different way in each of the first scenes, and counts its calls.
fn faulty() -> (Arc<dyn Method>, Arc<AtomicUsize>) {
    counted_method("faulty", |input| match input.trial.scene() {
        "wall-0" => Err(MethodError::NotApplicable("two views are too few".to_owned())),
        "wall-1" => Err(MethodError::Failed("out of memory".to_owned())),
        #[expect(clippy::panic, reason = "the test covers panics in methods")]
        "wall-2" => panic!("a bug"),
        scene => Ok(Box::new(FaultyPrediction(scene.to_owned()))),
    })
}

struct FaultyPrediction(String);

impl Prediction for FaultyPrediction {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let samples = |sample: f32, width: u32| vec![sample; (width * SIZE.height * 3) as usize];
        let image = |sample, width| Image::new(width, SIZE.height, samples(sample, width)).unwrap();
        let one = |target: &usize| match (self.0.as_str(), target) {
            ("wall-3", 0) => Err("no image".to_owned()),
            ("wall-4", 0) => Ok(image(f32::NAN, SIZE.width)),
            ("wall-5", 0) => Ok(image(0.5, SIZE.width - 1)),
            _ => Ok(image(0.5, SIZE.width)),
        };
        let rendered = |image| Rendered { image, drawn: None, effects: Vec::new() };
        targets.iter().map(|target| one(target).map(rendered)).collect()
    }
}

/// Renders of one grey value each, in which this many Gaussians are drawn; `None` for one that fails.
type Greys = [Option<(f32, Option<u64>)>; 3];

struct Plain(Greys);

fn plain(renders: Greys) -> Arc<dyn Method> {
    method("plain", move |_| Ok(Box::new(Plain(renders))))
}

impl Prediction for Plain {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let one = |target: &usize| {
            let (value, drawn) = self.0[*target].ok_or("no image")?;
            let samples = vec![value; (SIZE.width * SIZE.height * 3) as usize];
            let image = Image::new(SIZE.width, SIZE.height, samples).unwrap();
            Ok(Rendered { image, drawn, effects: Vec::new() })
        };
        targets.iter().map(one).collect()
    }
}

fn settings(walls: Walls, methods: Vec<Arc<dyn Method>>) -> Run {
    let datasets = vec![dataset(walls, &[entry(&[0, 4], &[1, 4, 6])])];
    Run { suite: suite(&["psnr", "ssim", "lpips"]), ..Run::new(datasets, methods) }
}

fn key(method: &str, scene: usize) -> TrialKey {
    TrialKey { preset: "walls".to_owned(), method: method.to_owned(), scene: format!("wall-{scene}"), entry: 0 }
}

#[test]
fn baselines_have_complete_rows() {
    let folder = tempfile::tempdir().unwrap();
    let (results, summary) = settings(Walls::new(3, 8), baselines()).run(folder.path()).unwrap();
    assert_eq!((results.trials.len(), results.targets.len()), (6, 18));
    assert_eq!((summary.evaluated, results.gaps()), (6, Vec::new()));
    for trial in &results.trials {
        assert_eq!((trial.status, &trial.context[..], trial.targets), (TrialStatus::Done, &[0, 4][..], 3));
        assert_eq!((trial.width, trial.height, trial.overlap), (64, 64, Some(0.5)));
        assert_eq!(trial.trial_hash.len(), 64);
    }
    let of = |method: &str, target: usize| {
        results.targets.iter().find(|row| row.key == key(method, 1) && row.target as usize == target).unwrap()
    };
    let leaked = of("nearest-view", 1);
    assert!(leaked.leaked && leaked.status == TargetStatus::Identical && leaked.not_computed["psnr"] == IDENTICAL);
    assert_eq!((of("warp", 2).signed_distance, of("warp", 2).frame), (2, 6));
    assert_eq!(of("warp", 0).truth_hash, of("nearest-view", 0).truth_hash);
    assert!(of("warp", 0).scores["psnr"] > of("nearest-view", 0).scores["psnr"]);
    assert_eq!(of("warp", 0).not_computed["lpips"], "weights absent");
    let lpips = results.provenance.metrics.iter().find(|metric| metric.id == "lpips").unwrap();
    assert!(lpips.absent.as_ref().unwrap().contains("vgg16"), "instructions are in the provenance");
    assert_eq!(Results::read(folder.path()).unwrap(), results);
}

#[test]
fn every_outcome_is_a_row() {
    let walls = Walls { damaged: Some((6, 0)), ..Walls::new(8, 8) };
    let folder = tempfile::tempdir().unwrap();
    let (results, summary) = settings(walls, vec![faulty().0]).run(folder.path()).unwrap();
    let trial = |scene: usize| &results.trials[scene];
    let expected = [
        (TrialStatus::NotApplicable, "two views are too few"),
        (TrialStatus::Failed, "out of memory"),
        (TrialStatus::Failed, "the method panicked: a bug"),
        (TrialStatus::Partial, "1 of 3 targets failed: no image"),
        (TrialStatus::Done, ""),
        (TrialStatus::Partial, "expected an image of 64×64, found 63×64"),
        (TrialStatus::Failed, "a context image"),
        (TrialStatus::Done, ""),
    ];
    for (scene, (status, detail)) in expected.into_iter().enumerate() {
        let found = trial(scene);
        assert_eq!(found.status, status, "{found:?}");
        assert!(found.detail.clone().unwrap_or_default().contains(detail), "{found:?}");
    }
    assert_eq!(results.targets.len(), 24, "every target has its row");
    let refused = results.targets.iter().find(|row| row.key == key("faulty", 0)).unwrap();
    assert_eq!(refused.status, TargetStatus::Failed);
    assert!(refused.detail.as_ref().unwrap().contains("too few"));
    let nan = results.targets.iter().find(|row| row.key == key("faulty", 4)).unwrap();
    assert_eq!((nan.status, nan.non_finite, nan.scores.len()), (TargetStatus::NonFinite, 64 * 64 * 3, 0));
    assert_eq!((summary.incomplete, summary.not_applicable, summary.non_finite), (5, 1, 1));
    let gaps: Vec<_> = results.gaps().iter().map(|gap| (gap.kind, gap.count)).collect();
    assert_eq!(gaps, [(GapKind::Incomplete, 5), (GapKind::NonFinite, 1)]);
}

/// One scene that the method does not support, and then one in which it fails.
#[test]
fn what_a_method_does_not_support_is_not_a_failure() {
    let run_on = |scenes| {
        let folder = tempfile::tempdir().unwrap();
        let run = settings(Walls::new(scenes, 8), vec![faulty().0]);
        let (results, summary) = run.run(folder.path()).unwrap();
        let text = RunReport::of(&results, Some(summary), folder.path()).to_string();
        (text, summary, results.gaps().len(), run.plan().nothing_evaluated(&results))
    };
    let (text, summary, gaps, why) = run_on(1);
    assert_eq!((summary.incomplete, summary.not_applicable, gaps, why), (0, 1, 0, None));
    for line in [
        "  3 not applicable\n",
        "walls: 1 trial of faulty not applicable: scene wall-0: two views are too few\n",
        "; 1 not applicable, each with its reason",
    ] {
        assert!(text.contains(line) && !text.contains("of faulty failed"), "{line}: {text}");
    }
    let (text, summary, gaps, why) = run_on(2);
    assert_eq!((summary.incomplete, summary.not_applicable, gaps), (1, 1, 1));
    assert_eq!(why.as_deref(), Some("all of 3 targets failed, the first with: out of memory"));
    assert!(text.contains("  3 failed  3 not applicable\n") && text.contains("3 targets of faulty failed: "), "{text}");
}

/// Renders are scored whatever they show, and the trial notes which are hardly meant.
#[test]
fn renders_without_gaussians_or_colour_are_noted() {
    let notes = |renders| {
        let folder = tempfile::tempdir().unwrap();
        let (results, _) = settings(Walls::new(1, 8), vec![plain(renders)]).run(folder.path()).unwrap();
        let scored = results.targets.iter().filter(|row| row.status == TargetStatus::Scored).count();
        assert_eq!(scored, renders.iter().flatten().count());
        results.trials[0].notes.clone()
    };
    let background = "no Gaussian is drawn: 1 of 3 renders show the background; do the Gaussians belong to this scene, its \
                      axes and its unit of length?";
    let colour = |count: usize| format!("renders without colour: {count} of 3, where the ground truth has colours");
    assert_eq!(notes([Some((0.0, Some(0))), Some((0.5, Some(7))), Some((0.5, None))]), [background, &colour(2)]);
    assert_eq!(notes([None, Some((0.5, None)), None]), [colour(1)]);
}

#[test]
fn targets_without_a_score_are_not_evaluated() {
    let nothing = |renders| {
        let folder = tempfile::tempdir().unwrap();
        let run = settings(Walls::new(2, 8), vec![plain(renders)]);
        let (results, _) = run.run(folder.path()).unwrap();
        run.plan().nothing_evaluated(&results)
    };
    let [nan, good] = [Some((f32::NAN, None)), Some((0.5, None))];
    assert_eq!(nothing([nan, None, good]), None);
    let starts = |renders, expected: &str| {
        let found = nothing(renders).unwrap();
        assert!(found.starts_with(expected), "{found}");
    };
    starts([nan; 3], "all of 6 targets have non-finite samples, the first with: 12288 in the render");
    starts([None; 3], "all of 6 targets failed, the first with: no image");
    starts([nan, None, nan], "of 6 targets, 4 have non-finite samples and the others failed, the first with: 12288");
}

/// A ground-truth image that cannot be read fails only its target.
#[test]
fn a_damaged_ground_truth_is_a_failed_target() {
    let walls = Walls { damaged: Some((0, 6)), ..Walls::new(2, 8) };
    let folder = tempfile::tempdir().unwrap();
    let (results, _) = settings(walls, baselines()).run(folder.path()).unwrap();
    let row = results.targets.iter().find(|row| row.key == key("warp", 0) && row.frame == 6).unwrap();
    assert_eq!((row.status, row.truth_hash.is_none()), (TargetStatus::Failed, true));
    assert!(row.detail.as_ref().unwrap().contains("the ground-truth image"), "{row:?}");
    assert_eq!(results.trials.iter().filter(|trial| trial.status == TrialStatus::Partial).count(), 2);
}

#[test]
fn existing_results_are_not_recomputed() {
    let folder = tempfile::tempdir().unwrap();
    let (faulty, calls) = faulty();
    let run = settings(Walls::new(8, 8), vec![Arc::clone(&faulty)]);
    let first = run.run(folder.path()).unwrap();
    assert_eq!(calls.load(Ordering::Relaxed), 8);
    let second = run.run(folder.path()).unwrap();
    assert_eq!(calls.load(Ordering::Relaxed), 8);
    assert_eq!(rows(&first.0), rows(&second.0));
    assert_eq!((second.1.resumed, second.1.evaluated), (8, 0));
    // Another method is added to the same store.
    let mut more = settings(Walls::new(8, 8), baselines());
    more.methods.push(faulty);
    let (joined, summary) = more.run(folder.path()).unwrap();
    assert_eq!((summary.resumed, summary.evaluated, joined.provenance.methods.len()), (8, 16, 3));
    assert_eq!(calls.load(Ordering::Relaxed), 8);
}

#[test]
fn a_changed_entry_is_recomputed_and_a_changed_protocol_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let mut run = settings(Walls::new(2, 8), baselines());
    run.run(folder.path()).unwrap();
    // Other target frames under the same index hash.
    let shifted = entry(&[0, 4], &[2, 4, 6]);
    run.datasets[0].index.index.scenes["wall-1"] = vec![shifted];
    let (results, summary) = run.run(folder.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed), (2, 2));
    let frames: Vec<u64> =
        results.targets.iter().filter(|row| row.key == key("warp", 1)).map(|row| row.frame).collect();
    assert_eq!(frames, [2, 4, 6]);
    run.datasets[0].preset.renderer.dilation = 0.1;
    let error = run.run(folder.path()).unwrap_err().to_string();
    assert!(error.contains("of the two runs differ") && error.contains("another folder"), "{error}");
}

#[test]
fn merged_shards_equal_one_run_on_any_number_of_threads() {
    let whole = tempfile::tempdir().unwrap();
    let (whole, _) = settings(Walls::new(7, 8), baselines()).run(whole.path()).unwrap();
    let shard = |number| {
        let mut run = settings(Walls::new(7, 8), baselines());
        run.selection.shard = Some(Shard { number, count: 3 });
        let folder = tempfile::tempdir().unwrap();
        on_threads(number as usize, || run.run(folder.path())).unwrap().0
    };
    let merged = Results::merge([2, 3, 1].map(shard).to_vec()).unwrap();
    assert_eq!(merged.missing_shards, [] as [u32; 0]);
    assert_eq!(rows(&merged.results), rows(&whole));
    assert_eq!(merged.results.provenance.presets[0].entries, whole.provenance.presets[0].entries);
}

#[test]
fn a_limit_spreads_over_scenes_and_missing_scenes_are_reported() {
    let mut run = settings(Walls::new(9, 8), baselines());
    run.selection.limit = Some(3);
    run.datasets[0].index.index.scenes.insert("gone".to_owned(), vec![entry(&[0, 4], &[1])]);
    run.datasets[0].index.index.scenes.insert("wall-8".to_owned(), vec![entry(&[0, 400], &[1])]);
    let folder = tempfile::tempdir().unwrap();
    let (results, summary) = run.run(folder.path()).unwrap();
    let scenes: Vec<&str> = results.trials.iter().map(|trial| trial.key.scene.as_str()).collect();
    assert_eq!(scenes, ["wall-0", "wall-3", "wall-6", "wall-0", "wall-3", "wall-6"]);
    let gap = Gap {
        preset: "walls".to_owned(),
        method: None,
        kind: GapKind::MissingScenes,
        count: 1,
        first: "gone".to_owned(),
    };
    assert_eq!((summary.missing_scenes, results.gaps()), (1, vec![gap]));
    let record = &results.provenance.presets[0];
    assert_eq!((record.entries, record.entries_of_index, record.scenes_of_index), (3, 10, Some(10)));
    run.selection.limit = None;
    let all = tempfile::tempdir().unwrap();
    let (results, summary) = run.run(all.path()).unwrap();
    assert_eq!((summary.skipped, results.provenance.skipped[0].reason.as_str()), (1, "frame-out-of-range"));
    assert_eq!(results.trials.len(), 16);
}

/// Two entries of a published index have no trial, five scenes of the data are not sampled, and three entries were rejected by the
/// sampler itself.
#[test]
fn what_an_index_leaves_out_is_a_warning() {
    let notice = |count, missing| IndexNotice { count, example: "wall-x".to_owned(), missing };
    let mut run = settings(Walls::new(4, 8), baselines());
    run.datasets[0].index.notices.insert("rejected".to_owned(), notice(3, Missing::Nothing));
    let found = |run: &Run| {
        let folder = tempfile::tempdir().unwrap();
        let (results, summary) = run.run(folder.path()).unwrap();
        let warnings = results.provenance.warnings.iter();
        let counted = warnings.map(|warning| (warning.kind.clone(), warning.count)).collect::<Vec<_>>();
        (counted, [summary.skipped, summary.not_sampled], results.gaps().len())
    };
    let of = |kind: &str, count| (kind.to_owned(), count);
    let rejected = of("rejected", 3);
    assert_eq!(found(&run), (vec![rejected.clone()], [0, 0], 0));
    let not_sampled = RunWarning::WithoutEntry.to_string();
    run.datasets[0].index.notices.insert(not_sampled.clone(), notice(5, Missing::Data));
    assert_eq!(found(&run), (vec![rejected.clone(), of(&not_sampled, 5)], [0, 5], 1));
    let dropped = RunWarning::DroppedBySplit.about("too short");
    run.datasets[0].index.notices.insert(dropped.clone(), notice(2, Missing::Entries));
    assert_eq!(found(&run), (vec![of(&dropped, 2), rejected, of(&not_sampled, 5)], [2, 5], 2));
    let parts = [1, 2, 3].map(|number| {
        run.selection.shard = Some(Shard { number, count: 3 });
        found(&run)
    });
    let lacking = |at: usize| parts.iter().map(|(_, lacking, _)| lacking[at]).sum::<u64>();
    assert_eq!([lacking(0), lacking(1)], [2, 5], "each is counted by one shard");
    let kinds = parts.iter().flat_map(|(counted, ..)| counted);
    assert_eq!(kinds.map(|(_, count)| count).sum::<u64>(), 10);
}

#[test]
fn requested_images_are_kept() {
    for keep in [KeepImages::All, KeepImages::Worst] {
        let folder = tempfile::tempdir().unwrap();
        let run = Run { images: keep, ..settings(Walls::new(12, 8), vec![Arc::new(Warp)]) };
        let (results, _) = run.run(folder.path()).unwrap();
        let stored = |method: &str, frame| {
            (0..12).filter(|scene| image_path(folder.path(), &key(method, *scene), frame).is_file()).count()
        };
        let mut trials: Vec<(f64, bool)> = Vec::new();
        for trial in &results.trials {
            let rows = results.targets.iter().filter(|row| row.key == trial.key);
            let psnr: Vec<f64> = rows.clone().map(|row| row.scores["psnr"]).collect();
            let are_kept = rows.clone().all(|row| image_path(folder.path(), &row.key, row.frame).is_file());
            trials.push((psnr.iter().sum::<f64>() / psnr.len() as f64, are_kept));
        }
        trials.sort_by(|a, b| a.0.total_cmp(&b.0));
        let kept: Vec<bool> = trials.iter().map(|(_, is_kept)| *is_kept).collect();
        let scenes = kept.iter().filter(|is_kept| **is_kept).count();
        assert_eq!(
            [stored("warp", 1), stored("truth", 6), stored("context", 0), stored("context", 1)],
            [scenes, scenes, scenes, 0]
        );
        match keep {
            KeepImages::Worst => {
                assert!((8..=10).contains(&scenes), "{scenes} are kept");
                assert!(kept[..6].iter().all(|is_kept| *is_kept), "the worst: {kept:?}");
                assert!(kept[10..].iter().all(|is_kept| *is_kept), "the best: {kept:?}");
            }
            _ => assert_eq!(scenes, 12),
        }
    }
}

#[test]
fn rejects_duplicate_names_and_invalid_shards() {
    let run = settings(Walls::new(1, 8), vec![Arc::new(Warp), Arc::new(Warp)]);
    let error = run.plan().provenance(current_provenance("0", None, Vec::new())).unwrap_err().to_string();
    assert!(error.contains("warp twice"), "{error}");
    let mut run = settings(Walls::new(1, 8), baselines());
    run.selection.shard = Some(Shard { number: 4, count: 3 });
    assert!(run.plan().provenance(current_provenance("0", None, Vec::new())).is_err());
}

/// DepthSplat's rule takes every frame of a window; frames whose image is missing are not counted.
#[test]
fn a_sampled_index_contains_only_existing_images() {
    let walls = Walls { gaps: true, ..Walls::new(1, 60) };
    let rule = SamplingRule::resolve("dl3dv-6v").unwrap();
    let index = PlannedIndex::sampled("dl3dv-6v", &rule, &walls, &mut Warnings::new()).unwrap();
    let entry = &index.index.scenes["wall-0"][0];
    assert_eq!((entry.context.len(), entry.target.len()), (6, 50));
    assert!(entry.context.iter().chain(&entry.target).all(|frame| frame % 7 != 3), "{entry:?}");
    assert_eq!(entry.target.last(), Some(&57), "50 images reach beyond frame 49");
    let whole = PlannedIndex::sampled("dl3dv-6v", &rule, &Walls::new(1, 60), &mut Warnings::new()).unwrap();
    assert_eq!(whole.index.scenes["wall-0"][0].target, (0..50).collect::<Vec<_>>());
    assert_eq!(whole.description, "sampled by dl3dv-6v");
    let none = PlannedIndex::sampled("dl3dv-6v", &rule, &Walls::new(2, 5), &mut Warnings::new()).unwrap();
    assert_eq!(none.description, "sampled by dl3dv-6v; scenes without an entry: 2 too-few-frames");
}

/// Changes a context image and then a target image: drift names exactly that scene and frame. Ten reruns on the same
/// images are not drift.
#[test]
fn drift_names_the_image_that_changed() {
    use atsplat_drift::{Acceptance, Baseline, DriftVerdict, ImageRole, compare};
    let of = |brighter| {
        let folder = tempfile::tempdir().unwrap();
        let walls = Walls { brighter, ..Walls::new(3, 8) };
        settings(walls, baselines()).run(folder.path()).unwrap().0
    };
    let acceptance = Acceptance {
        date: "2026-01-01".to_owned(),
        reason: "the first numbers".to_owned(),
        atsplat: "0.1.0".to_owned(),
        commit: None,
    };
    let baseline = Baseline::new(&of(None), &[], acceptance);
    for _ in 0..10 {
        let calm = compare(&of(None), &baseline);
        assert_eq!((calm.verdict, calm.data.compared, calm.data.unknown), (DriftVerdict::Same, 3 * 4, 0), "{calm}");
    }
    for (frame, by, roles) in [
        (0, 9, vec![ImageRole::Context]),
        (0, -9, vec![ImageRole::Context]),
        (4, 9, vec![ImageRole::Context, ImageRole::Target]),
        (6, -9, vec![ImageRole::Target]),
    ] {
        let report = compare(&of(Some((1, frame, by))), &baseline);
        let [image] = &report.data.changed[..] else { panic!("one image: {report}") };
        assert_eq!((image.scene.as_str(), image.frame), ("wall-1", frame as u64), "{report}");
        assert_eq!(image.roles.iter().copied().collect::<Vec<_>>(), roles, "{report}");
        assert_eq!(report.verdict, DriftVerdict::Drifted, "{report}");
    }
}

/// ACID's index on RE10K's data, which have two of its five scenes.
#[test]
fn entries_of_anothers_index_count_whether_or_not_the_data_have_their_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let counted = |shard: Option<Shard>, store: &str| {
        let mut walls = dataset(Walls::new(2, 8), &[entry(&[0, 4], &[1])]);
        walls.index.sha256 = KnownIndex::by_name("pixelsplat-acid").unwrap().sha256;
        let absent = ["a", "b", "c"].map(|scene| (scene.to_owned(), vec![entry(&[0, 4], &[1])]));
        walls.index.index.scenes.extend(absent);
        let run = Run::new(vec![walls], baselines());
        let selection = Selection { shard, ..run.selection };
        let (results, _) = Run { selection, ..run }.run(&folder.path().join(store)).unwrap();
        let warnings = results.provenance.warnings.into_iter();
        let of_acid = warnings.filter(|warning| warning.kind.contains("another dataset's index"));
        of_acid.map(|warning| warning.count).collect::<Vec<_>>()
    };
    let part = |number| Some(Shard { number, count: 2 });
    assert_eq!([counted(None, "whole"), counted(part(1), "first"), counted(part(2), "second")], [[5], [2], [3]]);
}

/// Weights of another training under the published name: the numbers are of another metric, whatever the table calls it.
#[test]
fn weights_of_a_metric_that_are_not_the_published_ones_are_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let file = write_zero_weights(folder.path(), LpipsNetwork::LpipsAlex);
    let run = settings(Walls::new(2, 8), baselines());
    let suite = atsplat_eval::runner::suite(&run.datasets, &["lpips-alex".to_owned()], Some(folder.path())).unwrap();
    let (results, _) = Run { suite, ..run }.run(&folder.path().join("store")).unwrap();
    let warnings = results.provenance.warnings.iter();
    let found: Vec<_> = warnings.filter(|warning| RunWarning::UnpublishedWeights.is_of(&warning.kind)).collect();
    let [warning] = &found[..] else { panic!("{:?}", results.provenance.warnings) };
    assert_eq!((warning.preset.as_str(), warning.count), ("walls", 1));
    for part in ["LPIPS (Alex)", "7be5be79…", &file.display().to_string()] {
        assert!(warning.example.contains(part), "{part}: {}", warning.example);
    }
}
