//! The limit on memory.

use atsplat_fit::{Fit, FitConfig, Strategy, TrainingView, TrainingViews};
use atsplat_tests::on_threads;

use crate::common::{config, run, start, view, views};

#[test]
fn memory_is_bounded() {
    let with = |memory_limit| {
        let config = FitConfig { memory_limit, max_gaussians: 600, ..config(Strategy::Mcmc, 300) };
        Fit::new(config, views().0, &start(Strategy::Mcmc, 400))
    };
    let error = with(1_000_000).unwrap_err().to_string();
    assert!(error.contains("memory-limit: expected at least"), "{error}");
    // Known before there are any.
    let limits = FitConfig { memory_limit: u64::MAX, max_gaussians: 600, ..config(Strategy::Mcmc, 300) };
    let checked = |start| limits.check_start(&views().0.into(), start).map_err(|error| error.to_string());
    assert_eq!(checked(600), Ok(()));
    assert!(checked(601).unwrap_err().starts_with("max-gaussians: expected at least the 601 initial Gaussians"));
    assert!(checked(usize::MAX).unwrap_err().starts_with("memory-limit: expected at least"));
    // Growth by a twentieth would give 420 Gaussians. On one thread, because each thread of the renderer needs memory.
    on_threads(1, || {
        let large = views().0.into_iter().take(2).zip([0.0, 0.4]).map(|(small, angle)| {
            let view = view(angle, 128);
            TrainingView { rgb: vec![[0.5; 3]; view.pixels()], view, ..small }
        });
        let large: Vec<TrainingView> = large.collect();
        // The images take 393 216 bytes, rendering one 4 194 304, and a Gaussian 1132.
        let config = FitConfig { memory_limit: 5_060_000, max_gaussians: 600, ..config(Strategy::Mcmc, 300) };
        let mut fit = Fit::new(config, large, &start(Strategy::Mcmc, 400)).unwrap();
        run(&mut fit, 110);
        assert!(fit.len() > 400 && fit.len() < 420, "{} Gaussians", fit.len());
    });
}

/// The renderer has what other images leave. An image of 1500×1500 pixels takes 72 MB in it.
#[test]
fn images_leave_less_memory_for_the_renderer() {
    let rendered = |others: u64| {
        let config = FitConfig { memory_limit: 200_000_000, ..config(Strategy::Fixed, 1) };
        let views = TrainingViews::from(views().0).with_other_images(others);
        let mut fit = Fit::new(config, views, &start(Strategy::Fixed, 20)).unwrap();
        fit.render(&view(0.3, 1500)).map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(rendered(0), Ok(()));
    let refused = rendered(150_000_000).unwrap_err();
    assert!(refused.starts_with("rendering needs ") && refused.contains("the limit is 49"), "{refused}");
}
