//! A scene for the tests of the CPU and the GPU renderer.

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::{Channels, GaussianParts, Gaussians, ImageGradients, RenderOptions, View, sh_coefficients};
use glam::{DMat3, DVec3};

/// Gaussians in front of the camera, from needles and discs to blobs, some outside the view.
pub(crate) fn cloud(count: usize, degree: u8, seed: u32) -> Gaussians {
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut parts = GaussianParts { sh_degree: degree, scalars: Some(Vec::new()), ..GaussianParts::default() };
    for _ in 0..count {
        let mut spread = |width: f32| width * (2.0 * uniform() - 1.0);
        parts.means.push([spread(2.5), spread(2.0), 4.0 + spread(3.5)]);
        parts.quaternions.push([spread(1.0), spread(1.0), spread(1.0), spread(1.0)]);
        parts.log_scales.push([-3.0 + spread(2.0), -3.0 + spread(2.0), -3.5 + spread(2.0)]);
        parts.opacity_logits.push(spread(5.0));
        parts.scalars.iter_mut().for_each(|scalars| scalars.push(spread(1.0)));
        for _ in 0..sh_coefficients(degree) {
            parts.sh.push([spread(0.8), spread(0.8), spread(0.8)]);
        }
    }
    Gaussians::new(parts).unwrap()
}

/// A view of the scene, off its axis and with an off-centre principal point.
pub(crate) fn view(width: u32, height: u32) -> View {
    let rotation = DMat3::from_rotation_y(0.2) * DMat3::from_rotation_x(0.1);
    let pose = CameraFromWorld::new(rotation, DVec3::new(0.3, -0.1, 0.4)).unwrap();
    let intrinsics = NormalizedIntrinsics::new(0.8, 0.8 * f64::from(width) / f64::from(height), 0.48, 0.53).unwrap();
    View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width, height } }
}

/// Every channel, over a background.
pub(crate) fn everything() -> RenderOptions {
    RenderOptions {
        background: [0.1, 0.6, 0.3],
        channels: Channels { depth: true, scalar: true, median_depth: true },
        ..RenderOptions::default()
    }
}

/// Image gradients that vary from pixel to pixel.
pub(crate) fn image_gradients(view: &View) -> ImageGradients<f64> {
    let wave = |phase: f64| (0..view.pixels()).map(move |n| (n as f64 * 0.37 + phase).sin()).collect::<Vec<_>>();
    ImageGradients {
        rgb: wave(0.0).into_iter().zip(wave(1.0)).zip(wave(2.0)).map(|((r, g), b)| [r, g, b]).collect(),
        alpha: Some(wave(3.0)),
        depth: Some(wave(4.0)),
        scalar: Some(wave(5.0)),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "sines")]
pub(crate) fn narrow(images: &ImageGradients<f64>) -> ImageGradients<f32> {
    images.map(|value| value as f32)
}
