//! Whatever stands in a field, pixels and gradients of finite images are finite: what cannot be used is culled and
//! counted, what is extreme but usable survives.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use atsplat_splat::{
    Channels, GaussianParts, Gaussians, Gradients, ImageGradients, RasterMode, RenderOptions, Rendering, View,
    reference,
};
use glam::{DMat3, DVec3};
use proptest::prelude::*;

/// Numbers at which arithmetic changes its rules.
const POISON: [f32; 24] = [
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
    1e6,
    -1e6,
    1e-6,
    1.0,
    -1.0,
    0.01,
    0.009_999_999,
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

fn options(mode: RasterMode) -> RenderOptions {
    let channels = Channels { depth: true, scalar: true, median_depth: true };
    RenderOptions { mode, channels, background: [0.2, 0.3, 0.4], ..RenderOptions::default() }
}

/// Harmless Gaussians in front of the camera, of which any number may be replaced.
fn scene(poisoned: &[(usize, f32)]) -> Gaussians {
    const COUNT: usize = 4;
    let mut numbers: Vec<f32> = (0..COUNT)
        .flat_map(|n| {
            let shift = n as f32 * 0.1;
            let own = [0.1 - shift, shift - 0.2, 2.0 + shift, 1.0, 0.2, -0.3, 0.1, -1.5, -2.0, -1.0, 0.5, 0.7];
            own.into_iter().chain((0..12).map(move |k| 0.2 - 0.05 * k as f32))
        })
        .collect();
    let length = numbers.len();
    for (slot, value) in poisoned {
        numbers[slot % length] = *value;
    }
    let mut parts = GaussianParts { sh_degree: 1, scalars: Some(Vec::new()), ..GaussianParts::default() };
    for own in numbers.as_chunks::<24>().0 {
        parts.means.push([own[0], own[1], own[2]]);
        parts.quaternions.push([own[3], own[4], own[5], own[6]]);
        parts.log_scales.push([own[7], own[8], own[9]]);
        parts.opacity_logits.push(own[10]);
        parts.scalars.iter_mut().for_each(|scalars| scalars.push(own[11]));
        parts.sh.extend_from_slice(own[12..].as_chunks::<3>().0);
    }
    Gaussians::new(parts).unwrap()
}

fn ones<T: Copy>(one: T) -> ImageGradients<T> {
    let pixels = view().pixels();
    ImageGradients {
        rgb: vec![[one; 3]; pixels],
        alpha: Some(vec![one; pixels]),
        depth: Some(vec![one; pixels]),
        scalar: Some(vec![one; pixels]),
    }
}

fn assert_finite<T: Copy + Into<f64>>(rendering: &Rendering<T>, gradients: &Gradients<T>, what: &str) {
    let finite = |values: &mut dyn Iterator<Item = T>, name: &str| {
        for value in values {
            let value: f64 = value.into();
            assert!(value.is_finite(), "{what}: {name}: {value}");
        }
    };
    finite(&mut rendering.rgb.iter().flatten().copied(), "rgb");
    finite(&mut rendering.alpha.iter().copied(), "alpha");
    for (name, image) in
        [("depth", &rendering.depth), ("scalar", &rendering.scalar), ("median", &rendering.median_depth)]
    {
        finite(&mut image.iter().flatten().copied(), name);
    }
    finite(&mut gradients.means.iter().flatten().copied(), "gradient of means");
    finite(&mut gradients.quaternions.iter().flatten().copied(), "gradient of quaternions");
    finite(&mut gradients.log_scales.iter().flatten().copied(), "gradient of scales");
    finite(&mut gradients.opacity_logits.iter().copied(), "gradient of logits");
    finite(&mut gradients.sh.iter().flatten().copied(), "gradient of harmonics");
    finite(&mut gradients.scalars.iter().copied(), "gradient of scalars");
    finite(&mut gradients.means_2d.iter().flatten().copied(), "gradient on the screen");
    finite(&mut gradients.background.iter().copied(), "gradient of background");
    finite(&mut gradients.pose.iter().copied(), "gradient of pose");
}

fn check(poisoned: &[(usize, f32)]) {
    let (gaussians, view) = (scene(poisoned), view());
    for mode in [RasterMode::Classic, RasterMode::Antialiased] {
        let options = options(mode);
        let what = format!("{poisoned:?} {mode:?}");
        let rendering = reference::render(&gaussians, &view, &options).unwrap();
        let gradients = reference::backward(&gaussians, &view, &options, &ones(1.0)).unwrap();
        assert_finite(&rendering, &gradients, &format!("{what} reference"));
        for simd in SimdLevel::available() {
            let mut renderer = CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() });
            let rendering = renderer.render(&gaussians, &view, &options).unwrap();
            let gradients = renderer.backward(&gaussians, &view, &options, &ones(1.0f32)).unwrap();
            assert_finite(&rendering, &gradients, &format!("{what} {simd:?}"));
        }
    }
}

#[test]
fn every_number_in_every_slot() {
    for slot in 0..24 {
        for value in POISON {
            check(&[(slot, value)]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn several_at_once(poisoned in prop::collection::vec((0usize..96, prop::sample::select(&POISON[..])), 1..12)) {
        check(&poisoned);
    }

    #[test]
    fn any_bits(poisoned in prop::collection::vec((0usize..96, any::<u32>().prop_map(f32::from_bits)), 1..12)) {
        check(&poisoned);
    }
}
