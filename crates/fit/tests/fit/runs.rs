//! Whole runs on a small scene whose images are rendered from known Gaussians.

use atsplat_camera::{CameraFromWorld, Similarity};
use atsplat_fit::density::relocated;
use atsplat_fit::start::{Point, from_points};
use atsplat_fit::{Background, Fit, FitConfig, FitDevice, FitError, Rates, StopReason, Strategy, TrainingView};
use atsplat_numeric::{SplitMix64, Tolerance};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Exposure, GaussianParts, Gaussians, RenderOptions};
use atsplat_tests::on_threads;
use glam::{DMat3, DVec3};

use crate::common::{config, held_out, random, rewrite_metadata, run, start, truth, view, views, views_of};

#[test]
fn every_strategy_learns_views_that_it_does_not_see() {
    for strategy in Strategy::ALL {
        let mut fit = Fit::new(config(strategy, 400), views().0, &start(strategy, 300)).unwrap();
        let before = held_out(&mut fit);
        run(&mut fit, 400);
        let after = held_out(&mut fit);
        assert!(fit.is_complete() && after > before + 4.0, "{}: {before} dB, then {after} dB", strategy.name());
        let changed = fit.len() != 300;
        assert_eq!(changed, strategy != Strategy::Fixed, "{}: {} Gaussians", strategy.name(), fit.len());
        assert_eq!(fit.gaussians().parts().filter_3d.is_some(), strategy == Strategy::MipSplatting);
    }
}

#[test]
fn only_mcmc_adds_regularisers_to_the_loss() {
    for strategy in Strategy::ALL {
        let mut fit = Fit::new(config(strategy, 10), views().0, &start(strategy, 20)).unwrap();
        let regularisers = fit.step().unwrap().regularisers;
        assert_eq!(regularisers > 0.0, strategy == Strategy::Mcmc, "{}", strategy.name());
    }
}

#[test]
fn gaussians_are_rendered_with_the_degree_so_far() {
    // With 60 steps, the degree rises after every second one.
    let mut fit = Fit::new(config(Strategy::Fixed, 60), views().0, &start(Strategy::Fixed, 20)).unwrap();
    let degrees = [0, 1, 1, 1].map(|steps| {
        run(&mut fit, steps);
        fit.options().max_sh_degree
    });
    assert_eq!(degrees, [0, 0, 1, 1]);
}

/// The Gaussians are known and hardly change, so that every view has to find its camera and exposure.
#[test]
fn perturbed_cameras_and_exposures_are_recovered() {
    let exact: Vec<TrainingView> = views().0.into_iter().step_by(4).collect();
    let mut generator = SplitMix64::new(9);
    let mut views = exact.clone();
    for view in &mut views {
        let mut number = |most: f32| f64::from(random(&mut generator, -most, most));
        let turn =
            DMat3::from_quat(glam::DQuat::from_scaled_axis(DVec3::new(number(0.02), number(0.02), number(0.02))));
        let shift = DVec3::new(number(0.05), number(0.05), number(0.05));
        let pose = view.view.camera.camera_from_world;
        view.view.camera.camera_from_world =
            CameraFromWorld::new(turn * pose.rotation(), turn * pose.translation() + shift).unwrap();
        let exposure = Exposure { offset: [number(0.05); 3], ..Exposure::uniform(1.0 + number(0.2)) };
        for rgb in &mut view.rgb {
            #[expect(clippy::cast_possible_truncation, reason = "pixels are f32")]
            let seen = exposure.apply(rgb.map(f64::from)).map(|value| value as f32);
            *rgb = seen;
        }
    }
    let still = 1e-9;
    let rates =
        Rates { means: still, final_means: still, colours: still, opacities: still, scales: still, rotations: still };
    let (pose_rate, exposure_rate) = (Some(2e-3), Some(0.01));
    let config = FitConfig { rates, pose_rate, exposure_rate, ..config(Strategy::Fixed, 1500) };
    let mut fit = Fit::new(config, views.clone(), &truth()).unwrap();
    let errors = |fit: &Fit| {
        let error = |(number, exact): (usize, &TrainingView)| {
            let found = fit.optimised_view(number).unwrap().unwrap().camera.camera_from_world;
            let exact = exact.view.camera.camera_from_world;
            (found.inverse().centre() - exact.inverse().centre()).length()
                + (found.rotation() - exact.rotation()).to_cols_array().iter().map(|entry| entry.abs()).sum::<f64>()
        };
        exact.iter().enumerate().map(error).sum::<f64>() / exact.len() as f64
    };
    let before = errors(&fit);
    run(&mut fit, 1500);
    let after = errors(&fit);
    assert!(before > 0.05 && after < 0.1 * before, "{before}, then {after}");
    assert!(fit.exposure(0).is_some_and(|exposure| exposure != Exposure::IDENTITY));
}

/// As after a network's reconstruction: the views are in a normalised world, and the record is in the data's.
#[test]
fn cameras_are_recorded_in_the_world_before_normalisation() {
    let rotation = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(0.3);
    let normalisation = Similarity { rotation, origin: DVec3::new(1.0, -2.0, 3.0), scale: 0.25 };
    let given = views().0;
    let mut normalised = given.clone();
    for view in &mut normalised {
        let pose = view.view.camera.camera_from_world.inverse();
        view.view.camera.camera_from_world = normalisation.new_pose_from_old(&pose).unwrap().inverse();
    }
    let config = FitConfig { pose_rate: Some(1e-3), ..config(Strategy::Fixed, 1) };
    let fit = Fit::new(config, normalised, &truth()).unwrap();
    let recorded = fit.corrections(&normalisation).unwrap();
    assert_eq!(recorded.len(), given.len());
    for (found, view) in recorded.iter().zip(&given) {
        let expected = view.view.camera.camera_from_world.to_rows().to_vec();
        Tolerance::absolute(1e-12).assert(found.camera_from_world.clone(), expected, &view.name);
    }
}

#[test]
fn absolute_gradients_densify() {
    let config = FitConfig { absolute_gradients: true, ..config(Strategy::Gaussians3d, 300) };
    let mut fit = Fit::new(config, views().0, &start(Strategy::Gaussians3d, 150)).unwrap();
    run(&mut fit, 150);
    assert!(fit.len() > 150, "{} Gaussians", fit.len());
}

#[test]
fn a_killed_run_resumes_to_the_same_bits_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    // Around the changes of density at step 100 and, of MCMC, 200, and next to both ends of a run. 3DGS has the density control of
    // Mip-Splatting, and refinement none.
    let next_to_ends = [(1, 1), (6, 2), (11, 3)];
    let until_100 = [(1, 1), (16, 2), (50, 3), (99, 1), (100, 2), (101, 1)];
    let until_200 = [&until_100[..], &[(199, 3), (200, 2), (201, 1)]].concat();
    let kills = |strategy: Strategy| match strategy {
        Strategy::Gaussians3d | Strategy::Fixed => (12, &next_to_ends[..]),
        Strategy::MipSplatting => (250, &until_100[..]),
        Strategy::Mcmc => (250, &until_200[..]),
    };
    for strategy in Strategy::ALL {
        let (steps, kills) = kills(strategy);
        let (views, start) = (views().0, start(strategy, 120));
        let config = FitConfig {
            background: Background::Random,
            pose_rate: Some(1e-4),
            exposure_rate: Some(1e-3),
            ..config(strategy, steps)
        };
        let mut killed = Fit::new(config.clone(), views.clone(), &start).unwrap();
        for &(at, threads) in kills {
            let steps = at - killed.step_count();
            on_threads(threads, || run(&mut killed, steps));
            killed.checkpoint(&path).unwrap();
            // What comes after the checkpoint is lost.
            killed.step().unwrap();
            killed = Fit::resume(config.clone(), views.clone(), &[], &start, FitDevice::default(), &path).unwrap();
        }
        run(&mut killed, 1);
        let mut whole = Fit::new(config, views, &start).unwrap();
        run(&mut whole, killed.step_count());
        assert_eq!(killed.gaussians(), whole.gaussians(), "{}", strategy.name());
        assert!(killed.history() == whole.history(), "{}: another history", strategy.name());
    }
}

#[test]
fn a_checkpoint_of_another_run_or_a_damaged_one_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let (views, start, config) = (views().0, start(Strategy::Mcmc, 50), config(Strategy::Mcmc, 50));
    Fit::new(config.clone(), views.clone(), &start).unwrap().checkpoint(&path).unwrap();
    let other = FitConfig { seed: 12, ..config.clone() };
    let error = Fit::resume(other, views.clone(), &[], &start, FitDevice::default(), &path).unwrap_err().to_string();
    let expected = "configuration: expected the settings of this run, found others: seed: 11, now 12";
    assert!(error.contains(expected), "{error}");
    let fewer = views[1..].to_vec();
    let error = Fit::resume(config.clone(), fewer, &[], &start, FitDevice::default(), &path).unwrap_err().to_string();
    assert!(error.contains("views: expected those that this run trains on, found others"), "{error}");
    let mut bytes = std::fs::read(&path).unwrap();
    let last = bytes.len() - 30;
    bytes[last] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let error =
        Fit::resume(config.clone(), views.clone(), &[], &start, FitDevice::default(), &path).unwrap_err().to_string();
    assert!(error.contains("expected the tensors that were written"), "{error}");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(matches!(
        Fit::resume(config, views, &[], &start, FitDevice::default(), &path),
        Err(FitError::Checkpoint { .. })
    ));
}

/// The start decides the extent and the first degree; the held-out views are those of the evaluations in the record.
#[test]
fn a_checkpoint_of_another_start_or_of_other_held_out_views_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let ((views, held_out), start, config) = (views(), start(Strategy::Fixed, 50), config(Strategy::Fixed, 20));
    let mut whole = Fit::new(config.clone(), views.clone(), &start).unwrap();
    run(&mut whole, 9);
    whole.evaluate(&held_out).unwrap();
    whole.checkpoint(&path).unwrap();
    let resume = |start: &Gaussians, held_out: &[TrainingView]| {
        Fit::resume(config.clone(), views.clone(), held_out, start, FitDevice::default(), &path)
    };
    let mut moved = start.clone().into_parts();
    moved.means[0][2] += 0.5;
    let error = resume(&Gaussians::new(moved).unwrap(), &held_out).unwrap_err().to_string();
    assert!(error.starts_with("checkpoint: initial Gaussians: expected those that this run starts from"), "{error}");
    let error = resume(&start, &held_out[..1]).unwrap_err().to_string();
    assert!(error.starts_with("checkpoint: held-out: expected the held-out views of this run"), "{error}");
    let mut resumed = resume(&start, &held_out).unwrap();
    assert_eq!(resumed.evaluate(&held_out).unwrap(), None, "after this step they were compared already");
    for fit in [&mut whole, &mut resumed] {
        run(fit, 11);
        fit.evaluate(&held_out).unwrap();
    }
    assert_eq!(resumed.history().evaluations.iter().map(|evaluation| evaluation.step).collect::<Vec<_>>(), [9, 20]);
    assert!(resumed.history() == whole.history(), "another history");

    // As before checkpoints had a hash of the initial Gaussians.
    rewrite_metadata(&path, r#"\"start\":"#, r#"\"stare\":"#);
    let error = resume(&start, &held_out).unwrap_err().to_string();
    assert!(error.contains("expected metadata as this version writes it, found missing field `start`"), "{error}");
}

/// Earlier versions moved a view's camera and exposure in its own steps alone.
#[test]
fn corrections_of_an_earlier_version_are_not_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let (views, start) = (views().0, start(Strategy::Fixed, 50));
    let resumed = |exposure_rate: Option<f64>| {
        let config = FitConfig { exposure_rate, ..config(Strategy::Fixed, 20) };
        Fit::new(config.clone(), views.clone(), &start).unwrap().checkpoint(&path).unwrap();
        rewrite_metadata(&path, r#"\"joint_corrections\":"#, r#"\"joint_correctionz\":"#);
        let resumed = Fit::resume(config, views.clone(), &[], &start, FitDevice::default(), &path);
        resumed.map(drop).map_err(|error| error.to_string())
    };
    let error = resumed(Some(0.01)).unwrap_err();
    let expected = "checkpoint: corrections: expected cameras and exposures of one optimiser for all views";
    assert!(error.starts_with(expected), "{error}");
    assert_eq!(resumed(None), Ok(()), "nothing but the Gaussians is optimised");
}

/// The images have a black background, on which their Gaussians match them.
#[test]
fn a_coloured_background_is_optimised_as_it_is_rendered() {
    let rgb = [0.25, 0.5, 0.75];
    let on = |rgb: [f64; 3]| {
        let config = FitConfig { background: Background::of(rgb), ..config(Strategy::Fixed, 9) };
        let mut fit = Fit::new(config, views().0, &truth()).unwrap();
        let loss = fit.step().unwrap().terms.l1;
        (loss, fit.options().background.map(f64::to_bits))
    };
    let ((black, _), (coloured, shown)) = (on([0.0; 3]), on(rgb));
    assert!(shown == rgb.map(f64::to_bits) && coloured > black + 0.05, "{black} on black, {coloured} on {rgb:?}");
    assert_eq!([[0.0; 3], [1.0; 3]].map(Background::of), [Background::Black, Background::White]);
}

#[test]
fn a_checkpoint_without_all_that_density_control_remembers_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let (views, start) = (views().0, start(Strategy::Gaussians3d, 50));
    let config = config(Strategy::Gaussians3d, 50);
    Fit::new(config.clone(), views.clone(), &start).unwrap().checkpoint(&path).unwrap();
    let (names, fewer) = (r#"[\"gradient-sums\",\"gradient-counts\"]"#, r#"[\"gradient-sums\"]                    "#);
    assert_eq!(names.len(), fewer.len());
    rewrite_metadata(&path, names, fewer);
    let error = Fit::resume(config, views, &[], &start, FitDevice::default(), &path).unwrap_err().to_string();
    assert!(
        error.contains(r#"memory: expected ["gradient-sums", "gradient-counts"], found ["gradient-sums"]"#),
        "{error}"
    );
}

#[test]
fn an_overflowing_loss_stops_with_the_last_good_state() {
    let mut views = views().0;
    for view in &mut views {
        view.rgb[700] = [1e30; 3];
    }
    let mut fit = Fit::new(config(Strategy::Fixed, 50), views, &start(Strategy::Fixed, 50)).unwrap();
    let before = fit.gaussians();
    match fit.step().unwrap_err() {
        FitError::Stopped(diagnosis) => {
            assert!(matches!(diagnosis.reason, StopReason::NonFiniteLoss { .. }), "{diagnosis}");
            assert_eq!((diagnosis.step, diagnosis.gaussians), (1, 50));
        }
        other => panic!("{other}"),
    }
    assert_eq!((fit.gaussians(), fit.step_count()), (before, 0));
}

#[test]
fn a_runaway_count_stops_with_the_last_good_state() {
    let config = FitConfig { max_gaussians: 152, ..config(Strategy::Gaussians3d, 300) };
    let mut fit = Fit::new(config, views().0, &start(Strategy::Gaussians3d, 150)).unwrap();
    let error = (0..300).find_map(|_| fit.step().err()).expect("growth beyond two Gaussians");
    let FitError::Stopped(diagnosis) = error else { panic!("{error}") };
    match diagnosis.reason {
        StopReason::TooManyGaussians { wanted, limit } => assert!(wanted > 152 && limit == 152, "{wanted} of {limit}"),
        other => panic!("{other}"),
    }
    assert!(fit.len() <= 152 && fit.gaussians().validate().is_clean());
    // The first change of density fails, and all before it is what refinement does. The step counts, as its update is there.
    let steps = fit.step_count();
    assert_eq!((steps, fit.history().losses.len() as u64), (diagnosis.step, diagnosis.step));
    let refinement = FitConfig { strategy: Strategy::Fixed, ..fit.config().clone() };
    let mut fixed = Fit::new(refinement, views().0, &start(Strategy::Gaussians3d, 150)).unwrap();
    run(&mut fixed, steps);
    assert!(fit.gaussians() == fixed.gaussians(), "after {steps} steps");
}

/// Gaussians of a Mip-Splatting file have filters. Of two, one is dead: it becomes a copy of the other.
#[test]
fn relocated_gaussians_have_the_filter_of_their_source() {
    let parts = GaussianParts {
        means: vec![[0.0; 3], [1.0; 3]],
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        log_scales: vec![[-2.0; 3]; 2],
        opacity_logits: vec![-9.0, 1.0],
        sh: vec![[0.5; 3]; 2],
        filter_3d: Some(vec![0.5, 0.125]),
        ..GaussianParts::default()
    };
    let mut scene = atsplat_fit::OptimisedGaussians::new(Gaussians::new(parts).unwrap());
    let at = atsplat_fit::density::StepContext {
        step: 100,
        schedule: atsplat_fit::Schedule::of(3000),
        extent: 4.0,
        means_rate: 0.0,
        white: false,
        seed: 0,
        limit: 2,
    };
    let changes =
        atsplat_fit::density::DensityControl::after_step(&mut atsplat_fit::density::Mcmc, &mut scene, &at).unwrap();
    assert_eq!((changes.relocated, changes.added), (1, 0));
    let found = scene.gaussians().into_parts();
    assert_eq!((found.means, found.filter_3d), (vec![[1.0; 3]; 2], Some(vec![0.125; 2])));
}

#[test]
fn settings_out_of_range_are_named() {
    let with = |change: fn(&mut FitConfig)| {
        let mut config = config(Strategy::Mcmc, 10);
        change(&mut config);
        Fit::new(config, views().0, &start(Strategy::Mcmc, 20)).unwrap_err().to_string()
    };
    assert_eq!(with(|config| config.steps = 0), "steps: expected at least 1, found 0");
    assert_eq!(with(|config| config.d_ssim = f64::NAN), "d-ssim: expected from 0 to 1, found NaN");
    assert_eq!(
        with(|config| config.background = Background::Colour([0.5, 1.5, 0.5])),
        "background: expected channels from 0 to 1, found [0.5, 1.5, 0.5]"
    );
    assert!(with(|config| config.rates.scales = -1.0).starts_with("rates.scales: expected a positive learning rate"));
    assert!(with(|config| config.max_gaussians = 3).contains("the 20 initial Gaussians"));
    // Cameras in one place that see none of the initial Gaussians.
    let mut behind = start(Strategy::Fixed, 9).into_parts();
    behind.means.fill([0.0, 0.0, -90.0]);
    let (one_place, behind) = (vec![views().0.remove(0)], Gaussians::new(behind).unwrap());
    let error = |config: FitConfig| Fit::new(config, one_place.clone(), &behind).unwrap_err().to_string();
    let of_extent = error(config(Strategy::Fixed, 9));
    assert!(of_extent.contains("extent: expected cameras in different places"), "{of_extent}");
    // Before the extent, which takes memory for the depths of all Gaussians.
    let of_memory = error(FitConfig { memory_limit: 9, ..config(Strategy::Fixed, 9) });
    assert!(of_memory.starts_with("memory-limit: "), "{of_memory}");
}

/// A Gaussian of infinite size would cover every image if it were repaired.
#[test]
fn broken_initial_gaussians_are_repaired_or_removed_and_named() {
    let mut parts = truth().into_parts();
    parts.means[3][1] = f32::NAN;
    parts.log_scales[5][2] = f32::INFINITY;
    parts.quaternions[7] = [0.0; 4];
    let start = Gaussians::new(parts).unwrap();
    let fit = Fit::new(config(Strategy::Fixed, 9), views().0, &start).unwrap();
    let found = fit.start_validation();
    assert_eq!((found.total, found.invalid, found.rejected, found.repaired, fit.len()), (60, 3, 2, 1, 58));
    let kinds: Vec<String> = found.findings.iter().map(ToString::to_string).collect();
    let expected =
        ["means not a number in 1, first 3", "quaternions zero in 1, first 7", "log-scales infinite in 1, first 5"];
    assert_eq!(kinds, expected);
}

/// The paper promises that relocation hardly changes the image. For a Gaussian of opacity 0.9, equation 9 changes a pixel by at most
/// 0.042 of full contrast if it becomes two, and by 0.062 if it becomes four; cloning without the correction, by 0.25 and 0.47.
#[test]
fn relocation_keeps_the_image() {
    let one = |opacity: f64, factor: f64, copies: usize| {
        let mut parts = GaussianParts::default();
        for _ in 0..copies {
            parts.means.push([0.0; 3]);
            parts.quaternions.push([1.0, 0.0, 0.0, 0.0]);
            #[expect(clippy::cast_possible_truncation, reason = "parameters are f32")]
            let (log, logit) = ((0.3 * factor).ln() as f32, (opacity / (1.0 - opacity)).ln() as f32);
            parts.log_scales.push([log; 3]);
            parts.opacity_logits.push(logit);
            parts.sh.push([1.77; 3]);
        }
        let gaussians = Gaussians::new(parts).unwrap();
        CpuRenderer::default().render(&gaussians, &view(0.3, 48), &RenderOptions::default()).unwrap().rgb
    };
    let difference = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        let pairs = a.as_flattened().iter().zip(b.as_flattened());
        let differences = pairs.map(|(a, b)| f64::from((a - b).abs()));
        let (largest, sum) = differences.fold((0.0, 0.0), |(most, sum), d| (if d > most { d } else { most }, sum + d));
        (largest, sum / a.as_flattened().len() as f64)
    };
    let before = one(0.9, 1.0, 1);
    for (together, bound) in [(2, 0.045), (4, 0.065)] {
        let (opacity, factor) = relocated(0.9, together);
        let (largest, mean) = difference(&before, &one(opacity, factor, together));
        let (naive, naive_mean) = difference(&before, &one(0.9, 1.0, together));
        assert!(largest < bound && naive > 2.0 * largest, "{together}: {largest}, uncorrected {naive}");
        assert!(mean < 0.5 * naive_mean, "{together}: mean {mean}, uncorrected {naive_mean}");
    }
}

/// Pruned Gaussians are fainter than 0.005, so a pixel changes by at most that for each of them that covers it.
#[test]
fn pruning_has_no_visible_effect() {
    let mut parts = truth().into_parts();
    for logit in parts.opacity_logits.iter_mut().step_by(12) {
        *logit = -5.4;
    }
    let start = Gaussians::new(parts).unwrap();
    let config = FitConfig { sh_degree: 0, ..config(Strategy::Gaussians3d, 3000) };
    let mut scene = atsplat_fit::OptimisedGaussians::new(start.clone());
    let schedule = atsplat_fit::Schedule::of(config.steps);
    let at = atsplat_fit::density::StepContext {
        step: 100,
        schedule,
        extent: 4.0,
        means_rate: 0.0,
        white: false,
        seed: 0,
        limit: 1000,
    };
    let changes = atsplat_fit::density::DensityControl::after_step(
        &mut atsplat_fit::density::Adaptive::default(),
        &mut scene,
        &at,
    );
    assert_eq!((changes.unwrap().pruned, scene.len()), (5, 55));
    let mut renderer = CpuRenderer::default();
    let mut image = |gaussians: &Gaussians| {
        renderer.render(gaussians, &view(0.1, 48), &RenderOptions::default()).unwrap().rgb.into_flattened()
    };
    let (before, after) = (image(&start), image(&scene.gaussians()));
    let largest =
        before.iter().zip(&after).map(|(a, b)| (a - b).abs()).fold(0.0, |a: f32, b| if b > a { b } else { a });
    assert!(largest > 0.0 && largest < 5.0 * 0.005, "{largest}");
}

#[test]
fn points_need_to_be_finite_and_at_least_four() {
    let point = |x: f64| Point { position: [x, 0.0, 1.0], colour: [0.5; 3] };
    let error = |points: &[Point]| from_points(points, Strategy::Gaussians3d).unwrap_err().to_string();
    assert!(error(&[point(0.0); 3]).contains("expected at least four points, found 3"));
    assert!(
        error(&[point(0.0), point(1.0), point(f64::NAN), point(2.0)])
            .contains("expected finite points, found point 2, which is not")
    );
    // A line of points one apart: the three nearest of an end are 1, 2 and 3 away.
    let line: Vec<Point> = (0..4).map(|x| point(f64::from(x))).collect();
    let scales = from_points(&line, Strategy::Gaussians3d).unwrap().into_parts().log_scales;
    let expected = (0.5 * (14.0f64 / 3.0).ln(), 0.5 * 2.0f64.ln());
    let close = Tolerance { absolute: 1e-6, relative: 0.0 };
    close.assert([scales[0][0], scales[1][2]].map(f64::from), [expected.0, expected.1], "scales");
}

#[test]
fn initial_gaussians_have_the_colours_of_their_points() {
    let colour = [0.5, 0.75, 0.1];
    let points: Vec<Point> = (0..4).map(|x| Point { position: [f64::from(x), 0.0, 1.0], colour }).collect();
    let sh = from_points(&points, Strategy::Gaussians3d).unwrap().into_parts().sh;
    // The basis of degree 0 is 1 / (2√π).
    let shown = sh[3].map(|value| 0.5 + f64::from(value) / (2.0 * std::f64::consts::PI.sqrt()));
    Tolerance { absolute: 1e-6, relative: 0.0 }.assert(shown, colour, "colour");
}

/// The published code computes it until a hundred steps before the end.
#[test]
fn the_3d_filter_follows_the_gaussians_until_shortly_before_the_end() {
    let start = start(Strategy::MipSplatting, 60);
    let mut fit = Fit::new(config(Strategy::MipSplatting, 500), views_of(20).0, &start).unwrap();
    let filters = |fit: &mut Fit, until: u64| {
        let steps = until - fit.step_count();
        run(fit, steps);
        fit.gaussians().into_parts().filter_3d.unwrap()
    };
    let [before, at, end] = [299, 300, 500].map(|until| filters(&mut fit, until));
    assert_eq!(before.len(), end.len(), "density control ended after half of the steps");
    assert_ne!(before, at);
    assert_eq!(at, end);
}
