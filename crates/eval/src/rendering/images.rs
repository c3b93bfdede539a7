//! Renderings as image files.

use atsplat_pixels::exr::{self, COMPOSITED, Channel, Channels, Values};
use atsplat_pixels::{Image, PixelError};
use atsplat_splat::Rendering;

/// Colour composited over the background, as display-referred RGB.
///
/// # Errors
/// [`PixelError`] for an empty rendering.
pub fn rendered_image(rendering: &Rendering<f32>) -> Result<Image, PixelError> {
    Image::new(rendering.size.width, rendering.size.height, rendering.rgb.as_flattened().to_vec())
}

/// An EXR of colour, alpha and every other rendered plane, as f32, each with its kind of values.
///
/// # Errors
/// [`PixelError`] if the file cannot be encoded.
pub fn rendered_exr(rendering: &Rendering<f32>) -> Result<Vec<u8>, PixelError> {
    let plane = |name: &str, values: Values, samples: Vec<f32>| Channel { name: name.to_owned(), values, samples };
    let colour = |name, channel: usize| {
        let samples = rendering.rgb.iter().filter_map(|rgb| rgb.get(channel).copied()).collect();
        plane(name, Values::DisplayReferred, samples)
    };
    let named = |name: &str| Values::Named(name.to_owned());
    let mut planes = vec![colour("R", 0), colour("G", 1), colour("B", 2)];
    planes.push(plane("A", named(COMPOSITED), rendering.alpha.clone()));
    if let Some(depth) = &rendering.depth {
        planes.push(plane("Z", Values::Depth, expected_depth(depth, &rendering.alpha)));
    }
    if let Some(depth) = &rendering.median_depth {
        planes.push(plane("median-depth", Values::Depth, depth.clone()));
    }
    if let Some(scalar) = &rendering.scalar {
        planes.push(plane("scalar", named("the Gaussians' scalar, composited over 0"), scalar.clone()));
    }
    exr::write(&Channels::new(rendering.size.width, rendering.size.height, planes)?)
}

/// The expected depth of each pixel; 0 if it is empty.
fn expected_depth(composited: &[f32], alpha: &[f32]) -> Vec<f32> {
    let mean = |(depth, alpha): (&f32, &f32)| if *alpha > 0.0 { depth / alpha } else { 0.0 };
    composited.iter().zip(alpha).map(mean).collect()
}

/// `000029.png`: the number of the camera, as pixelSplat names its renderings.
pub fn frame_file_name(number: usize, extension: &str) -> String {
    format!("{number:06}.{extension}")
}

/// Whether [`frame_file_name`] can produce this name.
pub fn is_frame_file_name(name: &str) -> bool {
    match name.split_once('.') {
        Some((number, "png" | "exr")) => number.len() >= 6 && number.bytes().all(|byte| byte.is_ascii_digit()),
        _ => false,
    }
}
