//! Batches against the same views one by one.

use atsplat_camera::Distortion;
use atsplat_numeric::Tolerance;
use atsplat_splat::gpu::{GpuCounts, GpuError, GpuGaussians, GpuOptions, GpuOverrides, GpuPart, GpuRenderer};
use atsplat_splat::{GaussianParts, Gaussians, Gradients, ImageGradients, Renderer, SplatError, View};
use glam::{DMat3, DVec3};

use crate::scenes::{
    cloud, everything, external_device, gpu, image_gradients, narrow, on_device, open, overriding, view,
};

/// Each from elsewhere, through another lens.
fn views(count: usize, width: u32, height: u32) -> Vec<View> {
    let moved = |at: usize| {
        let mut turned = view(width, height);
        let turn = DMat3::from_rotation_y(0.05 * at as f64);
        let pose = turned.camera.camera_from_world;
        turned.camera.camera_from_world = atsplat_camera::CameraFromWorld::new(
            turn * pose.rotation(),
            pose.translation() + DVec3::new(0.1 * at as f64, -0.07, 0.05 * at as f64),
        )
        .unwrap();
        turned.camera.distortion = match at % 3 {
            0 => Distortion::None,
            1 => Distortion::OpenCv { k1: -0.3, k2: 0.0, k3: 0.0, p1: 0.004, p2: -0.003 },
            _ => Distortion::Fisheye { k: [0.02, -0.01, 0.0, 0.0] },
        };
        turned
    };
    (0..count).map(moved).collect()
}

fn scenes(count: u32, gaussians: usize) -> Vec<Gaussians> {
    (0..count).map(|scene| cloud(gaussians, 1, 19 + scene)).collect()
}

/// Scenes one after the other.
fn joined(scenes: &[Gaussians]) -> Gaussians {
    let mut all = GaussianParts { sh_degree: 1, scalars: Some(Vec::new()), ..GaussianParts::default() };
    for scene in scenes {
        let parts = scene.parts();
        all.means.extend(&parts.means);
        all.quaternions.extend(&parts.quaternions);
        all.log_scales.extend(&parts.log_scales);
        all.opacity_logits.extend(&parts.opacity_logits);
        all.sh.extend(&parts.sh);
        all.scalars.iter_mut().for_each(|scalars| scalars.extend(parts.scalars.iter().flatten()));
    }
    Gaussians::new(all).unwrap()
}

type Field = fn(&Gradients<f32>) -> &[f32];

/// Three scenes with two views each: images, and gradients summed over the views of each scene.
#[test]
fn a_batch_equals_its_views_one_by_one() {
    let Some(mut gpu) = gpu() else { return };
    let (scenes, views) = (scenes(3, 500), views(6, 53, 41));
    let joined = joined(&scenes);
    let resident = gpu.upload(&joined).unwrap();
    let pending = gpu.render_batch(&resident, 3, &views, &everything()).unwrap();
    let batch = gpu.read(&pending).unwrap();
    assert_eq!((batch.size.width, batch.size.height), (53, 6 * 41));
    let mut drawn = 0;
    for (at, view) in views.iter().enumerate() {
        let alone = gpu.render(&scenes[at / 2], view, &everything()).unwrap();
        let pixels = at * view.pixels()..(at + 1) * view.pixels();
        assert!(batch.rgb[pixels.clone()] == alone.rgb, "view {at}");
        assert!(batch.alpha[pixels.clone()] == alone.alpha, "view {at}");
        assert!(batch.depth.as_ref().unwrap()[pixels.clone()] == *alone.depth.as_ref().unwrap(), "view {at}");
        assert!(
            batch.median_depth.as_ref().unwrap()[pixels.clone()] == *alone.median_depth.as_ref().unwrap(),
            "view {at}"
        );
        assert!(batch.scalar.as_ref().unwrap()[pixels] == *alone.scalar.as_ref().unwrap(), "view {at}");
        assert!(alone.counts.drawn > 100 && alone.counts.outside_image > 0, "{:?}", alone.counts);
        drawn += alone.counts.drawn;
    }
    assert_eq!(batch.counts.drawn, drawn);

    let phases = |at: usize| {
        let mut gradients = narrow(&image_gradients(&views[at]));
        gradients.rgb.rotate_left(11 * at);
        gradients
    };
    let images: Vec<ImageGradients<f32>> = (0..6).map(phases).collect();
    let by_images = on_device(&gpu, &images);
    let pending = gpu.backward_batch(&resident, 3, &views, &everything(), &by_images).unwrap();
    let found = gpu.read_gradients(&pending, &joined).unwrap();
    for (scene, gaussians) in scenes.iter().enumerate() {
        let mut of_view = |at: usize| gpu.backward(gaussians, &views[at], &everything(), &images[at]).unwrap();
        let [first, second] = [of_view(2 * scene), of_view(2 * scene + 1)];
        let range = scene * 500..(scene + 1) * 500;
        let fields: [(&str, Field, usize); 6] = [
            ("means", |gradients| gradients.means.as_flattened(), 3),
            ("quaternions", |gradients| gradients.quaternions.as_flattened(), 4),
            ("log scales", |gradients| gradients.log_scales.as_flattened(), 3),
            ("opacity logits", |gradients| &gradients.opacity_logits, 1),
            ("SH", |gradients| gradients.sh.as_flattened(), 12),
            ("scalars", |gradients| &gradients.scalars, 1),
        ];
        for (name, of, each) in fields {
            let sum: Vec<f32> = of(&first).iter().zip(of(&second)).map(|(a, b)| a + b).collect();
            assert!(of(&found)[range.start * each..range.end * each] == sum, "{name} of scene {scene}");
            assert!(sum.iter().any(|value| value.abs() > 0.0) && of(&first) != of(&second), "{name}");
        }
    }
    let poses: Vec<[f32; 6]> = views
        .iter()
        .zip(&images)
        .enumerate()
        .map(|(at, (view, images))| gpu.backward(&scenes[at / 2], view, &everything(), images).unwrap().pose)
        .collect();
    let sums: Vec<f64> = (0..6).map(|axis| poses.iter().map(|pose| f64::from(pose[axis])).sum()).collect();
    Tolerance::of_largest(1e-5, sums.iter().copied()).assert(found.pose.map(f64::from), sums, "pose");
}

/// Kernels are launched once for the whole batch; only passes of sorts and levels of sums grow, with logarithms.
#[test]
fn launches_do_not_grow_with_the_batch() {
    let Some(mut gpu) = gpu() else { return };
    let mut launches = |count: u32| -> [GpuCounts; 2] {
        let views = views(2 * count as usize, 64, 64);
        let resident = gpu.upload(&joined(&scenes(count, 1500))).unwrap();
        let images: Vec<_> = views.iter().map(|view| narrow(&image_gradients(view))).collect();
        let by_images = on_device(&gpu, &images);
        let render = |gpu: &mut GpuRenderer| {
            let pending = gpu.render_batch(&resident, count, &views, &everything()).unwrap();
            gpu.settle(&pending).unwrap();
        };
        let differentiate = |gpu: &mut GpuRenderer| {
            let pending = gpu.backward_batch(&resident, count, &views, &everything(), &by_images).unwrap();
            gpu.settle(&pending).unwrap();
        };
        let mut counted = |work: &dyn Fn(&mut GpuRenderer)| {
            // Lists have learnt their lengths.
            work(&mut gpu);
            let before = gpu.counts();
            work(&mut gpu);
            gpu.counts() - before
        };
        [counted(&render), counted(&differentiate)]
    };
    let [four, eight, sixteen] = [4, 8, 16].map(&mut launches);
    for (at, most) in [(0, 20), (1, 24)] {
        assert!(eight[at].dispatches <= four[at].dispatches + most, "{four:?} {eight:?}");
        assert!(sixteen[at].dispatches <= four[at].dispatches + most, "{four:?} {sixteen:?}");
        let are_equal = [four[at], sixteen[at]].iter().all(|counts| (counts.submissions, counts.waits) == (2, 1));
        assert!(are_equal, "one, and one that reads the report: {four:?} {sixteen:?}");
    }
}

/// Some adapters have uniform buffers of 16 KiB, which hold 40 views.
#[test]
fn a_batch_has_as_many_views_as_the_uniform_buffers_of_the_device_hold() {
    let lower = |limits: &mut wgpu::Limits| limits.max_uniform_buffer_binding_size = 16 << 10;
    let (Some(mut gpu), Some((device, queue))) = (gpu(), external_device(lower)) else { return };
    let mut small = GpuRenderer::with_device(device, queue, GpuOptions::default()).unwrap();
    let scenes = scenes(2, 300);
    let views: Vec<View> = views(7, 20, 20).into_iter().cycle().take(42).collect();
    let resident = small.upload(&joined(&scenes)).unwrap();
    let crowd = small.render_batch(&resident, 2, &views, &everything()).unwrap_err();
    let SplatError::Gpu(GpuError::TooLarge { what, needed, limit, .. }) = crowd else { panic!("{crowd}") };
    assert_eq!((what, needed, limit), ("views of a batch", 42, 40));
    let pending = small.render_batch(&resident, 2, &views[..40], &everything()).unwrap();
    let batch = small.read(&pending).unwrap();
    for at in [0, 19, 20, 39] {
        let alone = gpu.render(&scenes[at / 20], &views[at], &everything()).unwrap();
        assert!(batch.rgb[at * 400..(at + 1) * 400] == alone.rgb, "view {at}");
        assert!(alone.counts.drawn > 20, "{:?}", alone.counts);
    }
}

#[test]
fn batches_of_unequal_scenes_and_of_too_many_views_are_rejected() {
    let Some(mut gpu) = gpu() else { return };
    let resident = gpu.upload(&joined(&scenes(2, 100))).unwrap();
    let mut rejection = |scenes, views: &[View]| gpu.render_batch(&resident, scenes, views, &everything()).unwrap_err();
    let fields = [
        (2, views(3, 20, 20)),
        (2, views(1, 20, 20)),
        (3, views(3, 20, 20)),
        (2, [views(3, 20, 20), views(1, 20, 21)].concat()),
        (1, vec![]),
    ];
    let found = fields.map(|(scenes, views)| match rejection(scenes, &views) {
        SplatError::Length { field, .. } => field,
        other => panic!("{other}"),
    });
    let expected = [
        "views, the same number for every scene",
        "views, the same number for every scene",
        "Gaussians, the same number for every scene",
        "views of one size",
        "views",
    ];
    assert_eq!(found, expected);
    let crowd = rejection(2, &views(162, 20, 20));
    assert!(matches!(crowd, SplatError::Gpu(GpuError::TooLarge { what: "views of a batch", .. })), "{crowd}");

    let small = GpuOverrides { binding_limit: 64 << 10, ..GpuOverrides::default() };
    let Some(mut small) = open(overriding(small)) else { return };
    let resident = small.upload(&joined(&scenes(2, 100))).unwrap();
    let wide = small.render_batch(&resident, 2, &views(2, 64, 64), &everything()).unwrap_err();
    assert!(matches!(wide, SplatError::Gpu(GpuError::TooLarge { what: "pixels of a batch", .. })), "{wide}");
    let parts: Vec<GpuPart> = [resident.parts(), resident.parts()].concat();
    let parts = GpuGaussians::from_parts(parts, 1).unwrap();
    let split = small.render_batch(&parts, 2, &views(2, 16, 16), &everything()).unwrap_err();
    assert!(matches!(&split, SplatError::Gpu(GpuError::TooLarge { what, .. }) if what.starts_with("parts")), "{split}");
}
