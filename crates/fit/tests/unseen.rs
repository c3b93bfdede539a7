//! Runs in which no training view sees a Gaussian.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[allow(dead_code, reason = "each test takes what it needs")]
mod common;

use atsplat_camera::CameraFromWorld;
use atsplat_fit::{Fit, FitDevice, FitError, Strategy, TrainingView};
use common::{config, run, start, views};
use glam::{DMat3, DVec3};

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
        assert!(error.contains(&format!("stopped at step {at} ")) && error.ends_with("at a depth of 90?"), "{error}");
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
    assert!(error.ends_with("at a depth of 90?"), "{error}");
    // A view that looks away does not stop the others.
    let mut views: Vec<TrainingView> = views().0.into_iter().take(2).collect();
    views[1].view.camera.camera_from_world =
        CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(0.0, 0.0, -50.0)).unwrap();
    let mut fit = Fit::new(config(Strategy::Fixed, 6), views, &start(Strategy::Fixed, 20)).unwrap();
    run(&mut fit, 6);
}
