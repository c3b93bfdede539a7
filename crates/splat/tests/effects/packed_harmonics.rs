//! Bands of spherical harmonics, decided for each Gaussian.

use super::*;

/// One Gaussian needs one band more than its neighbours, and gets it.
#[test]
fn each_gaussian_keeps_the_bands_that_it_needs() {
    let mut parts = scene(5, 0.0, -1.0, None).into_parts();
    let (flat, [first, second, third]) = (1e-4, [[0.2; 3], [0.0, 0.2, 0.0], [0.0, 0.0, -0.2]]);
    for (at, sh) in parts.sh.as_chunks_mut::<16>().0.iter_mut().enumerate() {
        sh[15] = [flat; 3];
        match at {
            1 => sh[2] = first,
            2 => sh[7] = second,
            3 => sh[12] = third,
            _ => {}
        }
    }
    let gaussians = Gaussians::new(parts).unwrap();
    let packed = PackedHarmonics::pack(&gaussians, 4, EffectPlan::TOLERANCE).unwrap();
    assert_eq!((packed.kept(), packed.degree()), ([2, 1, 1, 1, 0], 3));
    // √(7 / 4π) times the only coefficients that are dropped.
    Tolerance::relative(1e-4).assert([packed.bound()], [0.746_352_665 * f64::from(flat)], "bound");
    let lower = PackedHarmonics::pack(&gaussians, 2, EffectPlan::TOLERANCE).unwrap();
    assert_eq!((lower.kept(), lower.degree()), ([3, 1, 1, 0, 0], 2), "no band above the requested one");
    let colour = largest_change(EffectPlan::TOLERANCE, &gaussians, &view(Distortion::None), &everything());
    assert!(colour <= EffectPlan::TOLERANCE);
}

/// It keeps every band, so that nothing changes: neither does the bound.
#[test]
fn a_culled_gaussian_adds_nothing_to_the_bound() {
    for degree in 1..=4 {
        let mut parts = scene(3, 1e-5, -1.0, None).with_sh_degree(degree).into_parts();
        parts.sh[sh_coefficients(degree) + 1][2] = f32::NEG_INFINITY;
        let gaussians = Gaussians::new(parts).unwrap();
        for tolerance in [1e-3, f64::MAX, f64::INFINITY] {
            let packed = PackedHarmonics::pack(&gaussians, 4, tolerance).unwrap();
            assert_eq!((packed.kept()[0], packed.kept()[usize::from(degree)]), (2, 1), "{degree}, {tolerance}");
            assert!(packed.bound() > 0.0 && packed.bound() < 1e-3, "{degree}: {}", packed.bound());
        }
    }
}

/// Along the axis of its only harmonic, a Gaussian's colour changes by exactly the bound: half of it would not do.
#[test]
fn the_bound_is_reached() {
    const TOLERANCE: f64 = 0.02;
    for (at, band) in [(2, 1.0), (6, 2.0), (12, 3.0)] {
        let sup = f64::sqrt((2.0 * band + 1.0) / (4.0 * std::f64::consts::PI));
        for (share, drops) in [(0.99, true), (1.01, false), (1.9, false)] {
            let mut parts = giants(&[(8.0, 1.0, 0.0)]).into_parts();
            parts.means = vec![[0.0, 0.0, 5.0]];
            parts.sh_degree = 3;
            parts.sh.resize(16, [0.0; 3]);
            #[expect(clippy::cast_possible_truncation, reason = "a coefficient")]
            let coefficient = (share * TOLERANCE / sup) as f32;
            parts.sh[at] = [coefficient, 0.0, 0.0];
            let gaussians = Gaussians::new(parts).unwrap();
            let packed = PackedHarmonics::pack(&gaussians, 4, TOLERANCE).unwrap();
            assert_eq!(packed.degree() == 0, drops, "{share} of the tolerance in coefficient {at}");
            let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
            let view = View {
                camera: Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics),
                size: ImageSize { width: 9, height: 9 },
            };
            let images = [None, Some(std::sync::Arc::new(packed))].map(|harmonics| {
                let options = RenderOptions { harmonics, ..RenderOptions::default() };
                CpuRenderer::default().render(&gaussians, &view, &options).unwrap().rgb
            });
            let change = f64::from((images[0][40][0] - images[1][40][0]).abs());
            assert!(change <= TOLERANCE, "{change}");
            if drops {
                assert!(change > 0.98 * TOLERANCE, "coefficient {at} is seen along its axis: {change}");
            }
        }
    }
}

/// Gradients are those of everything, whatever rendering leaves out.
#[test]
fn gradients_leave_nothing_out() {
    let gaussians = scene(40, 0.3, -0.5, None);
    let at = view(Distortion::None);
    let packed = PackedHarmonics::pack(&gaussians, 4, 10.0).unwrap();
    assert_eq!(packed.degree(), 0);
    let reduced = RenderOptions { harmonics: Some(std::sync::Arc::new(packed)), ..RenderOptions::default() };
    let images = ImageGradients { rgb: vec![[1.0, -0.5, 0.3]; at.pixels()], alpha: None, depth: None, scalar: None };
    let renderers: [Box<dyn Renderer>; 2] = [Box::new(CpuRenderer::default()), Box::new(ReferenceRenderer)];
    for mut renderer in renderers {
        let [less, all] = [&reduced, &RenderOptions::default()]
            .map(|options| renderer.backward(&gaussians, &at, options, &images).unwrap());
        assert_eq!(less, all, "{}", renderer.name());
        let [less, all] =
            [&reduced, &RenderOptions::default()].map(|options| renderer.render(&gaussians, &at, options).unwrap().rgb);
        assert_ne!(less, all, "{}", renderer.name());
    }
}

#[test]
fn packed_harmonics_of_other_gaussians_are_rejected() {
    let packed = PackedHarmonics::pack(&scene(4, 0.3, -1.0, None), 4, 0.0).unwrap();
    let options = RenderOptions { harmonics: Some(std::sync::Arc::new(packed)), ..RenderOptions::default() };
    let gaussians = scene(5, 0.3, -1.0, None);
    let renderers: [Box<dyn Renderer>; 2] = [Box::new(CpuRenderer::default()), Box::new(ReferenceRenderer)];
    for mut renderer in renderers {
        let outcome = renderer.render(&gaussians, &view(Distortion::None), &options);
        assert!(matches!(outcome, Err(SplatError::Length { expected: 5, found: 4, .. })), "{outcome:?}");
    }
}

#[test]
fn packed_harmonics_of_as_many_other_gaussians_are_rejected() {
    let gaussians = scene(70, 0.3, -1.0, None);
    let changed = |at: usize, coefficient: usize, by: f32| {
        let mut parts = gaussians.clone().into_parts();
        parts.sh[at * sh_coefficients(3) + coefficient][1] += by;
        Gaussians::new(parts).unwrap()
    };
    let renderers: [Box<dyn Renderer>; 2] = [Box::new(CpuRenderer::default()), Box::new(ReferenceRenderer)];
    for mut renderer in renderers {
        let mut rendered = |packed: &Gaussians, gaussians: &Gaussians| {
            let harmonics = PackedHarmonics::pack(packed, 4, 0.0).map(std::sync::Arc::new);
            renderer.render(
                gaussians,
                &view(Distortion::None),
                &RenderOptions { harmonics, ..RenderOptions::default() },
            )
        };
        assert!(rendered(&gaussians, &gaussians).is_ok());
        for (at, coefficient) in [(0, 0), (2, 15), (68, 4)] {
            let outcome = rendered(&changed(at, coefficient, 0.25), &gaussians);
            assert!(matches!(outcome, Err(SplatError::OtherHarmonics { position }) if position == at), "{outcome:?}");
        }
        let outcome = rendered(&gaussians, &gaussians.clone().with_sh_degree(1));
        assert!(
            matches!(outcome, Err(SplatError::OtherHarmonics { position: 0 })),
            "a degree that is gone: {outcome:?}"
        );
    }
}

/// For few views nothing is decided for each Gaussian.
#[test]
fn packing_waits_until_it_pays() {
    let gaussians = scene(5, 0.0, -1.0, None);
    let (at, options) = (view(Distortion::None), RenderOptions::default());
    for (views, reduced) in [(1, 4), (Scene::MIN_VIEWS - 1, 4), (Scene::MIN_VIEWS, 0)] {
        let scene = Scene::new(&gaussians, views);
        let plan = EffectPlan::for_scene(&scene, &at, &options, &EffectSelection::Auto, 0.0).unwrap();
        assert_eq!(plan.reduced().options.max_sh_degree, reduced, "{views} views");
    }
}
