//! Which renders a run keeps.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::methods::method;
use crate::common::{Run, SIZE, Walls, dataset, entry, grey};
use atsplat_eval::method::{Prediction, Rendered};
use atsplat_eval::runner::KeepImages;
use atsplat_pixels::Image;
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
    let note = "the images of 1 of 3 targets are not kept: rendered again, they are not those that were scored";
    assert!(results.trials[0].notes.iter().any(|found| found == note), "{:?}", results.trials[0].notes);
}
