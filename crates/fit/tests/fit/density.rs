//! Which steps change the number of Gaussians, and what says so before a run.

use atsplat_fit::density::{Adaptive, DensityControl as _, StepContext, ViewGradients};
use atsplat_fit::{Fit, FitConfig, FitDevice, OptimisedGaussians, Schedule, Strategy};

use crate::common::{config, run, start, truth, views};

fn fit(strategy: Strategy, steps: u64, most: usize) -> Fit {
    let config = FitConfig { max_gaussians: most, ..config(strategy, steps) };
    Fit::new(config, views().0, &start(strategy, 100)).unwrap()
}

#[test]
fn runs_that_are_too_short_for_density_control_say_so() {
    for (strategy, fewest, verb) in [(Strategy::Mcmc, 122, "moves or adds"), (Strategy::Gaussians3d, 202, "clones, ")] {
        let mut short = fit(strategy, fewest - 1, 105);
        let warning = short.density_warning().unwrap();
        let expected = format!("Gaussians in {} steps, but in {fewest} or more", fewest - 1);
        assert!(warning.contains(verb) && warning.ends_with(&expected), "{warning}");
        run(&mut short, fewest - 1);
        assert_eq!(short.len(), 100);
        assert_eq!(fit(strategy, fewest, 105).density_warning(), None, "{strategy:?}");
    }
    assert_eq!(fit(Strategy::Fixed, 5, 4000).density_warning(), None);
}

/// 100, 105, 110 and 115 Gaussians: each change rounds down.
#[test]
fn mcmc_says_how_many_gaussians_it_can_reach() {
    let mut short = fit(Strategy::Mcmc, 400, 4000);
    let warning = short.density_warning().unwrap();
    let expected = "mcmc grows from 100 to at most 115 of 4000 Gaussians (max-gaussians): by 5 % ";
    assert!(warning.starts_with(expected) && warning.ends_with(" due 3 times until step 400"), "{warning}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    run(&mut short, 250);
    short.checkpoint(&path).unwrap();
    let begin = start(Strategy::Mcmc, 100);
    let resumed = Fit::resume(short.config().clone(), views().0, &[], &begin, FitDevice::default(), &path).unwrap();
    let left = resumed.density_warning().unwrap();
    assert!(
        left.starts_with("mcmc grows from 110 to at most 115 ") && left.ends_with(" due 1 times until step 400"),
        "{left}"
    );
    assert_eq!(resumed.first_density_warning(100), Some(warning), "that of the whole run");
    run(&mut short, 150);
    assert_eq!((short.len(), short.density_warning()), (115, None), "no change is left");
    assert_eq!(fit(Strategy::Mcmc, 400, 115).density_warning(), None);
}

#[test]
fn mcmc_says_if_memory_limits_it_below_its_maximum() {
    let limited = |memory_limit: u64| {
        let config = FitConfig { memory_limit, ..config(Strategy::Mcmc, 400) };
        Fit::new(FitConfig { max_gaussians: 112, ..config }, views().0, &start(Strategy::Mcmc, 100))
    };
    let fitting = |memory: u64| limited(memory).ok().and_then(|fit| fit.density_warning());
    let least = (1..10_000).map(|step| step * 2000).find(|memory| limited(*memory).is_ok()).unwrap();
    let warning = fitting(least).unwrap();
    assert!(warning.contains(" no more fit into ") && warning.contains(" of 112 Gaussians "), "{warning}");
    assert_eq!(fitting(1 << 30), None);
}

/// Whether density control resets the opacities after these steps of runs with these numbers of steps.
fn resets<const N: usize>(density: &mut Adaptive, white: bool, steps: [(u64, u64); N]) -> [bool; N] {
    let mut scene = OptimisedGaussians::new(truth());
    steps.map(|(step, of)| {
        let schedule = Schedule::of(of);
        let (extent, means_rate, seed, limit) = (100.0, 0.0, 1, 1000);
        let at = StepContext { step, schedule, extent, means_rate, white, seed, limit };
        density.after_step(&mut scene, &at).unwrap().reset
    })
}

/// With a budget in seconds, the number of steps is planned again and again. The first reset needs none before it.
#[test]
fn opacities_rise_again_before_the_next_reset_of_another_plan() {
    let steps = [(300, 3000), (338, 3380), (600, 3000)];
    assert_eq!(resets(&mut Adaptive::default(), false, steps), [true, false, true]);
    assert_eq!(resets(&mut Adaptive::default(), false, [(338, 3380)]), [true]);
}

#[test]
fn on_white_a_run_begins_with_a_reset_only_if_it_is_long() {
    for (white, expected) in [(false, [false; 4]), (true, [false, false, false, true])] {
        let first = [(1, 20), (10, 600), (50, 3000), (500, 30_000)];
        assert_eq!(first.map(|at| resets(&mut Adaptive::default(), white, [at])).concat(), expected, "{white}");
    }
}

/// As gsplat's `absgrad`: the same threshold for small Gaussians, which are cloned, and for large ones, which are split.
#[test]
fn absolute_gradients_decide_on_clones_and_splits_from_one_threshold() {
    let changes = |mean: f32, extent: f64| {
        let mut scene = OptimisedGaussians::new(truth());
        let (drawn, means_2d) = ((0..60).collect::<Vec<u32>>(), [[mean, 0.0]; 60]);
        let mut density = Adaptive::absolute();
        density.observe(&ViewGradients { drawn: &drawn, means_2d: &means_2d, size: [2.0, 2.0], count: scene.len() });
        let schedule = Schedule::of(Schedule::PUBLISHED);
        let (step, means_rate, white, seed, limit) = (600, 0.0, false, 1, 1000);
        let at = StepContext { step, schedule, extent, means_rate, white, seed, limit };
        let changes = density.after_step(&mut scene, &at).unwrap();
        (changes.cloned, changes.split)
    };
    let (small, large) = (100.0, 1.0);
    assert_eq!([changes(7.9e-4, small), changes(8.1e-4, small)], [(0, 0), (60, 0)]);
    assert_eq!([changes(7.9e-4, large), changes(8.1e-4, large)], [(0, 0), (0, 60)]);
}
