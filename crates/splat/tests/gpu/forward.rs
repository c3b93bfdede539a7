use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::gpu::GpuRenderer;
use atsplat_splat::{
    Channels, Extent, Gaussians, RasterMode, RenderOptions, Renderer, RendererConstants, SplatError, View, reference,
};
use glam::DVec3;

use crate::scenes::{assert_bound, cloud, dust, everything, filtered, gpu, image_gradients, narrow, straight, view};

fn check(gpu: &mut GpuRenderer, gaussians: &Gaussians, view: &View, options: &RenderOptions, what: &str) {
    let expected = reference::render(gaussians, view, options).unwrap();
    assert_bound(&gpu.render(gaussians, view, options).unwrap(), &expected, what);
}

#[test]
fn matches_the_reference_for_every_preset_and_mode() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(3000, 3, 7), view(97, 61));
    for preset in RendererConstants::preset_names() {
        for mode in [RasterMode::Classic, RasterMode::Antialiased] {
            let constants = RendererConstants::named(preset).unwrap();
            let options = RenderOptions { constants, mode, ..everything() };
            check(&mut gpu, &gaussians, &view, &options, &format!("{preset} {mode:?}"));
        }
    }
}

#[test]
fn matches_the_reference_for_every_degree_filter_and_channel() {
    let Some(mut gpu) = gpu() else { return };
    let view = view(50, 40);
    for degree in 0..=4 {
        let gaussians = filtered(&cloud(800, degree, 13));
        for max_sh_degree in [1, 4] {
            let channels = Channels { depth: degree % 2 == 0, scalar: degree > 2, median_depth: false };
            let options = RenderOptions { max_sh_degree, channels, ..everything() };
            check(&mut gpu, &gaussians, &view, &options, &format!("degree {degree} up to {max_sh_degree}"));
        }
    }
}

#[test]
fn matches_the_reference_for_every_lens() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, mut view) = (cloud(1000, 1, 3), view(64, 48));
    for distortion in [
        Distortion::OpenCv { k1: -0.1, k2: 0.02, k3: 0.0, p1: 0.003, p2: -0.002 },
        Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 },
        Distortion::OpenCv { k1: -0.4, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 },
        Distortion::Fisheye { k: [0.02, -0.01, 0.003, -0.001] },
        Distortion::Fisheye { k: [0.0; 4] },
    ] {
        view.camera.distortion = distortion;
        check(&mut gpu, &gaussians, &view, &everything(), &format!("{distortion:?}"));
    }
}

/// Partially filled blocks, workgroups and tiles, and empty scenes.
#[test]
fn matches_the_reference_for_odd_sizes_and_counts() {
    let Some(mut gpu) = gpu() else { return };
    for (width, height) in [(1, 1), (17, 33), (16, 16), (3, 40)] {
        for count in [0, 1, 31, 33, 255, 256, 257] {
            let (gaussians, view) = (cloud(count, 0, 5), view(width, height));
            check(&mut gpu, &gaussians, &view, &everything(), &format!("{count} on {width}×{height}"));
        }
    }
    let nothing = gpu.render(&Gaussians::default(), &view(33, 17), &RenderOptions::default()).unwrap();
    assert!(nothing.rgb.iter().flatten().chain(&nothing.alpha).all(|value| value.to_bits() == 0));
    let none = View { size: ImageSize { width: 0, height: 3 }, ..view(3, 3) };
    let empty = gpu.render(&cloud(3, 0, 1), &none, &everything());
    assert!(matches!(empty, Err(SplatError::View { .. })), "{empty:?}");
}

/// Counts around 2¹⁶, and where prefix sums need a third level.
#[test]
fn many_gaussians_match_the_cpu() {
    let Some(mut gpu) = gpu() else { return };
    let view = view(160, 120);
    let mut cpu = CpuRenderer::default();
    for count in [65_535, 65_536, 65_537, 200_000] {
        let gaussians = dust(count);
        let expected = cpu.render(&gaussians, &view, &everything()).unwrap();
        let actual = gpu.render(&gaussians, &view, &everything()).unwrap();
        assert_bound(&actual, &expected.map(f64::from), &format!("{count}"));
    }
}

/// Scene and camera translated and scaled together: means are f32, and double-single arithmetic is used up to the
/// image.
#[test]
fn matches_the_reference_far_from_the_origin_and_at_other_scales() {
    let Some(mut gpu) = gpu() else { return };
    let view = view(97, 61);
    for (scale, shift) in [(1e6f32, 0.0f32), (1e-4, 0.0), (1.0, 5e3), (100.0, 3.3e5), (1e6, 1e8)] {
        let mut parts = cloud(2000, 1, 17).into_parts();
        parts.means.iter_mut().for_each(|mean| *mean = mean.map(|value| value * scale + shift));
        parts.log_scales.iter_mut().for_each(|logs| *logs = logs.map(|log| log + scale.ln()));
        let gaussians = Gaussians::new(parts).unwrap();
        let pose = view.camera.camera_from_world;
        let centre = pose.inverse().centre() * f64::from(scale) + DVec3::splat(f64::from(shift));
        let moved = CameraFromWorld::new(pose.rotation(), -(pose.rotation() * centre)).unwrap();
        let view = View { camera: Camera { camera_from_world: moved, ..view.camera }, ..view };
        let base = everything().constants;
        let constants = RendererConstants { near: base.near * f64::from(scale), ..base };
        let options = RenderOptions { constants, ..everything() };
        let expected = reference::render(&gaussians, &view, &options).unwrap();
        assert!(expected.counts.drawn > 500, "{:?}", expected.counts);
        let actual = gpu.render(&gaussians, &view, &options).unwrap();
        assert_bound(&actual, &expected, &format!("scale {scale}, shift {shift}"));
    }
}

/// Extreme but valid Gaussians are drawn as by the reference.
#[test]
fn matches_the_reference_for_extreme_shapes() {
    let Some(mut gpu) = gpu() else { return };
    let view = view(80, 60);
    let shapes = [[3.0, -9.0, -9.0], [2.0, 2.0, -12.0], [20.0, 20.0, 20.0], [30.0, -20.0, 1.0], [-40.0, -40.0, -40.0]];
    for shape in shapes {
        let mut parts = cloud(60, 0, 29).into_parts();
        parts.log_scales.iter_mut().for_each(|logs| *logs = shape);
        let gaussians = Gaussians::new(parts).unwrap();
        check(&mut gpu, &gaussians, &view, &everything(), &format!("{shape:?}"));
    }
    let mut parts = cloud(10_000, 0, 31).into_parts();
    parts.means.iter_mut().for_each(|mean| *mean = [0.1, 0.2, 3.0]);
    let gaussians = Gaussians::new(parts).unwrap();
    check(&mut gpu, &gaussians, &view, &everything(), "coincident");
}

/// Arithmetic may take denormals for zeros, but their bits say which rotation they are.
#[test]
fn matches_the_reference_for_quaternions_of_denormals() {
    let Some(mut gpu) = gpu() else { return };
    let view = view(80, 60);
    let mut parts = cloud(500, 1, 21).into_parts();
    // 2^-140.
    let tiny = f32::from_bits(1 << 9);
    parts.quaternions.as_flattened_mut().iter_mut().for_each(|part| *part *= tiny);
    assert!(parts.quaternions.as_flattened().iter().all(|part| !part.is_normal()));
    let gaussians = Gaussians::new(parts).unwrap();
    let drawn = reference::render(&gaussians, &view, &everything()).unwrap().counts.drawn;
    assert!(drawn > 100, "{drawn}");
    check(&mut gpu, &gaussians, &view, &everything(), "denormals");
    let gradients = gpu.backward(&gaussians, &view, &everything(), &narrow(&image_gradients(&view))).unwrap();
    assert_eq!(gradients.non_finite(), 0);
}

/// Gaussians that cover the image, with centres on both sides of the limits that every renderer has.
#[test]
fn culls_centres_too_far_aside_or_too_deep() {
    let Some(mut gpu) = gpu() else { return };
    let view = straight(24, 18);
    for (preset, mean, log_scale, [drawn, outside_depth, outside_image]) in [
        ("exact", [1e6, 0.0, 0.02], 25.0, [1, 0, 0]),
        ("exact", [1e9, 0.0, 0.02], 25.0, [0, 0, 1]),
        ("exact", [0.0, -1e9, 0.02], 25.0, [0, 0, 1]),
        ("inria", [0.0, 0.0, 1e11], 30.0, [1, 0, 0]),
        ("inria", [0.0, 0.0, 1e13], 30.0, [0, 1, 0]),
        ("pixelsplat-family", [0.0, 0.0, 1e13], 30.0, [0, 1, 0]),
    ] {
        let mut parts = cloud(1, 0, 37).into_parts();
        parts.means = vec![mean];
        parts.quaternions = vec![[1.0, 0.0, 0.0, 0.0]];
        parts.log_scales = vec![[log_scale; 3]];
        parts.opacity_logits = vec![3.0];
        let gaussians = Gaussians::new(parts).unwrap();
        let options = RenderOptions { constants: RendererConstants::named(preset).unwrap(), ..everything() };
        let expected = CpuRenderer::default().render(&gaussians, &view, &options).unwrap().counts;
        let counts = [expected.drawn, expected.outside_depth, expected.outside_image];
        assert_eq!(counts, [drawn, outside_depth, outside_image], "{preset}, {mean:?}");
        let actual = gpu.render(&gaussians, &view, &options).unwrap();
        assert_eq!(actual.counts, expected, "{preset}, {mean:?}");
        check(&mut gpu, &gaussians, &view, &options, &format!("{preset}, {mean:?}"));
    }
}

/// Without blur, Gaussians may be arbitrarily narrow: points, and sheets seen edge-on.
#[test]
fn matches_the_reference_without_blur() {
    let Some(mut gpu) = gpu() else { return };
    let view = view(80, 60);
    let shapes = [[-24.0, -24.0, -24.0], [-30.0, -31.0, -29.0], [-40.0, -40.0, -40.0], [-3.0, -12.0, -14.0]];
    for extent in [Extent::Exact, Extent::ThreeSigmaTiles] {
        for shape in shapes {
            let mut parts = cloud(300, 0, 29).into_parts();
            parts.log_scales.iter_mut().for_each(|logs| *logs = shape);
            let gaussians = Gaussians::new(parts).unwrap();
            let constants = RendererConstants { blur: 0.0, extent, ..RendererConstants::default() };
            let options = RenderOptions { constants, ..everything() };
            check(&mut gpu, &gaussians, &view, &options, &format!("{shape:?} {extent:?}"));
            let gradients = gpu.backward(&gaussians, &view, &options, &narrow(&image_gradients(&view))).unwrap();
            assert_eq!(gradients.non_finite(), 0, "{shape:?} {extent:?}");
        }
    }
}

#[test]
fn rendering_is_deterministic() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(4000, 2, 11), view(131, 77));
    let first = gpu.render(&gaussians, &view, &everything()).unwrap();
    // Another rendering in between has no effect.
    gpu.render(&cloud(900, 1, 2), &View { size: ImageSize { width: 40, height: 50 }, ..view }, &everything()).unwrap();
    for _ in 0..3 {
        assert!(gpu.render(&gaussians, &view, &everything()).unwrap() == first);
    }
}

/// diff-gaussian-rasterization evaluates 16 coefficients of each channel, whatever the Gaussians store.
#[test]
fn degrees_beyond_the_constants_change_nothing() {
    let Some(mut gpu) = gpu() else { return };
    let (all, view) = (cloud(800, 4, 31), view(61, 45));
    let drawn = all.clone().with_sh_degree(3);
    let resident = gpu.upload(&all).unwrap();
    for (preset, is_limited) in [("inria", true), ("pixelsplat-family", true), ("gsplat-1.6", false)] {
        let options = RenderOptions { constants: RendererConstants::named(preset).unwrap(), ..everything() };
        let expected = gpu.render(&drawn, &view, &options).unwrap();
        assert_eq!(gpu.render(&all, &view, &options).unwrap() == expected, is_limited, "{preset}");
        assert_eq!(
            gpu.render_uploaded(&resident, &view, &options).unwrap() == expected,
            is_limited,
            "{preset}, resident"
        );
    }
}
