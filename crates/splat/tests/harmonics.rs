//! Spherical harmonics in the axes and up to the degree of the renderer's constants.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "common/cloud.rs"]
mod cloud;

use atsplat_camera::{Camera, Similarity};
use atsplat_numeric::Tolerance;
use atsplat_splat::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use atsplat_splat::effects::{EffectPlan, Scene};
use atsplat_splat::{
    Gaussians, ReferenceRenderer, RenderOptions, Renderer, RendererConstants, SMALLEST_MIN_ALPHA, ShAxes, View,
    reference, sh_coefficients,
};
use cloud::{cloud, everything, image_gradients, narrow, view};
use glam::{DMat3, DQuat, DVec3};

/// Without thresholds, which rounding could cross.
fn smooth(sh_axes: ShAxes, scale: f64) -> RenderOptions {
    let base = RendererConstants::default();
    let constants = RendererConstants {
        near: base.near * scale,
        far: base.far * scale,
        min_alpha: SMALLEST_MIN_ALPHA,
        min_transmittance: 0.0,
        sh_axes,
        ..base
    };
    RenderOptions { constants, background: [0.1, 0.6, 0.3], ..RenderOptions::default() }
}

#[test]
fn a_moved_camera_sees_moved_gaussians_in_their_colours() {
    let rotation = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1));
    let similarity = Similarity { rotation, origin: DVec3::new(0.3, 1.0, -2.0), scale: 2.5 };
    let before = view(40, 30);
    let pose = similarity.new_pose_from_old(&before.camera.camera_from_world.inverse()).unwrap().inverse();
    let after = View { camera: Camera { camera_from_world: pose, ..before.camera }, ..before };
    let samples = |gaussians: &Gaussians, view: &View, options: &RenderOptions| {
        reference::render(gaussians, view, options).unwrap().rgb.into_flattened()
    };
    let cases = [(ShAxes::Standard, 1..=4), (ShAxes::E3nn, 1..=3)];
    for (axes, degree) in cases.into_iter().flat_map(|(axes, degrees)| degrees.map(move |degree| (axes, degree))) {
        let gaussians = cloud(200, degree, 7);
        let expected = samples(&gaussians, &before, &smooth(axes, 1.0));
        let moved = gaussians.transformed_in(&similarity, axes).unwrap();
        let what = format!("{axes:?}, degree {degree}");
        Tolerance::absolute(5e-4).assert(samples(&moved, &after, &smooth(axes, 2.5)), expected.iter().copied(), &what);
        let other = if axes == ShAxes::E3nn { ShAxes::Standard } else { ShAxes::E3nn };
        let moved = gaussians.transformed_in(&similarity, other).unwrap();
        let apart =
            samples(&moved, &after, &smooth(axes, 2.5)).iter().zip(&expected).map(|(a, b)| (a - b).abs()).sum::<f64>();
        assert!(
            apart > 1e-3 * expected.len() as f64,
            "{what}: rotated in other axes, colours differ by {apart} in all"
        );
    }
}

/// diff-gaussian-rasterization evaluates 16 coefficients of each channel, whatever the Gaussians store.
#[test]
fn degrees_beyond_the_constants_change_nothing() {
    let (all, view) = (cloud(800, 4, 31), view(61, 45));
    let drawn = all.clone().with_sh_degree(3);
    for preset in RendererConstants::preset_names() {
        let options = RenderOptions { constants: RendererConstants::named(preset).unwrap(), ..everything() };
        let is_limited = matches!(preset, "inria" | "pixelsplat-family");
        let mut renderers: Vec<Box<dyn Renderer>> = vec![Box::new(ReferenceRenderer)];
        for simd in SimdLevel::available() {
            renderers.push(Box::new(CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() })));
        }
        for mut renderer in renderers {
            let what = format!("{preset}, {}", renderer.name());
            let [of_all, of_drawn] =
                [&all, &drawn].map(|gaussians| renderer.render(gaussians, &view, &options).unwrap());
            assert_eq!(of_all == of_drawn, is_limited, "{what}");
            let images = narrow(&image_gradients(&view));
            let gradients = renderer.backward(&all, &view, &options, &images).unwrap();
            let mut beyond = gradients.sh.chunks_exact(sh_coefficients(4)).flat_map(|sh| &sh[sh_coefficients(3)..]);
            assert_eq!(
                beyond.all(|gradient| gradient.iter().all(|channel| channel.abs() <= 0.0)),
                is_limited,
                "{what}"
            );
        }
        // Bounds are of what would be drawn.
        let plan = |gaussians| {
            let scene = Scene::new(gaussians, 1);
            let plan = EffectPlan::for_scene(&scene, &view, &options, &"none".parse().unwrap(), 0.0).unwrap();
            plan.decisions().to_vec()
        };
        assert_eq!(plan(&all) == plan(&drawn), is_limited, "{preset}");
    }
}

#[test]
fn ignored_degrees_are_remarked_on() {
    let options = |preset: &str, max_sh_degree| {
        let constants = RendererConstants::named(preset).unwrap();
        RenderOptions { constants, max_sh_degree, ..RenderOptions::default() }
    };
    let mut parts = cloud(5, 4, 3).into_parts();
    parts.sh[2 * 25 + 16..3 * 25].fill([0.0; 3]);
    let gaussians = Gaussians::new(parts).unwrap();
    let found = options("inria", 4).ignored_harmonics(&gaussians).unwrap();
    assert_eq!(
        found,
        "4 of 5 Gaussians have spherical harmonics above degree 3, which the constants inria do not evaluate"
    );
    assert_eq!(options("inria", 3).ignored_harmonics(&gaussians), None, "not requested");
    assert_eq!(options("exact", 4).ignored_harmonics(&gaussians), None);
    assert_eq!(options("inria", 4).ignored_harmonics(&gaussians.clone().with_sh_degree(3)), None);
    assert_eq!(options("inria", 4).ignored_harmonics(&gaussians.with_sh_degree(3).with_sh_degree(4)), None, "zeros");
}

#[test]
fn the_harmonic_that_the_published_rasterizer_evaluates_otherwise_is_remarked_on() {
    let options = |preset: &str, max_sh_degree| {
        let constants = RendererConstants::named(preset).unwrap();
        RenderOptions { constants, max_sh_degree, ..RenderOptions::default() }
    };
    let mut parts = cloud(5, 3, 3).into_parts();
    for without in [1, 4] {
        parts.sh[without * 16 + 14] = [0.0, -0.0, 0.0];
    }
    let gaussians = Gaussians::new(parts).unwrap();
    let found = options("pixelsplat-family", 4).differing_harmonics(&gaussians).unwrap();
    assert!(found.starts_with("3 of 5 Gaussians have a coefficient 14 of spherical harmonics, "), "{found}");
    for (preset, degree) in [("pixelsplat-family", 2), ("inria", 4), ("exact", 4)] {
        assert_eq!(options(preset, degree).differing_harmonics(&gaussians), None, "{preset}, degree {degree}");
    }
    let lower = gaussians.with_sh_degree(2);
    assert_eq!(options("pixelsplat-family", 4).differing_harmonics(&lower), None);
    assert_eq!(options("pixelsplat-family", 4).differing_harmonics(&lower.with_sh_degree(3)), None, "zeros");
}
