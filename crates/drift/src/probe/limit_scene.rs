use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
use atsplat_numeric::SplitMix64;
use atsplat_pixels::ImageU8;
use atsplat_splat::{GaussianParts, Gaussians, RendererConstants};

use super::{Stage, View};
use crate::DriftError;

/// Side of the scene's image in pixels; the focal length equals the side.
const SIDE: u32 = 64;

/// Synthetic Gaussians, some of which are at the limit set by each renderer constant. A network's Gaussians may
/// reach none of them: an untrained one's never reach the largest alpha. Changing any of these constants by a thousandth
/// changes a pixel.
pub(super) fn limit_scene(constants: &RendererConstants) -> Result<Gaussians, DriftError> {
    let mut random = SplitMix64::new(0x7368_6565_7421);
    let mut between = |low: f64, high: f64| low + (high - low) * random.unit();
    let mut scene = LimitScene::default();
    // Faint layers behind each other on the left: transmittance decreases in small steps to the termination threshold.
    for layer in 0..400 {
        let direction = [between(-0.4, -0.1), between(-0.4, 0.4)];
        scene.add(direction, 5.0 + 0.01 * f64::from(layer), 8.0, -2.2);
    }
    // Discs with wide rims, along which alpha crosses the smallest alpha.
    for _ in 0..600 {
        let direction = [between(-0.1, 0.5), between(-0.5, 0.5)];
        scene.add(direction, between(2.0, 4.0), 3.0, between(-3.5, -2.0));
    }
    // Nearly opaque dots in front of everything, at pixel centres, for the largest alpha.
    for dot in 0..12 {
        let centre = |pixel: i32| (f64::from(pixel) + 0.5) / f64::from(SIDE) - 0.5;
        scene.add([centre(36 + 4 * (dot % 6)), centre(10 + 6 * (dot / 6))], 1.5, 1.5, 12.0);
    }
    // Centres outside the border and the margin, whose tails reach the image.
    for _ in 0..20 {
        scene.add([between(0.68, 0.75), between(-0.4, 0.4)], 3.0, 9.0, -2.0);
    }
    // Both sides of the near and far planes.
    for plane in [constants.near, constants.far] {
        for (depth, at) in [0.9995, 1.0005].into_iter().zip(0u8..) {
            if plane > 0.0 && plane.is_finite() {
                scene.add([0.47, 0.1 + 0.2 * f64::from(at)], plane * depth, 2.0, -1.0);
            }
        }
    }
    let failed = |error| Stage::Renderer.failed()(&error);
    Gaussians::new(scene.0).map_err(failed)
}

/// The view of [`limit_scene`].
pub(super) fn limit_view() -> Result<View, DriftError> {
    let image = ImageU8::new(SIDE, SIDE, vec![0; (SIDE * SIDE * 3) as usize]);
    let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5);
    Ok(View {
        image: image.map_err(|error| Stage::Renderer.failed()(&error))?,
        camera: Camera::pinhole(
            CameraFromWorld::IDENTITY,
            intrinsics.map_err(|error| Stage::Renderer.failed()(&error))?,
        ),
    })
}

#[derive(Default)]
struct LimitScene(GaussianParts);

impl LimitScene {
    /// Adds an isotropic Gaussian at a direction `(x/z, y/z)` and a depth, with a standard deviation in pixels.
    #[expect(clippy::cast_possible_truncation, reason = "renderers take f32")]
    fn add(&mut self, [x, y]: [f64; 2], depth: f64, pixels: f64, opacity_logit: f64) {
        let count = self.0.means.len();
        let scale = (pixels / f64::from(SIDE) * depth).ln() as f32;
        self.0.means.push([x * depth, y * depth, depth].map(|value| value as f32));
        self.0.quaternions.push([1.0, 0.0, 0.0, 0.0]);
        self.0.log_scales.push([scale; 3]);
        self.0.opacity_logits.push(opacity_logit as f32);
        self.0.sh.push([0, 1, 2].map(|channel| 0.5 + ((count * 7 + channel * 3) % 11) as f32 / 11.0));
    }
}
