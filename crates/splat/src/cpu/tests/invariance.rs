//! Bit-exact invariances, and scenes that are hard to render against the reference.

use super::*;

fn gradients(gaussians: &Gaussians, view: &View, simd: SimdLevel) -> Gradients<f32> {
    let mut renderer = CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() });
    renderer.backward(gaussians, view, &everything(), &narrow(&image_gradients(view))).unwrap()
}

/// A view along +z from the origin.
fn straight(width: u32, height: u32) -> View {
    let mut view = view(width, height);
    view.camera.camera_from_world = CameraFromWorld::IDENTITY;
    view
}

/// Vectors of 4, 8 and 16 lanes, without fused multiply-add.
#[test]
fn the_number_of_lanes_does_not_change_results() {
    let (gaussians, view) = (cloud(1500, 3, 31), view(83, 67));
    let of = |simd| rendered(&gaussians, &view, &everything(), CpuOptions { simd, ..CpuOptions::default() });
    let (expected, expected_gradients) = (of(SimdLevel::Portable), gradients(&gaussians, &view, SimdLevel::Portable));
    for simd in [SimdLevel::Lanes4, SimdLevel::Lanes16] {
        assert!(of(simd) == expected, "{simd:?}");
        assert!(gradients(&gaussians, &view, simd) == expected_gradients, "{simd:?}");
    }
}

/// Needles of every direction, most of them slanted, in every instruction set.
#[test]
fn gradients_of_needles_are_identical_for_every_number_of_lanes() {
    let view = view(83, 67);
    let mut parts = cloud(600, 1, 39).into_parts();
    parts.log_scales.iter_mut().for_each(|logs| *logs = [logs[0] + 3.0, -7.0, -7.0]);
    let gaussians = Gaussians::new(parts).unwrap();
    let (portable, fused) =
        (gradients(&gaussians, &view, SimdLevel::Portable), gradients(&gaussians, &view, SimdLevel::best()));
    for simd in [SimdLevel::Lanes4, SimdLevel::Lanes16] {
        assert!(gradients(&gaussians, &view, simd) == portable, "{simd:?}");
    }
    for simd in SimdLevel::with_fma() {
        assert!(gradients(&gaussians, &view, simd) == fused, "{simd:?}");
    }
    let mut renderer = CpuRenderer::default();
    renderer.render(&gaussians, &view, &everything()).unwrap();
    let frame = renderer.spare.first().unwrap();
    let drawn = &frame.splats[..frame.runs[0].positions.len()];
    let slanted = drawn.iter().filter(|splat| project::is_slanted(splat.whitener)).count();
    assert!(slanted > 100 && drawn.len() - slanted > 50, "{slanted} of {}", drawn.len());
}

/// Needles through the image whose centres are far outside of it: terms that are large in f32 cancel.
#[test]
fn distant_centres_match_the_reference_in_tiles_of_any_size() {
    let view = straight(131, 77);
    for pixels in [3e5f32, 3e6, 3e7] {
        for step in 0..8u8 {
            let (what, angle) = (format!("{pixels} pixels, step {step}"), 0.2 + 0.37 * f32::from(step));
            // A focal length of 104.8 pixels.
            let distance = pixels / 104.8;
            let mean = [-distance * angle.cos(), -distance * angle.sin(), 1.0];
            let quaternion = [(0.5 * angle).cos(), 0.0, 0.0, (0.5 * angle).sin()];
            let gaussians = single(82, mean, quaternion, [(0.5 * distance).ln(), -3.5, -9.0], 3.0);
            let [found, smaller, larger] = [32, 16, 64]
                .map(|tile| with_tiles(CpuOptions::default(), tile).render(&gaussians, &view, &everything()).unwrap());
            assert!(smaller == found && larger == found, "{what}: tiles");
            let expected = reference::render(&gaussians, &view, &everything()).unwrap();
            assert!(expected.alpha.iter().any(|alpha| *alpha > 0.1), "{what}: nothing to see");
            let (_, largest) = beyond(&found.alpha, &expected.alpha, 0.0);
            assert!(largest < 2e-5, "{what}: {largest}");
        }
    }
}

fn bits(values: [f32; 3]) -> [u32; 3] {
    values.map(f32::to_bits)
}

/// The gradients shared by all Gaussians.
fn shared(gradients: &Gradients<f32>) -> ([u32; 6], [u32; 3]) {
    (gradients.pose.map(f32::to_bits), bits(gradients.background))
}

/// More than a run of culled Gaussians, before, after and in between the others.
#[test]
fn culled_gaussians_do_not_affect_gradients() {
    let (gaussians, view) = (cloud(3000, 0, 35), view(70, 50));
    let expected = gradients(&gaussians, &view, SimdLevel::best());
    let culled = {
        let mut parts = cloud(4500, 0, 36).into_parts();
        parts.means.iter_mut().for_each(|mean| mean[2] = -5.0);
        Gaussians::new(parts).unwrap()
    };
    let halves = |gaussians: &Gaussians, from: usize, past: usize| {
        let positions: Vec<usize> = (from..past).collect();
        gaussians.select(&positions).unwrap()
    };
    let between = halves(&gaussians, 0, 1700).merge(culled.clone()).merge(halves(&gaussians, 1700, 3000));
    let before = culled.clone().merge(gaussians.clone());
    for (with, first, past) in [(before, 4500, 4500), (gaussians.merge(culled), 0, 0), (between, 0, 1700)] {
        let found = gradients(&with, &view, SimdLevel::best());
        assert_eq!(shared(&found), shared(&expected));
        let position = |at: usize| {
            if first > 0 {
                at + first
            } else if past > 0 && at >= past {
                at + 4500
            } else {
                at
            }
        };
        let of_one = |gradients: &Gradients<f32>, at: usize| [gradients.means[at], gradients.sh[at]].map(bits);
        assert!((0..3000).all(|at| of_one(&found, position(at)) == of_one(&expected, at)));
    }
}

/// Gaussians behind opaque walls have no effect, wherever they are in the list.
#[test]
fn occluded_gaussians_change_nothing() {
    let view = view(70, 50);
    let mut walls = cloud(40, 0, 37).into_parts();
    for (at, mean) in walls.means.iter_mut().enumerate() {
        *mean = [0.0, 0.0, 2.0 + 0.01 * at as f32];
    }
    walls.log_scales.fill([4.0; 3]);
    walls.opacity_logits.fill(9.0);
    let walls = Gaussians::new(walls).unwrap();
    let mut hidden = cloud(5000, 0, 38).into_parts();
    hidden.means.iter_mut().for_each(|mean| mean[2] += 20.0);
    let hidden = Gaussians::new(hidden).unwrap();
    let alone = rendered(&walls, &view, &everything(), CpuOptions::default());
    let expected = gradients(&walls, &view, SimdLevel::best());
    for (both, first) in [(hidden.clone().merge(walls.clone()), 5000), (walls.merge(hidden), 0)] {
        let mut rendering = rendered(&both, &view, &everything(), CpuOptions::default());
        assert!(rendering.counts.drawn > alone.counts.drawn + 1000, "{:?}", rendering.counts);
        rendering.counts = alone.counts;
        assert!(rendering == alone);
        let found = gradients(&both, &view, SimdLevel::best());
        assert_eq!(shared(&found), shared(&expected));
        assert!(found.means[first..first + 40] == expected.means[..]);
    }
}

#[test]
fn gradients_are_identical_for_every_instruction_set_with_fma() {
    let (gaussians, view) = (cloud(1500, 2, 33), view(70, 90));
    let expected = gradients(&gaussians, &view, SimdLevel::best());
    for simd in SimdLevel::with_fma() {
        assert!(gradients(&gaussians, &view, simd) == expected, "{simd:?}");
    }
}

#[test]
fn a_recording_gives_the_rendering_and_its_gradients() {
    let view = view(75, 51);
    let images = narrow(&image_gradients(&view));
    let mut renderer = CpuRenderer::default();
    let mut reused = Gradients::default();
    for (count, seed) in [(900, 41), (300, 42), (5000, 43)] {
        let gaussians = cloud(count, 1, seed);
        let rendering = renderer.render(&gaussians, &view, &everything()).unwrap();
        let expected = CpuRenderer::default().backward(&gaussians, &view, &everything(), &images).unwrap();
        let shared = std::sync::Arc::new(gaussians);
        let mut recording = renderer.record(std::sync::Arc::clone(&shared), &view, &everything()).unwrap();
        assert!(*recording.rendering() == rendering);
        // Another rendering in between uses other buffers.
        renderer.render(&cloud(50, 0, 44), &view, &everything()).unwrap();
        assert!(recording.backward(&images).unwrap() == expected);
        recording.backward_into(&images, &mut reused).unwrap();
        assert!(reused == expected);
        let (_, images) = renderer.reuse(recording);
        assert!(images == rendering);
    }
}

/// A loss may use channels that were not rendered.
#[test]
fn gradients_of_channels_that_were_not_recorded() {
    let (gaussians, view) = (cloud(700, 0, 45), view(50, 40));
    let images = narrow(&image_gradients(&view));
    let mut renderer = CpuRenderer::default();
    let colour_alone = RenderOptions { channels: Channels::default(), ..everything() };
    let expected = renderer.backward(&gaussians, &view, &everything(), &images).unwrap();
    assert!(renderer.backward(&gaussians, &view, &colour_alone, &images).unwrap() == expected);
}

/// Every second view has a lens that does not see all Gaussians.
#[test]
fn rendering_many_views_equals_rendering_each() {
    let gaussians = cloud(5000, 2, 51);
    let views: Vec<View> = (0..7)
        .map(|n| {
            let mut view = view(40 + 13 * n, 61 - 5 * n);
            let rotation = DMat3::from_rotation_y(0.1 * f64::from(n));
            view.camera.camera_from_world = CameraFromWorld::new(rotation, DVec3::new(0.1, 0.0, 0.3)).unwrap();
            if n % 2 == 1 {
                view.camera.distortion = Distortion::OpenCv { k1: -0.3, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
            }
            view
        })
        .collect();
    let expected: Vec<_> =
        views.iter().map(|view| rendered(&gaussians, view, &everything(), CpuOptions::default())).collect();
    for memory_limit in [2_000_000, 16 << 30] {
        let mut renderer = CpuRenderer::new(CpuOptions { memory_limit, ..CpuOptions::default() });
        let together = renderer.render_many(&gaussians, &views, &everything()).unwrap();
        assert!(together == expected, "{memory_limit}");
    }
    assert_eq!(CpuRenderer::default().render_many(&gaussians, &[], &everything()).unwrap(), Vec::new());
}

#[test]
fn images_of_any_shape_can_be_reused() {
    let gaussians = cloud(200, 0, 52);
    let mut images = rendered(&cloud(90, 0, 53), &view(90, 20), &everything(), CpuOptions::default());
    for (size, options) in [((33, 47), RenderOptions::default()), ((64, 64), everything())] {
        let view = view(size.0, size.1);
        CpuRenderer::default().render_into(&gaussians, &view, &options, &mut images).unwrap();
        assert!(images == rendered(&gaussians, &view, &options, CpuOptions::default()));
    }
}

/// Needles longer than the image, specks far smaller than a pixel, and occluding surfaces: blocks are found and
/// finished correctly.
#[test]
fn needles_and_walls_match_the_reference() {
    let view = view(101, 67);
    let mut parts = cloud(1500, 0, 61).into_parts();
    for (at, (scales, logit)) in parts.log_scales.iter_mut().zip(&mut parts.opacity_logits).enumerate() {
        match at % 3 {
            0 => *scales = [scales[0] + 3.0, scales[1] - 6.0, scales[2] - 6.0],
            1 => *scales = [-9.0; 3],
            _ => *logit = 8.0,
        }
    }
    let gaussians = Gaussians::new(parts).unwrap();
    for preset in ["exact", "inria"] {
        let constants = RendererConstants::named(preset).unwrap();
        let options = RenderOptions { constants, ..everything() };
        let expected = reference::render(&gaussians, &view, &options).unwrap();
        for tile in TILES {
            let actual = with_tiles(CpuOptions::default(), tile).render(&gaussians, &view, &options).unwrap();
            assert_close(&actual, &expected, &format!("{preset}, tiles of {tile}"));
        }
    }
}

/// Lenses, filters, presets and stopped gradients in the SIMD backward pass.
#[test]
fn gradients_of_every_rule_match_the_reference() {
    let gaussians = {
        let mut parts = cloud(400, 3, 71).into_parts();
        parts.filter_3d = Some((0..400).map(|n| 0.01 * (n % 4) as f32).collect());
        Gaussians::new(parts).unwrap()
    };
    let mut distorted = view(47, 58);
    distorted.camera.distortion = Distortion::OpenCv { k1: -0.1, k2: 0.02, k3: 0.0, p1: 0.003, p2: -0.002 };
    for view in [view(47, 58), distorted] {
        for preset in RendererConstants::preset_names() {
            for stops in [false, true] {
                let constants = RendererConstants { min_alpha: 1e-5, ..RendererConstants::named(preset).unwrap() };
                let gradients = crate::StoppedGradients { scalar_stops: stops, directions_stop: stops };
                let mode = if stops { RasterMode::Antialiased } else { RasterMode::Classic };
                let options = RenderOptions { constants, mode, gradients, ..everything() };
                let images = image_gradients(&view);
                let expected = reference::backward(&gaussians, &view, &options, &images).unwrap();
                let actual = CpuRenderer::default().backward(&gaussians, &view, &options, &narrow(&images)).unwrap();
                assert_gradients_close(&actual, &expected, &format!("{preset} {stops}"));
            }
        }
    }
}

/// A diagonal needle is listed only in the tiles that it touches, not in all tiles of its bounding box.
#[test]
fn tile_lists_follow_the_ellipse() {
    let half_angle = std::f32::consts::FRAC_PI_8;
    let quaternion = [half_angle.cos(), 0.0, 0.0, half_angle.sin()];
    let gaussians = single(81, [0.0, 0.0, 2.0], quaternion, [1.0, -6.0, -6.0], 5.0);
    let view = straight(512, 512);
    let mut renderer = CpuRenderer::default();
    renderer.render(&gaussians, &view, &RenderOptions::default()).unwrap();
    let frame = renderer.spare.first().unwrap();
    let listed: usize = (0..frame.tiling().len()).map(|tile| frame.bins[0].list(tile).len()).sum();
    assert!((16..=64).contains(&listed), "{listed} of {}", frame.tiling().len());
}
