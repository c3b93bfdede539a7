//! Trials that are prepared ahead.

use atsplat_tests::on_threads;

use super::*;

fn many_scenes() -> (Vec<Scene>, EvaluationIndex) {
    let scenes: Vec<Scene> = (0..24u8).map(|number| scene(&format!("scene {number}"), 12, number)).collect();
    let entries = |number: usize| match number % 6 {
        0 => Vec::new(),
        1 => vec![entry(&[0, 4], &[2]), entry(&[1, 9], &[2, 11])],
        2 => vec![entry(&[0, 40], &[2])],
        _ => vec![entry(&[0, 6], &[0, 3, 9])],
    };
    let index = scenes.iter().enumerate().map(|(number, scene)| (scene.key.clone(), entries(number))).collect();
    (scenes, EvaluationIndex { scenes: index })
}

/// Everything a consumer can observe, in order.
fn observed(threads: usize, prefetch: Prefetch) -> (Vec<String>, SkipReport, u64) {
    let (scenes, index) = many_scenes();
    on_threads(threads, || {
        let mut trials = Trials::new(Arc::new(MemorySource::new(scenes)), &index, recipe(), prefetch);
        let seen = trials.by_ref().map(|outcome| match outcome {
            Ok((trial, images)) => {
                let colours: Vec<_> = (0..images.len())
                    .map(|position| images.get(position).unwrap().unwrap().pixel(1, 1).unwrap())
                    .chain(trial.context().iter().map(|view| view.image().unwrap().pixel(1, 1).unwrap()))
                    .collect();
                format!("{} {} {} {colours:?}", trial.scene(), trial.entry_number(), trial.hash())
            }
            Err(skipped) => skipped.to_string(),
        });
        let seen = seen.collect();
        (seen, trials.report().clone(), trials.peak_bytes())
    })
}

#[test]
fn order_and_content_do_not_depend_on_threads_and_bounds() {
    let (reference, report, peak) = observed(1, Prefetch { trials: 0, ..Prefetch::default() });
    assert_eq!((reference.len(), report.trials, report.skipped.len()), (24, 20, 8));
    assert!(peak > 0, "a trial prepared on demand decodes all its images at once");
    for threads in [1, 2, 5] {
        for trials in [1, 3, 64] {
            for decode in [DecodeAhead::Nothing, DecodeAhead::Context, DecodeAhead::All] {
                for max_bytes in [0, 20_000, u64::MAX] {
                    let prefetch = Prefetch { trials, decode, max_bytes };
                    let (seen, skips, peak) = observed(threads, prefetch);
                    assert_eq!(seen, reference, "{threads} threads, {prefetch:?}");
                    assert_eq!(skips, report, "{threads} threads, {prefetch:?}");
                    assert!(peak <= max_bytes, "{peak} bytes, {prefetch:?}");
                }
            }
        }
    }
}

/// With a slow consumer, the iterator runs ahead up to its bound and then stops.
#[test]
fn loads_no_more_scenes_ahead_than_the_bound() {
    let (scenes, _) = many_scenes();
    let each_once = EvaluationIndex {
        scenes: scenes.iter().map(|scene| (scene.key.clone(), vec![entry(&[0, 6], &[3])])).collect(),
    };
    let source = Arc::new(MemorySource::new(scenes));
    let taken = on_threads(4, || {
        let prefetch = Prefetch { trials: 3, ..Prefetch::default() };
        let trials =
            Trials::new(Arc::clone(&source) as Arc<dyn atsplat_scene::SceneSource>, &each_once, recipe(), prefetch);
        let mut taken = 0;
        for trial in trials {
            assert!(trial.is_ok());
            taken += 1;
            std::thread::sleep(std::time::Duration::from_millis(5));
            let loads = source.loads.load(Ordering::SeqCst);
            assert!(loads <= taken + 3, "{loads} scenes loaded after {taken} were taken");
        }
        taken
    });
    assert_eq!((taken, source.loads.load(Ordering::SeqCst)), (24, 24));
}

/// The budget is never exceeded, whether the iterator or its consumer holds the images.
#[test]
fn kept_trials_count_against_the_budget() {
    let (scenes, index) = many_scenes();
    let one_image = 32 * 32 * 3;
    let prefetch = Prefetch { trials: 4, decode: DecodeAhead::All, max_bytes: one_image * 9 };
    let mut trials = Trials::new(Arc::new(MemorySource::new(scenes)), &index, recipe(), prefetch);
    let kept: Vec<_> = trials.by_ref().collect();
    assert_eq!(kept.len(), 24);
    let peak = trials.peak_bytes();
    assert!(peak <= one_image * 9 && peak >= one_image * 3, "{peak}");
}

/// With several threads, entries prepared at the same time may each load their scene; one of the loads is kept.
#[test]
fn a_scene_is_shared_by_all_its_entries() {
    let index = index(&[("s", vec![entry(&[0, 4], &[2]), entry(&[1, 5], &[2]), entry(&[2, 6], &[3])])]);
    for (prefetch, most_loads) in [(Prefetch::NONE, 1), (Prefetch::default(), 3)] {
        let source = Arc::new(MemorySource::new([scene("s", 12, 1)]));
        let mut trials =
            Trials::new(Arc::clone(&source) as Arc<dyn atsplat_scene::SceneSource>, &index, recipe(), prefetch);
        assert_eq!(trials.by_ref().flatten().count(), 3);
        let loads = source.loads.load(Ordering::SeqCst);
        assert!((1..=most_loads).contains(&loads), "{loads} loads with {prefetch:?}");
        assert_eq!(trials.warnings().count(WarningKind::LensDistortion), 1, "its warnings are reported once");
    }
}
