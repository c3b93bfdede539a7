//! Which renders a run keeps.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::methods::method;
use crate::common::{Run, SIZE, Walls, dataset, entry, grey};
use atsplat_eval::method::{Prediction, Rendered};
use atsplat_eval::runner::KeepImages;
use atsplat_pixels::Image;
use atsplat_results::TrialStatus;
use atsplat_results::store::images::image_path;

/// Renders its second target differently each time.
#[derive(Default)]
struct Unsteady {
    renders: AtomicUsize,
}

impl Prediction for Unsteady {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let one = |target: &usize| {
            let mut rendered = grey();
            if *target == 1 {
                let times = self.renders.fetch_add(1, Ordering::Relaxed);
                let samples = rendered.image.samples().iter().map(|sample| sample + times as f32 / 8.0).collect();
                rendered.image = Image::new(SIZE.width, SIZE.height, samples).unwrap();
            }
            Ok(rendered)
        };
        targets.iter().map(one).collect()
    }
}

#[test]
fn an_image_that_is_rendered_again_is_kept_only_if_it_is_the_scored_one() {
    let folder = tempfile::tempdir().unwrap();
    let datasets = vec![dataset(Walls::new(1, 8), &[entry(&[0, 4], &[2, 3, 6])])];
    let unsteady = method("unsteady", |_| Ok(Box::new(Unsteady::default())));
    let run = Run { images: KeepImages::Worst, ..Run::new(datasets, vec![unsteady]) };
    let (results, _) = run.run(folder.path()).unwrap();
    let key = results.trials[0].key.clone();
    let kept = [2, 3, 6].map(|frame| image_path(folder.path(), &key, frame).is_file());
    assert_eq!(kept, [true, false, true]);
    let note = "the images of 1 of 3 targets are not kept: rendered again, it is not the image that was scored";
    assert!(results.trials[0].notes.iter().any(|found| found == note), "{:?}", results.trials[0].notes);
}

/// Renders all targets once. Then its second one fails, or it gives no images at all.
struct Once {
    calls: AtomicUsize,
    loses_all: bool,
}

impl Prediction for Once {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let is_first = self.calls.fetch_add(1, Ordering::Relaxed) == 0;
        let one = |target: &usize| {
            if is_first || *target != 1 { Ok(grey()) } else { Err("out of memory".to_owned()) }
        };
        let count = if is_first || !self.loses_all { targets.len() } else { 0 };
        targets.iter().take(count).map(one).collect()
    }
}

#[test]
fn a_failure_while_images_are_rendered_again_costs_these_images_only() {
    const NONE: &str = "expected an image for each of 3 targets, the method returned 0";
    for (loses_all, expected, lost, reason) in
        [(false, [true, false, true], 1, "out of memory"), (true, [false; 3], 3, NONE)]
    {
        let folder = tempfile::tempdir().unwrap();
        let datasets = vec![dataset(Walls::new(1, 8), &[entry(&[0, 4], &[2, 3, 6])])];
        let once = method("once", move |_| Ok(Box::new(Once { calls: AtomicUsize::new(0), loses_all })));
        let run = Run { images: KeepImages::Worst, ..Run::new(datasets, vec![once]) };
        let (results, _) = run.run(folder.path()).unwrap();
        let row = &results.trials[0];
        assert_eq!((row.status, row.detail.as_deref()), (TrialStatus::Done, None));
        assert!(results.targets.iter().all(|target| target.status.is_scored()));
        let kept = [2, 3, 6].map(|frame| image_path(folder.path(), &row.key, frame).is_file());
        assert_eq!(kept, expected);
        let note = format!("the images of {lost} of 3 targets are not kept: {reason}");
        assert!(row.notes.contains(&note), "{:?}", row.notes);
    }
}
