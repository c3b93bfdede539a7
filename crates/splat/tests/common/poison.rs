//! Values that break arithmetic, and a scene in which any value may be replaced by them.

use std::fmt::Debug;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::{GaussianParts, Gaussians, Gradients, ImageGradients, Rendering, View};

/// Special and extreme values.
pub(crate) const POISON: [f32; 26] = [
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

/// Values per Gaussian.
pub(crate) const SLOTS: usize = 25;
/// Values in the scene.
pub(crate) const NUMBERS: usize = COUNT * SLOTS;
const COUNT: usize = 4;

pub(crate) fn view() -> View {
    let intrinsics = NormalizedIntrinsics::new(0.9, 1.2, 0.5, 0.5).unwrap();
    View { camera: Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics), size: ImageSize { width: 20, height: 15 } }
}

/// Ordinary Gaussians in front of the camera, with some values replaced.
pub(crate) fn scene(poisoned: &[(usize, f32)]) -> Gaussians {
    let mut numbers: Vec<f32> = (0..COUNT)
        .flat_map(|n| {
            let shift = n as f32 * 0.1;
            let values = [0.1 - shift, shift - 0.2, 2.0 + shift, 1.0, 0.2, -0.3, 0.1, -1.5, -2.0, -1.0, 0.5, 0.7, 0.02];
            values.into_iter().chain((0..12).map(move |k| 0.2 - 0.05 * k as f32))
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
    for values in numbers.as_chunks::<SLOTS>().0 {
        parts.means.push([values[0], values[1], values[2]]);
        parts.quaternions.push([values[3], values[4], values[5], values[6]]);
        parts.log_scales.push([values[7], values[8], values[9]]);
        parts.opacity_logits.push(values[10]);
        parts.scalars.iter_mut().for_each(|scalars| scalars.push(values[11]));
        parts.filter_3d.iter_mut().for_each(|filters| filters.push(values[12]));
        parts.sh.extend_from_slice(values[13..].as_chunks::<3>().0);
    }
    Gaussians::new(parts).unwrap()
}

/// Image gradients of one everywhere.
pub(crate) fn ones<T: Copy>(one: T) -> ImageGradients<T> {
    let pixels = view().pixels();
    ImageGradients {
        rgb: vec![[one; 3]; pixels],
        alpha: Some(vec![one; pixels]),
        depth: Some(vec![one; pixels]),
        scalar: Some(vec![one; pixels]),
    }
}

pub(crate) fn assert_finite<T>(rendering: &Rendering<T>, gradients: &Gradients<T>, what: &str)
where
    T: Copy + Into<f64> + Debug,
{
    assert_eq!(rendering.non_finite(), 0, "{what}");
    assert_eq!(gradients.non_finite(), 0, "{what}: {gradients:?}");
}
