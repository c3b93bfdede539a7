use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_pixels::{ImageU8, encode_jpeg, encode_png};
use atsplat_splat::{Gaussians, RendererConstants};
use glam::{DMat3, DVec3};

use super::Stage;
use super::limit_scene::limit_scene;
use crate::DriftError;

/// Input of the first stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Inputs {
    /// Image files, context views first.
    pub files: Vec<Vec<u8>>,
    /// Their cameras in the network's world frame.
    pub cameras: Vec<Camera>,
    /// How many of them are context.
    pub context: usize,
    /// Synthetic Gaussians that are rendered in addition to the model's, to cover renderer constants that those do not reach.
    pub limit_scene: Gaussians,
}

/// An image and its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The image.
    pub image: ImageU8,
    /// Pose and the image's intrinsics.
    pub camera: Camera,
}

impl View {
    /// Size in pixels.
    pub fn size(&self) -> ImageSize {
        ImageSize { width: self.image.width(), height: self.image.height() }
    }
}

impl Inputs {
    /// Synthetic inputs: two context views, a JPEG and a PNG of 112×96 pixels, and a target between them, of a plane with edges,
    /// fine stripes and smooth colours at distance 7; and Gaussians that are sensitive to every renderer constant.
    ///
    /// # Errors
    /// [`DriftError::Stage`] if images cannot be encoded.
    pub fn pattern(constants: &RendererConstants) -> Result<Self, DriftError> {
        let failed = |error: &dyn std::fmt::Display| Stage::Decode.failed()(error);
        let places = [-1.0, 1.0, 0.25];
        let mut inputs =
            Self { files: Vec::new(), cameras: Vec::new(), context: 2, limit_scene: limit_scene(constants)? };
        for (at, x) in places.into_iter().enumerate() {
            let image = plane_image(x).map_err(|error| failed(&error))?;
            let file = if at == 0 { encode_jpeg(&image, 92) } else { encode_png(&image) };
            inputs.files.push(file.map_err(|error| failed(&error))?);
            let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0));
            let intrinsics = NormalizedIntrinsics::new(FOCAL, FOCAL * f64::from(WIDTH) / f64::from(HEIGHT), 0.5, 0.5);
            inputs.cameras.push(Camera {
                camera_from_world: pose.map_err(|error| failed(&error))?,
                intrinsics: intrinsics.map_err(|error| failed(&error))?,
                distortion: Distortion::None,
            });
        }
        Ok(inputs)
    }
}

const WIDTH: u32 = 112;
const HEIGHT: u32 = 96;
const FOCAL: f64 = 0.9;
const DISTANCE: f64 = 7.0;

/// The plane as seen by a camera at `x`, computed in integers so that it is equal on all machines.
fn plane_image(x: f64) -> Result<ImageU8, atsplat_pixels::PixelError> {
    let shift = x * FOCAL * f64::from(WIDTH) / DISTANCE;
    #[expect(clippy::cast_possible_truncation, reason = "a few dozen pixels")]
    let shift = (shift * 4.0).round() as i64;
    let mut samples = Vec::with_capacity((WIDTH * HEIGHT * 3) as usize);
    for row in 0..i64::from(HEIGHT) {
        for column in 0..i64::from(WIDTH) {
            // Quarters of a pixel on the plane.
            let (u, v) = (4 * column + shift, 4 * row);
            let board = 90 * ((u.div_euclid(64) + v.div_euclid(48)) & 1);
            let stripes = 5 * (u + v).rem_euclid(13);
            let slow = (u * u / 512 + v / 3).rem_euclid(97);
            let noise = ((u.wrapping_mul(2_654_435_761) ^ v.wrapping_mul(40_503)) >> 7) & 31;
            let sample = |value: i64| u8::try_from(value.clamp(0, 255)).unwrap_or(u8::MAX);
            samples.extend([
                sample(40 + board + noise),
                sample(20 + board / 2 + stripes + slow),
                sample(200 - slow - stripes),
            ]);
        }
    }
    ImageU8::new(WIDTH, HEIGHT, samples)
}
