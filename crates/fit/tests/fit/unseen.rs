//! Runs in which no training view sees a Gaussian.

use atsplat_camera::CameraFromWorld;
use atsplat_fit::{Fit, FitDevice, FitError, Strategy, TrainingView};
use atsplat_splat::Gaussians;
use glam::{DMat3, DVec3};

use crate::common::{config, run, start, views};

#[test]
fn a_run_that_sees_nothing_in_all_its_views_stops_with_the_near_plane() {
    let near = |most: usize, near: f64, steps: u64| {
        let mut config = config(Strategy::Fixed, steps);
        config.constants.near = near;
        let views: Vec<TrainingView> = views().0.into_iter().take(most).collect();
        let mut fit = Fit::new(config, views, &start(Strategy::Fixed, 20)).unwrap();
        fit.run(None, |_, _| Ok::<_, FitError>(())).err().map(|error| error.to_string())
    };
    for (views, steps, at) in [(3, 10, 3), (1, 10, 1), (5, 2, 2)] {
        let error = near(views, 90.0, steps).unwrap();
        assert!(error.contains(&format!("stopped at step {at} ")) && error.ends_with("at a depth of 90"), "{error}");
        assert!(error.contains("20 of 20 are nearer than the near plane"), "{error}");
        assert_eq!(near(views, 0.01, steps), None);
    }
    // A resumed run has not forgotten it.
    let mut hidden = config(Strategy::Fixed, 2);
    hidden.constants.near = 90.0;
    let views_of = || views().0.into_iter().take(5).collect::<Vec<TrainingView>>();
    let mut killed = Fit::new(hidden.clone(), views_of(), &start(Strategy::Fixed, 20)).unwrap();
    killed.step().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = folder.path().join("checkpoint");
    killed.checkpoint(&checkpoint).unwrap();
    let mut resumed =
        Fit::resume(hidden, views_of(), &[], &start(Strategy::Fixed, 20), FitDevice::default(), &checkpoint).unwrap();
    let error = resumed.run(None, |_, _| Ok::<_, FitError>(())).unwrap_err().to_string();
    assert!(error.ends_with("at a depth of 90"), "{error}");
    // A view that looks away does not stop the others.
    let mut views: Vec<TrainingView> = views().0.into_iter().take(2).collect();
    views[1].view.camera.camera_from_world =
        CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(0.0, 0.0, -50.0)).unwrap();
    let mut fit = Fit::new(config(Strategy::Fixed, 6), views, &start(Strategy::Fixed, 20)).unwrap();
    run(&mut fit, 6);
}

/// The message names the reason of most Gaussians, not always the near plane.
#[test]
fn a_run_that_sees_nothing_says_why() {
    let error = |change: fn(&mut [[f32; 3]], &mut [f32]), strategy: Strategy| {
        let mut parts = start(strategy, 20).into_parts();
        change(&mut parts.means, &mut parts.opacity_logits);
        let views: Vec<TrainingView> = views().0.into_iter().take(3).collect();
        let begun = Fit::new(config(strategy, 9), views, &Gaussians::new(parts).unwrap());
        let ended = begun.and_then(|mut fit| fit.run(None, |_, _| Ok::<_, FitError>(())));
        ended.unwrap_err().to_string()
    };
    let faint = error(|_, logits| logits.fill(-8.0), Strategy::Fixed);
    let expected = " of 20 are too faint everywhere (by default, an opacity below 1/255 is not drawn)";
    assert!(faint.ends_with(expected), "{faint}");
    // Far to the side of cameras that look at the origin, in front of all of them.
    let aside = |means: &mut [[f32; 3]], _: &mut [f32]| means.fill([53.0, 0.0, 73.0]);
    for strategy in [Strategy::Fixed, Strategy::MipSplatting] {
        let outside = error(aside, strategy);
        assert!(outside.ends_with("20 of 20 are outside the image"), "{outside}");
    }
}
