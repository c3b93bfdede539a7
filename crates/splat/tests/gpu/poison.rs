//! Whatever stands in a field, pixels and gradients of finite images are finite.

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::gpu::GpuRenderer;
use atsplat_splat::{GaussianParts, Gaussians, ImageGradients, RasterMode, RenderOptions, Renderer, View};
use glam::{DMat3, DVec3};
use proptest::prelude::*;

use crate::scenes::{everything, gpu};

const POISON: [f32; 26] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    0.0,
    -0.0,
    1e-45,
    -1e-45,
    f32::MIN_POSITIVE,
    f32::MAX,
    f32::MIN,
    1e38,
    1e20,
    -1e20,
    1e12,
    1e6,
    -1e6,
    1e-6,
    1.0,
    -1.0,
    0.01,
    0.009_999_999,
    43.4,
    88.7,
    -88.7,
    -103.9,
    20.0,
];

fn view() -> View {
    let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).unwrap();
    let intrinsics = NormalizedIntrinsics::new(0.9, 1.2, 0.5, 0.5).unwrap();
    View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width: 20, height: 15 } }
}

/// Harmless Gaussians in front of the camera, of which any number may be replaced.
fn scene(poisoned: &[(usize, f32)]) -> Gaussians {
    const COUNT: usize = 4;
    let mut numbers: Vec<f32> = (0..COUNT)
        .flat_map(|n| {
            let shift = n as f32 * 0.1;
            let own = [0.1 - shift, shift - 0.2, 2.0 + shift, 1.0, 0.2, -0.3, 0.1, -1.5, -2.0, -1.0, 0.5, 0.7, 0.02];
            own.into_iter().chain((0..12).map(move |k| 0.2 - 0.05 * k as f32))
        })
        .collect();
    let length = numbers.len();
    for (slot, value) in poisoned {
        numbers[slot % length] = *value;
    }
    let mut parts = GaussianParts {
        sh_degree: 1,
        scalars: Some(Vec::new()),
        filter_3d: Some(Vec::new()),
        ..GaussianParts::default()
    };
    for own in numbers.as_chunks::<25>().0 {
        parts.means.push([own[0], own[1], own[2]]);
        parts.quaternions.push([own[3], own[4], own[5], own[6]]);
        parts.log_scales.push([own[7], own[8], own[9]]);
        parts.opacity_logits.push(own[10]);
        parts.scalars.iter_mut().for_each(|scalars| scalars.push(own[11]));
        parts.filter_3d.iter_mut().for_each(|filters| filters.push(own[12]));
        parts.sh.extend_from_slice(own[13..].as_chunks::<3>().0);
    }
    Gaussians::new(parts).unwrap()
}

fn check(gpu: &mut GpuRenderer, poisoned: &[(usize, f32)], mode: RasterMode) {
    let (gaussians, view) = (scene(poisoned), view());
    let options = RenderOptions { mode, ..everything() };
    let ones = vec![1.0; view.pixels()];
    let images = ImageGradients {
        rgb: vec![[1.0; 3]; view.pixels()],
        alpha: Some(ones.clone()),
        depth: Some(ones.clone()),
        scalar: Some(ones),
    };
    let rendering = gpu.render(&gaussians, &view, &options).unwrap();
    let found: u64 = {
        let census = rendering.census;
        census.drawn + census.invalid + census.outside_depth + census.faint + census.outside_picture
    };
    assert_eq!(found, gaussians.len() as u64, "{poisoned:?}");
    let images_of = [&Some(rendering.alpha), &rendering.depth, &rendering.scalar, &rendering.median_depth];
    let pixels = rendering.rgb.iter().flatten().chain(images_of.into_iter().flatten().flatten());
    assert!(pixels.into_iter().all(|value| value.is_finite()), "{poisoned:?} {mode:?}");
    let g = gpu.backward(&gaussians, &view, &options, &images).unwrap();
    let fields: [(&str, &[f32]); 10] = [
        ("means", g.means.as_flattened()),
        ("quaternions", g.quaternions.as_flattened()),
        ("scales", g.log_scales.as_flattened()),
        ("logits", &g.opacity_logits),
        ("harmonics", g.sh.as_flattened()),
        ("scalars", &g.scalars),
        ("centres", g.means_2d.as_flattened()),
        ("conics", g.conics.as_flattened()),
        ("background", &g.background),
        ("pose", &g.pose),
    ];
    for (name, values) in fields {
        assert!(values.iter().all(|value| value.is_finite()), "{poisoned:?} {mode:?}: {name} {values:?}");
    }
}

#[test]
fn every_number_in_every_slot() {
    let Some(mut gpu) = gpu() else { return };
    for slot in 0..25 {
        for (n, value) in POISON.into_iter().enumerate() {
            let mode = if (slot + n) % 2 == 0 { RasterMode::Classic } else { RasterMode::Antialiased };
            check(&mut gpu, &[(slot, value)], mode);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn several_at_once(
        poisoned in prop::collection::vec((0usize..100, prop::sample::select(&POISON[..])), 1..12),
        antialiased in any::<bool>(),
    ) {
        let Some(mut gpu) = gpu() else { return Ok(()) };
        check(&mut gpu, &poisoned, if antialiased { RasterMode::Antialiased } else { RasterMode::Classic });
    }

    #[test]
    fn any_bits(poisoned in prop::collection::vec((0usize..100, any::<u32>().prop_map(f32::from_bits)), 1..12)) {
        let Some(mut gpu) = gpu() else { return Ok(()) };
        check(&mut gpu, &poisoned, RasterMode::Classic);
    }
}
