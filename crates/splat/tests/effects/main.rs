//! A plan skips effects that cannot be seen, and nothing else.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod packed_harmonics;

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::effects::{Decision, EffectOutcome, EffectPlan, EffectSelection, Scene};
use atsplat_splat::{
    Channels, Exposure, GaussianParts, Gaussians, ImageGradients, PackedHarmonics, RasterMode, ReferenceRenderer,
    RenderOptions, Renderer, Rendering, SplatError, View, hard_cases, sh_coefficients,
};
use glam::{DMat3, DVec3};
use proptest::prelude::*;

fn view(distortion: Distortion) -> View {
    let pose = CameraFromWorld::new(DMat3::from_rotation_y(0.1), DVec3::new(0.1, 0.0, 0.2)).unwrap();
    let intrinsics = NormalizedIntrinsics::new(0.9, 1.2, 0.48, 0.53).unwrap();
    let camera = Camera { distortion, ..Camera::pinhole(pose, intrinsics) };
    View { camera, size: ImageSize { width: 20, height: 15 } }
}

/// Gaussians of SH degree 3 with the given magnitude of coefficients above degree 0.
fn scene(count: usize, harmonics: f32, log_scale: f32, scalars: Option<f32>) -> Gaussians {
    let wave = |n: usize, phase: f32| (n as f32 * 1.37 + phase).sin();
    let stored = sh_coefficients(3);
    let coefficient =
        |n: usize| [0.0, 1.0, 2.0].map(|c| if n.is_multiple_of(stored) { wave(n, c) } else { harmonics * wave(n, c) });
    Gaussians::new(GaussianParts {
        means: (0..count).map(|n| [0.8 * wave(n, 0.0), 0.6 * wave(n, 1.0), 2.5 + 0.1 * n as f32]).collect(),
        quaternions: (0..count).map(|n| [1.5, wave(n, 2.0), wave(n, 3.0), wave(n, 4.0)]).collect(),
        log_scales: (0..count).map(|n| [0.0, 0.4, -0.6].map(|s| log_scale + s * wave(n, 5.0))).collect(),
        opacity_logits: (0..count).map(|n| 2.0 * wave(n, 6.0)).collect(),
        sh_degree: 3,
        sh: (0..count * stored).map(coefficient).collect(),
        scalars: scalars.map(|size| (0..count).map(|n| size * wave(n, 7.0)).collect()),
        filter_3d: None,
    })
    .unwrap()
}

/// Enough views that it pays to decide for each Gaussian.
fn many_views(gaussians: &Gaussians) -> Scene<'_> {
    Scene::new(gaussians, Scene::MIN_VIEWS)
}

fn plan(gaussians: &Gaussians, view: &View, options: &RenderOptions, selection: &str) -> EffectPlan {
    plan_within(EffectPlan::TOLERANCE, gaussians, view, options, selection)
}

fn plan_within(
    tolerance: f64,
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
    selection: &str,
) -> EffectPlan {
    let selection: EffectSelection = selection.parse().unwrap();
    EffectPlan::for_scene(&many_views(gaussians), view, options, &selection, tolerance).unwrap()
}

fn decision<'a>(plan: &'a EffectPlan, effect: &str) -> &'a Decision {
    plan.decisions().iter().find(|decision| decision.effect == effect).unwrap()
}

/// Asserts that the colour of `auto` is within the tolerance of `all` at every pixel, even at thresholds: the reference
/// renders both, so that only the plan differs, and f32 rounds each sample once. Every other image is equal bit for
/// bit.
fn assert_equal_within_tolerance(gaussians: &Gaussians, view: &View, options: &RenderOptions, what: &str) {
    let [auto, all] = ["auto", "all"].map(|selection| {
        let plan = plan(gaussians, view, options, selection);
        plan.render(&mut ReferenceRenderer, gaussians).unwrap()
    });
    let wide = |rendering: &Rendering<f32>| rendering.rgb.iter().flatten().copied().map(f64::from).collect::<Vec<_>>();
    let allowed = Tolerance { absolute: EffectPlan::TOLERANCE, relative: f64::from(f32::EPSILON) };
    allowed.assert(wide(&auto), wide(&all), what);
    assert_eq!(Rendering { rgb: all.rgb.clone(), ..auto }, all, "{what}");
}

/// The largest change of colour between `all` and `auto` on the CPU; asserts that every other image is equal bit for bit.
fn largest_change(tolerance: f64, gaussians: &Gaussians, view: &View, options: &RenderOptions) -> f64 {
    let [auto, all] = ["auto", "all"].map(|selection| {
        let plan = plan_within(tolerance, gaussians, view, options, selection);
        plan.render(&mut CpuRenderer::default(), gaussians).unwrap()
    });
    let pairs = auto.rgb.as_flattened().iter().zip(all.rgb.as_flattened());
    let changes = pairs.map(|(a, b)| f64::from((a - b).abs()));
    let largest = changes.fold(0.0, |most: f64, change| if change > most { change } else { most });
    assert_eq!(Rendering { rgb: all.rgb.clone(), ..auto }, all);
    largest
}

/// Rounding in f32, as between any two backends.
fn rounding(options: &RenderOptions) -> f64 {
    2e-5 * options.exposure.map_or(1.0, |exposure| exposure.gain())
}

fn everything() -> RenderOptions {
    RenderOptions { channels: Channels { depth: true, scalar: true, median_depth: true }, ..RenderOptions::default() }
}

#[test]
fn auto_equals_all_on_every_hard_case() {
    for case in hard_cases::catalogue() {
        assert_equal_within_tolerance(&case.gaussians, &case.view, &case.options, case.name);
    }
}

/// A log-uniform magnitude.
fn size(from: i32, to: i32) -> impl Strategy<Value = f64> {
    (f64::from(from)..f64::from(to)).prop_map(|exponent| 10f64.powf(exponent))
}

fn lens() -> impl Strategy<Value = Distortion> {
    let opencv = (size(-12, -1), -1.0..1.0f64).prop_map(|(size, k2)| Distortion::OpenCv {
        k1: -size,
        k2: k2 * size,
        k3: 0.0,
        p1: 0.1 * size,
        p2: 0.0,
    });
    prop_oneof![
        Just(Distortion::None),
        Just(Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 }),
        opencv,
        size(-6, -1).prop_map(|k| Distortion::Fisheye { k: [k, 0.0, 0.0, 0.0] }),
    ]
}

fn exposure() -> impl Strategy<Value = Option<Exposure>> {
    let near = (size(-7, 0), prop::array::uniform12(-1.0..1.0f64)).prop_map(|(size, numbers)| {
        let mut exposure = Exposure::IDENTITY;
        let entries = exposure.matrix.iter_mut().flatten().chain(&mut exposure.offset);
        entries.zip(numbers).for_each(|(entry, number)| *entry += size * number);
        Some(exposure)
    });
    prop_oneof![Just(None), Just(Some(Exposure::IDENTITY)), near]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn auto_equals_all_on_random_scenes(
        (harmonics, log_scale, count) in (size(-6, 1), -5.0..6.0f32, 0usize..12),
        scalars in prop_oneof![Just(None), Just(Some(0.0f32)), Just(Some(1.0f32))],
        (lens, exposure, background) in (lens(), exposure(), prop_oneof![Just(0.0), size(-5, 0)]),
        (antialiased, blur) in (any::<bool>(), prop_oneof![Just(0.0), Just(0.3)]),
    ) {
        #[expect(clippy::cast_possible_truncation, reason = "a size")]
        let gaussians = scene(count, harmonics as f32, log_scale, scalars);
        let mut options = RenderOptions { exposure, background: [background, 0.5 * background, 0.0], ..everything() };
        options.mode = if antialiased { RasterMode::Antialiased } else { RasterMode::Classic };
        options.constants.blur = blur;
        let what = format!("harmonics {harmonics} scale {log_scale} of {count}, {lens:?} {exposure:?}");
        assert_equal_within_tolerance(&gaussians, &view(lens), &options, &what);
    }

    /// Hundreds of Gaussians behind each pixel, with harmonics around the tolerance and opacities up to 1.
    #[test]
    fn no_pixel_changes_by_more_than_any_tolerance(
        (harmonics, log_scale, count) in (size(-4, 0), -2.5..0.0f32, 250usize..600),
        (exposure, background) in (exposure(), prop::array::uniform3(-0.5..2.0f64)),
        (opaque, depth) in (any::<bool>(), any::<bool>()),
    ) {
        #[expect(clippy::cast_possible_truncation, reason = "a size")]
        let mut parts = scene(count, harmonics as f32, log_scale, Some(1.0)).into_parts();
        parts.opacity_logits.iter_mut().for_each(|logit| *logit += if opaque { 4.0 } else { -2.0 });
        let gaussians = Gaussians::new(parts).unwrap();
        let channels = Channels { depth, ..Channels::default() };
        let options = RenderOptions { exposure, background, channels, ..RenderOptions::default() };
        for tolerance in [0.0, EffectPlan::TOLERANCE, 4.0 / 255.0, 0.1] {
            let colour = largest_change(tolerance, &gaussians, &view(Distortion::None), &options);
            prop_assert!(colour <= tolerance + rounding(&options), "{colour} at {tolerance}");
        }
    }
}

#[test]
fn the_cpu_stays_within_the_tolerance_on_every_hard_case() {
    for case in hard_cases::catalogue() {
        // Colours of up to 1e12 are rounded in proportion.
        let brightest = plan(&case.gaussians, &case.view, &case.options, "all")
            .render(&mut CpuRenderer::default(), &case.gaussians)
            .unwrap()
            .rgb
            .iter()
            .flatten()
            .fold(1.0f32, |most, channel| if channel.abs() > most { channel.abs() } else { most });
        let colour = largest_change(EffectPlan::TOLERANCE, &case.gaussians, &case.view, &case.options);
        let allowed = EffectPlan::TOLERANCE + f64::from(brightest) * rounding(&case.options);
        assert!(colour <= allowed, "{}: {colour}", case.name);
    }
}

/// Every effect that changes nothing is removed, with a bound of zero.
#[test]
fn a_scene_that_needs_no_effect_gets_none() {
    let gaussians = scene(9, 0.0, -1.0, Some(0.0));
    let zero = Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
    let mut options = RenderOptions {
        exposure: Some(Exposure::IDENTITY),
        mode: RasterMode::Antialiased,
        channels: Channels { scalar: true, ..Channels::default() },
        ..RenderOptions::default()
    };
    options.constants.blur = 0.0;
    let plan = plan(&gaussians, &view(zero), &options, "auto");
    assert_eq!(plan.reduced().view, view(Distortion::None));
    let RenderOptions { harmonics, .. } = plan.reduced().options.clone();
    assert!(harmonics.as_ref().is_some_and(|packed| packed.kept() == [9, 0, 0, 0, 0]));
    let constants = options.constants.clone();
    let bare = RenderOptions { max_sh_degree: 0, constants, harmonics, ..RenderOptions::default() };
    assert_eq!(plan.reduced().options, bare);
    for decision in plan.decisions() {
        assert!(matches!(decision.outcome, EffectOutcome::Skipped | EffectOutcome::NotRequested), "{decision:?}");
        assert_eq!(decision.bound, Some(0.0), "{decision:?}");
    }
}

#[test]
fn visible_effects_run_and_give_a_reason() {
    let gaussians = scene(9, 0.2, -1.0, Some(1.0));
    let lens = Distortion::OpenCv { k1: -0.1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
    let exposure = Some(Exposure { offset: [0.1, 0.0, 0.0], ..Exposure::IDENTITY });
    let options =
        RenderOptions { exposure, mode: RasterMode::Antialiased, background: [0.0, 0.5, 0.0], ..everything() };
    let plan = plan(&gaussians, &view(lens), &options, "auto");
    assert_eq!((&plan.reduced().view, &plan.reduced().options), (&view(lens), &options));
    let reasons: Vec<&str> = plan.decisions().iter().map(|decision| decision.reason.as_str()).collect();
    for (reason, word) in reasons.iter().zip([
        "white",
        "up to degree 3",
        "border",
        "position, shape or opacity",
        "empty pixel",
        "requested",
        "requested",
        "requested",
        "in full",
    ]) {
        assert!(reason.contains(word), "{word}: {reasons:?}");
    }
}

/// Gaussians wider than the image, from front to back: opacity logit, degree-0 coefficient, scalar.
fn giants(list: &[(f32, f32, f32)]) -> Gaussians {
    let each = |value: fn(&(f32, f32, f32)) -> f32| list.iter().map(value).collect::<Vec<_>>();
    Gaussians::new(GaussianParts {
        means: (0..list.len())
            .map(|n| [0.3 * (n as f32).sin(), 0.3 * (n as f32).cos(), 5.0 + 2.0 * n as f32])
            .collect(),
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]; list.len()],
        log_scales: (0..list.len())
            .map(|n| [100.0 * (5.0 + 2.0 * n as f32), 90.0 * (5.0 + 2.0 * n as f32), 1e-4].map(f32::ln))
            .collect(),
        opacity_logits: each(|(logit, _, _)| *logit),
        sh: each(|(_, colour, _)| *colour).into_iter().map(|colour| [colour; 3]).collect(),
        scalars: Some(each(|(_, _, scalar)| *scalar)),
        ..GaussianParts::default()
    })
    .unwrap()
}

/// Anti-aliasing and this lens change an opacity by a millionth: enough to take pixels across a threshold, where no
/// tolerance bounds the change.
#[test]
fn effects_that_may_cross_thresholds_run() {
    let logit = |opacity: f32| (opacity / (1.0 - opacity)).ln();
    let faint: Vec<(f32, f32, f32)> =
        (0u8..30).map(|n| (logit(1.0 / 255.0 * (1.0 + 1e-7 * f32::from(n))), 100.0, 1.0)).collect();
    let half = [(logit(0.5 + 1e-7), 1.0, -1e3), (8.0, 1.0, 1e3)];
    let slight = Distortion::OpenCv { k1: -1e-9, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
    for (name, gaussians) in [("faint", giants(&faint)), ("half", giants(&half))] {
        for (mode, lens) in [(RasterMode::Antialiased, Distortion::None), (RasterMode::Classic, slight)] {
            let options = RenderOptions { mode, ..everything() };
            let plan = plan(&gaussians, &view(lens), &options, "auto");
            assert_eq!((plan.reduced().view, plan.reduced().options.mode), (view(lens), mode), "{name}");
            assert_equal_within_tolerance(&gaussians, &view(lens), &options, name);
        }
    }
}

/// Under any selection, a non-finite change has no bound.
#[test]
fn an_infinite_change_has_no_bound() {
    let mut parts = scene(5, 0.0, -1.0, None).into_parts();
    parts.sh[16 + 9][1] = f32::INFINITY;
    let gaussians = Gaussians::new(parts).unwrap();
    let plan = plan(&gaussians, &view(Distortion::None), &RenderOptions::default(), "background");
    let decision = decision(&plan, "view-dependence");
    assert_eq!((decision.outcome, decision.bound), (EffectOutcome::Skipped, None));
    assert!(decision.reason.contains("not finite"), "{}", decision.reason);
}

/// Only bands too small to be visible are removed.
#[test]
fn invisible_sh_bands_are_removed() {
    let mut parts = scene(5, 0.3, -1.0, None).into_parts();
    for sh in parts.sh.as_chunks_mut::<16>().0 {
        sh[4..].iter_mut().flatten().for_each(|value| *value *= 1e-5);
    }
    let gaussians = Gaussians::new(parts).unwrap();
    let plan = plan(&gaussians, &view(Distortion::None), &RenderOptions::default(), "auto");
    assert_eq!(plan.reduced().options.max_sh_degree, 1);
    assert_eq!(decision(&plan, "view-dependence").outcome, EffectOutcome::Reduced);
    assert!(decision(&plan, "view-dependence").bound.unwrap() > 0.0);
}

/// Each change alone would be allowed; together they must not exceed the tolerance.
#[test]
fn changes_add_up() {
    let gaussians = scene(5, 0.0, -1.0, None);
    let three_quarters = 0.75 * EffectPlan::TOLERANCE;
    let exposure = Some(Exposure { offset: [three_quarters, 0.0, 0.0], ..Exposure::IDENTITY });
    let options = RenderOptions { exposure, background: [three_quarters, 0.0, 0.0], ..RenderOptions::default() };
    let plan = plan(&gaussians, &view(Distortion::None), &options, "auto");
    assert_eq!(decision(&plan, "exposure").outcome, EffectOutcome::Skipped);
    assert_eq!(decision(&plan, "background").outcome, EffectOutcome::Runs);
    let bounds: f64 = plan.decisions().iter().filter_map(|decision| decision.bound).sum();
    assert!(bounds <= plan.tolerance());
}

/// A remaining exposure amplifies small changes.
#[test]
fn exposure_amplifies_the_changes_of_other_effects() {
    let gaussians = scene(5, 1e-5, -1.0, None);
    let brighter = |gain: f64| {
        let exposure =
            Exposure { matrix: DMat3::from_diagonal(DVec3::splat(gain)).to_cols_array_2d(), offset: [0.0; 3] };
        RenderOptions { exposure: Some(exposure), ..RenderOptions::default() }
    };
    for (gain, outcome) in [(2.0, EffectOutcome::Skipped), (1e4, EffectOutcome::Runs)] {
        let plan = plan(&gaussians, &view(Distortion::None), &brighter(gain), "auto");
        assert_eq!(decision(&plan, "view-dependence").outcome, outcome, "gain {gain}");
    }
}

/// A NaN in an otherwise empty band culls its Gaussian, and must continue to do so.
#[test]
fn a_coefficient_that_culls_is_kept() {
    for value in [f32::NAN, f32::INFINITY, 1e13] {
        let mut parts = scene(5, 0.0, -1.0, None).into_parts();
        parts.sh[16 + 9][1] = value;
        let gaussians = Gaussians::new(parts).unwrap();
        let plan = plan(&gaussians, &view(Distortion::None), &RenderOptions::default(), "auto");
        assert_eq!(plan.reduced().options.max_sh_degree, 3, "{value}");
        assert_equal_within_tolerance(&gaussians, &view(Distortion::None), &RenderOptions::default(), "culled");
    }
}

/// Where exposure makes every colour black, or the tolerance is beyond all colours, every band of the others can go.
#[test]
fn no_tolerance_draws_a_culled_gaussian() {
    let here = view(Distortion::None);
    let black = Exposure { matrix: [[0.0; 3]; 3], offset: [0.25, 0.5, 0.75] };
    for (exposure, tolerance) in [
        (Some(black), EffectPlan::TOLERANCE),
        (Some(black), 0.0),
        (Some(Exposure::uniform(0.01)), 1e308),
        (Some(Exposure::uniform(1e-310)), EffectPlan::TOLERANCE),
        (None, EffectPlan::TOLERANCE),
    ] {
        for value in [f32::INFINITY, f32::NAN, 1e20, -1e20] {
            let mut parts = scene(5, 0.3, -1.0, Some(0.5)).into_parts();
            parts.sh[16 + 9][1] = value;
            let gaussians = Gaussians::new(parts).unwrap();
            let options = RenderOptions { exposure, background: [0.2, 0.0, 0.1], ..everything() };
            let what = format!("{exposure:?}, {tolerance}, {value}");
            let [auto, all] = ["auto", "all"].map(|selection| {
                let plan = plan_within(tolerance, &gaussians, &here, &options, selection);
                for decision in plan.decisions() {
                    assert!(decision.bound.is_none_or(|bound| bound <= tolerance), "{what}: {decision:?}");
                }
                plan.render(&mut ReferenceRenderer, &gaussians).unwrap()
            });
            assert_eq!((all.counts.drawn, all.counts.invalid), (4, 1), "{what}");
            assert_eq!(Rendering { rgb: all.rgb.clone(), ..auto }, all, "{what}");
        }
    }
    let gaussians = scene(5, 0.3, -1.0, None);
    let options = RenderOptions { exposure: Some(black), ..RenderOptions::default() };
    let plan = plan_within(0.0, &gaussians, &here, &options, "auto");
    assert_eq!((plan.reduced().options.max_sh_degree, decision(&plan, "view-dependence").bound), (0, Some(0.0)));
}

#[test]
fn explicit_selections_are_followed() {
    let gaussians = scene(5, 0.3, -1.0, Some(1.0));
    let options = RenderOptions { background: [0.5; 3], ..everything() };
    let here = view(Distortion::Fisheye { k: [0.0; 4] });
    let all = plan(&gaussians, &here, &options, "all");
    assert_eq!((&all.reduced().view, &all.reduced().options), (&here, &options));
    let none = plan(&gaussians, &here, &options, "none");
    assert_eq!(none.reduced().view, view(Distortion::None));
    assert_eq!(none.reduced().options, RenderOptions { max_sh_degree: 0, ..RenderOptions::default() });
    let rendering = none.render(&mut ReferenceRenderer, &gaussians).unwrap();
    assert_eq!((rendering.depth, rendering.scalar), (None, None), "no image is invented");
    let list = plan(&gaussians, &here, &options, "background,depth");
    Tolerance::EXACT.assert(list.reduced().options.background, [0.5; 3], "background");
    assert_eq!(list.reduced().options.channels, Channels { depth: true, ..Channels::default() });
    assert_eq!(list.reduced().options.max_sh_degree, 0);
}

#[test]
fn rejects_invalid_input() {
    let gaussians = scene(1, 0.0, -1.0, None);
    let options = RenderOptions::default();
    for tolerance in [-1.0, f64::NAN, f64::INFINITY] {
        let plan = EffectPlan::for_scene(
            &many_views(&gaussians),
            &view(Distortion::None),
            &options,
            &EffectSelection::Auto,
            tolerance,
        );
        assert!(matches!(plan, Err(SplatError::Tolerance { .. })), "{tolerance}");
    }
    let nowhere = View { size: ImageSize { width: 0, height: 3 }, ..view(Distortion::None) };
    let plan = EffectPlan::for_scene(&many_views(&gaussians), &nowhere, &options, &EffectSelection::Auto, 0.0);
    assert!(plan.is_err());
}

#[test]
fn an_explanation_has_a_row_per_effect() {
    let gaussians = scene(9, 0.2, -1.0, None);
    let options = RenderOptions { background: [0.5; 3], ..everything() };
    let plan = plan(&gaussians, &view(Distortion::None), &options, "auto");
    let explanation = plan.explain(&mut ReferenceRenderer, &many_views(&gaussians), 3).unwrap();
    let timed: Vec<bool> = explanation.effects.iter().map(|cost| cost.ms.is_some()).collect();
    assert_eq!(timed, [false, true, false, false, true, true, true, true]);
    assert!(explanation.requested_ms > 0.0 && explanation.reduced_ms > 0.0 && explanation.plan_ms > 0.0);
    let text = explanation.to_string();
    assert!(text.lines().nth(1).unwrap().starts_with("exposure         not requested"), "{text}");
    let costs = &explanation.effects;
    assert_eq!(costs[4].pixels, Some(1.0), "every pixel shows some of the background");
    assert!(
        costs[6].saved_ms.is_some() && costs[4].saved_ms.is_none() && costs.iter().all(|cost| cost.spent_ms >= 0.0)
    );
    assert!(explanation.largest_change <= explanation.tolerance);
    assert!(text.contains("the Gaussians have none") && text.contains("tolerance 9.8e-4"), "{text}");
}
