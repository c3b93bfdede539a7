use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::{GaussianParts, Gradients, View};
use glam::{DMat3, DVec3};

use super::*;
use crate::density::{Changes, ViewGradients};

/// One Gaussian beside the optical axis.
fn start() -> Gaussians {
    Gaussians::new(GaussianParts {
        means: vec![[0.3, -0.2, 3.0]],
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![[-1.0; 3]],
        opacity_logits: vec![1.0],
        sh: vec![[0.25; 3]],
        ..GaussianParts::default()
    })
    .unwrap()
}

/// It is optimised for one grey view.
fn fit(steps: u64) -> Fit {
    let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).unwrap();
    let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
    let view = View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width: 16, height: 12 } };
    let view = TrainingView { name: "view".to_owned(), view, rgb: vec![[0.5; 3]; view.pixels()] };
    let config = FitConfig { extent: Some(1.0), ..FitConfig::new(Strategy::Fixed, steps) };
    Fit::new(config, vec![view], &start()).unwrap()
}

/// With 60 steps, the degree rises after every second one, and with 3000 after every hundredth.
#[test]
fn a_longer_plan_keeps_the_degree_that_was_reached() {
    let mut fit = fit(60);
    for _ in 0..7 {
        fit.step().unwrap();
    }
    assert_eq!(fit.options().max_sh_degree, 3);
    fit.plan_steps(3000);
    assert_eq!((fit.options().max_sh_degree, fit.schedule.degree(0, 3, fit.step)), (3, 0));
    let highest = |fit: &Fit| fit.gaussians().parts().sh[15].map(f32::to_bits);
    let before = highest(&fit);
    fit.step().unwrap();
    assert!(fit.options().max_sh_degree == 3 && highest(&fit) != before, "it is still optimised");

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    fit.checkpoint(&path).unwrap();
    let (config, views) = (fit.config().clone(), fit.views.clone());
    let mut resumed = Fit::resume(config, views, &[], &start(), FitDevice::default(), &path).unwrap();
    for fit in [&mut fit, &mut resumed] {
        fit.step().unwrap();
    }
    assert_eq!((resumed.options().max_sh_degree, resumed.gaussians()), (3, fit.gaussians()));
}

/// Replaces a gradient, and counts how often it is shown gradients.
#[derive(Debug)]
struct Spoiling {
    gradient: f32,
    observed: Arc<AtomicUsize>,
}

impl DensityControl for Spoiling {
    fn regularise(&self, _scene: &OptimisedGaussians, gradients: &mut Gradients<f32>) -> f64 {
        gradients.log_scales[0][1] = self.gradient;
        0.0
    }

    fn observe(&mut self, _view: &ViewGradients<'_>) {
        self.observed.fetch_add(1, Ordering::Relaxed);
    }

    fn after_step(&mut self, _scene: &mut OptimisedGaussians, _context: &StepContext) -> Result<Changes, DensityError> {
        Ok(Changes::default())
    }
}

/// Its sums would be NaN from then on.
#[test]
fn density_control_is_not_shown_gradients_that_are_not_finite() {
    let observed = Arc::new(AtomicUsize::new(0));
    let outcome = |gradient: f32| {
        let mut fit = fit(10);
        fit.density = Box::new(Spoiling { gradient, observed: Arc::clone(&observed) });
        (fit.step().is_ok(), observed.swap(0, Ordering::Relaxed))
    };
    assert_eq!([0.0, f32::NAN].map(outcome), [(true, 1), (false, 0)]);
}
