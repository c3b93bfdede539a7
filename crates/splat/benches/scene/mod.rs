use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::{GaussianParts, Gaussians, View, sh_coefficients};

/// One Gaussian behind each of `count` evenly spread points of the image, 0.6 pixels wide, at smooth depths.
pub(crate) fn scene(count: usize, size: ImageSize, degree: u8) -> (Gaussians, View) {
    let intrinsics = NormalizedIntrinsics::new(0.9, 0.9 * f64::from(size.width) / f64::from(size.height), 0.5, 0.5);
    let camera = Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics.expect("intrinsics"));
    let focal = 0.9 * size.width as f32;
    let mut state = 1u32;
    let mut uniform = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut parts = GaussianParts { sh_degree: degree, ..GaussianParts::default() };
    for _ in 0..count {
        let (u, v) = (uniform() * size.width as f32, uniform() * size.height as f32);
        let depth = 3.0 + (u * 0.02).sin() + (v * 0.03).cos() + 0.1 * uniform();
        let (x, y) = ((u - 0.5 * size.width as f32) / focal, (v - 0.5 * size.height as f32) / focal);
        parts.means.push([x * depth, y * depth, depth]);
        parts.quaternions.push([1.0, uniform(), uniform(), uniform()]);
        parts.log_scales.push([(0.6 * depth / focal).ln(); 3]);
        parts.opacity_logits.push(4.0 * uniform() - 1.0);
        parts.sh.extend((0..sh_coefficients(degree)).map(|_| [uniform() - 0.5, uniform() - 0.5, uniform() - 0.5]));
    }
    (Gaussians::new(parts).expect("Gaussians"), View { camera, size })
}
