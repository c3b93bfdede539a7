//! Single steps against PyTorch in double precision: `oracle/make_steps.py` made `fixtures/steps.json`.

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, PixelIntrinsics};
use atsplat_fit::density::{Adaptive, Changes, DensityControl as _, Mcmc, StepContext, ViewGradients, relocated};
use atsplat_fit::filter_3d::Cameras;
use atsplat_fit::loss::PhotometricLoss;
use atsplat_fit::{Adam, OptimisedGaussians, Rates, Schedule};
use atsplat_numeric::Tolerance;
use atsplat_splat::{GaussianParts, Gaussians, Gradients, View};
use glam::{DMat3, DVec3};
use serde_json::Value;

/// f32 arithmetic on numbers of order 1.
const F32: Tolerance = Tolerance { absolute: 2e-6, relative: 2e-6 };

fn fixture(name: &str) -> Value {
    let all: Value = serde_json::from_str(include_str!("../fixtures/steps.json")).unwrap();
    all[name].clone()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// All numbers of nested lists, in order.
fn numbers(value: &Value) -> Vec<f64> {
    match value.as_array() {
        Some(list) => list.iter().flat_map(numbers).collect(),
        None => vec![number(value)],
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the fixtures have f32 values")]
fn rows<const N: usize>(value: &Value) -> Vec<[f32; N]> {
    numbers(value).as_chunks::<N>().0.iter().map(|row| row.map(|value| value as f32)).collect()
}

fn flat(value: &Value) -> Vec<f32> {
    rows::<1>(value).into_iter().map(|[value]| value).collect()
}

fn gaussians(value: &Value) -> Gaussians {
    let parts = GaussianParts {
        means: rows(&value["means"]),
        quaternions: rows(&value["quaternions"]),
        log_scales: rows(&value["log_scales"]),
        opacity_logits: flat(&value["opacity_logits"]),
        sh_degree: 1,
        sh: rows(&value["sh"]),
        ..GaussianParts::default()
    };
    Gaussians::new(parts).unwrap()
}

fn gradients(value: &Value) -> Gradients<f32> {
    let GaussianParts { means, quaternions, log_scales, opacity_logits, sh, .. } = gaussians(value).into_parts();
    Gradients { means, quaternions, log_scales, opacity_logits, sh, ..Gradients::default() }
}

fn assert_parts(tolerance: Tolerance, found: &OptimisedGaussians, expected: &Value) {
    let parts = found.gaussians().into_parts();
    let fields = [
        ("means", parts.means.as_flattened()),
        ("quaternions", parts.quaternions.as_flattened()),
        ("log_scales", parts.log_scales.as_flattened()),
        ("opacity_logits", &parts.opacity_logits),
        ("sh", parts.sh.as_flattened()),
    ];
    for (name, values) in fields {
        assert_close(tolerance, values, &expected[name], name);
    }
}

fn assert_close(tolerance: Tolerance, found: &[f32], expected: &Value, what: &str) {
    tolerance.assert(found.iter().copied().map(f64::from), numbers(expected), what);
}

#[test]
fn loss_and_its_gradient() {
    let case = fixture("loss");
    let side = |name: &str| u32::try_from(case[name].as_u64().unwrap()).unwrap();
    let size = ImageSize { width: side("width"), height: side("height") };
    let (mut loss, mut gradient) = (PhotometricLoss::default(), Vec::new());
    // Twice, because buffers are reused.
    for _ in 0..2 {
        let terms = loss.evaluate(&rows(&case["render"]), &rows(&case["truth"]), size, 0.2, &mut gradient);
        let (l1, d_ssim) = (number(&case["l1"]), number(&case["d_ssim"]));
        F32.assert([terms.l1, terms.d_ssim, terms.total], [l1, d_ssim, 0.8 * l1 + 0.2 * d_ssim], "terms");
        let close = Tolerance { absolute: 1e-8, relative: 1e-4 };
        assert_close(close, gradient.as_flattened(), &case["gradient"], "gradient");
    }
}

#[test]
fn two_steps_of_adam_with_the_published_rates() {
    let case = fixture("adam");
    let mut scene = OptimisedGaussians::new(gaussians(&case["start"]));
    let rates = Rates::default();
    for (step, gradient) in (1..).zip(case["gradients"].as_array().unwrap()) {
        let adam = Adam {
            means: rates.means * number(&case["extent"]),
            colours: rates.colours,
            opacities: rates.opacities,
            scales: rates.scales,
            rotations: rates.rotations,
            sh_degree: 1,
            step,
        };
        adam.update(&mut scene, &gradients(gradient));
    }
    assert_parts(F32, &scene, &case["after"]);
    let moved = |value: &Value| numbers(&value["means"]);
    assert_ne!(moved(&case["start"]), moved(&case["after"]));
}

fn at(case: &Value) -> StepContext {
    let limit = case["limit"].as_u64().unwrap_or(1000);
    StepContext {
        step: case["step"].as_u64().unwrap(),
        schedule: Schedule::of(Schedule::PUBLISHED),
        extent: case["extent"].as_f64().unwrap_or(1.0),
        means_rate: case["means_rate"].as_f64().unwrap_or(0.0),
        white: false,
        seed: case["seed"].as_u64().unwrap(),
        limit: usize::try_from(limit).unwrap(),
    }
}

fn count(value: &Value) -> usize {
    usize::try_from(value.as_u64().unwrap()).unwrap()
}

/// Adaptive control that has seen the gradients of the fixture's views.
fn observed(case: &Value) -> (OptimisedGaussians, Adaptive) {
    let scene = OptimisedGaussians::new(gaussians(&case["start"]));
    let mut density = Adaptive::default();
    for view in case["views"].as_array().unwrap() {
        let drawn: Vec<u32> =
            view["drawn"].as_array().unwrap().iter().map(|at| u32::try_from(at.as_u64().unwrap()).unwrap()).collect();
        let size = <[f64; 2]>::try_from(numbers(&view["size"])).unwrap();
        density.observe(&ViewGradients { drawn: &drawn, means_2d: &rows(&view["means_2d"]), size, count: scene.len() });
    }
    (scene, density)
}

#[test]
fn adaptive_control_clones_splits_and_prunes() {
    let case = fixture("adaptive");
    let (mut scene, mut density) = observed(&case);
    let changes = density.after_step(&mut scene, &at(&case)).unwrap();
    let [cloned, split, pruned] = ["cloned", "split", "pruned"].map(|name| count(&case[name]));
    assert_eq!(changes, Changes { cloned, split, pruned, ..Changes::default() });
    assert_parts(F32, &scene, &case["after"]);
}

#[test]
fn adaptive_control_begins_after_its_first_step_and_ends_before_its_last() {
    let case = fixture("adaptive");
    let schedule = at(&case).schedule;
    let cloned = |step: u64| {
        let (mut scene, mut density) = observed(&case);
        density.after_step(&mut scene, &StepContext { step, ..at(&case) }).unwrap().cloned
    };
    let (begin, end) = (schedule.density_from, schedule.density_until);
    let steps = [begin, begin + 1, begin + schedule.density_every, end - schedule.density_every, end];
    let expected = count(&case["cloned"]);
    assert!(expected > 0);
    assert_eq!(steps.map(cloned), [0, 0, expected, expected, 0]);
}

#[test]
fn reset_lowers_opacities_as_drawn_through_the_filter() {
    let case = fixture("adaptive");
    let mut parts = gaussians(&case["start"]).into_parts();
    parts.filter_3d = Some(flat(&case["filters"]));
    let mut scene = OptimisedGaussians::new(Gaussians::new(parts).unwrap());
    let at = StepContext { step: 3000, schedule: Schedule { density_every: 7, ..Schedule::of(30_000) }, ..at(&case) };
    assert!(Adaptive::default().after_step(&mut scene, &at).unwrap().reset);
    let close = Tolerance { absolute: 1e-5, relative: 1e-5 };
    assert_close(close, &scene.gaussians().parts().opacity_logits, &case["reset_logits"], "logits");
}

#[test]
fn mcmc_relocates_grows_and_adds_noise() {
    let case = fixture("mcmc");
    let mut scene = OptimisedGaussians::new(gaussians(&case["start"]));
    let changes = Mcmc.after_step(&mut scene, &at(&case)).unwrap();
    let (relocated, added) = (count(&case["relocated"]), count(&case["added"]));
    assert_eq!(changes, Changes { relocated, added, ..Changes::default() });
    // The logit of an opacity near 1 in f32.
    assert_parts(Tolerance { absolute: 1e-5, relative: 1e-5 }, &scene, &case["after"]);
}

#[test]
fn relocation_corrects_opacity_and_scale() {
    for row in fixture("mcmc")["table"].as_array().unwrap() {
        let [opacity, together, new, factor] = [0, 1, 2, 3].map(|column| number(&row[column]));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small whole number")]
        let (found, scale) = relocated(opacity, together as usize);
        let close = Tolerance { absolute: 0.0, relative: 1e-9 };
        close.assert([found, scale], [new, factor], &format!("{together} of opacity {opacity}"));
    }
}

#[test]
fn mcmc_regularisers_reward_small_opacities_and_scales() {
    let case = fixture("mcmc");
    let scene = OptimisedGaussians::new(gaussians(&case["start"]));
    let zero = gaussians(&case["start"]).into_parts();
    let mut gradients = Gradients {
        opacity_logits: vec![0.0; zero.means.len()],
        log_scales: vec![[0.0; 3]; zero.means.len()],
        ..Gradients::default()
    };
    let sum = Mcmc.regularise(&scene, &mut gradients);
    let close = Tolerance { absolute: 1e-11, relative: 1e-5 };
    close.assert([sum], [number(&case["regularisers"])], "sum");
    assert_close(close, &gradients.opacity_logits, &case["opacity_gradient"], "opacities");
    assert_close(close, gradients.log_scales.as_flattened(), &case["scale_gradient"], "scales");
}

#[test]
fn filter_follows_the_camera_that_sees_best() {
    let case = fixture("filter_3d");
    let views: Vec<View> = case["cameras"].as_array().unwrap().iter().map(view).collect();
    let filters = Cameras::new(&views, 0.2).unwrap().filters(&rows(&case["means"])).unwrap();
    assert_close(F32, &filters, &case["filters"], "filters");
}

fn view(camera: &Value) -> View {
    let [width, height] = [0, 1].map(|at| u32::try_from(camera["size"][at].as_u64().unwrap()).unwrap());
    let size = ImageSize { width, height };
    let [fx, fy, cx, cy] = [0, 1, 2, 3].map(|at| number(&camera["intrinsics"][at]));
    let rotation = <[f64; 9]>::try_from(numbers(&camera["rotation"])).unwrap();
    let translation = <[f64; 3]>::try_from(numbers(&camera["translation"])).unwrap();
    let rotation = DMat3::from_cols_array(&rotation).transpose();
    let pose = CameraFromWorld::new(rotation, DVec3::from_array(translation)).unwrap();
    let intrinsics = PixelIntrinsics::new(fx, fy, cx, cy).unwrap().normalized_from_pixel(size).unwrap();
    View { camera: Camera::pinhole(pose, intrinsics), size }
}
