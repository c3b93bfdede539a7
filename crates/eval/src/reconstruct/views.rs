use atsplat_camera::Camera;
use atsplat_files::Malformed;
use atsplat_model::network::Views;
use atsplat_model::{ImageSize, ModelError};
use atsplat_pixels::ImageU8;

/// Context images and cameras as the network's input: 8-bit samples are divided by 255.
///
/// # Errors
/// [`ModelError::Malformed`] without images, [`ModelError::SizesDiffer`] for images of different sizes, and the errors of
/// [`Views::new`].
pub fn network_views<'a>(
    images: impl IntoIterator<Item = &'a ImageU8>,
    cameras: Vec<Camera>,
) -> Result<Views, ModelError> {
    let mut size = None;
    let mut samples = Vec::new();
    for (at, image) in images.into_iter().enumerate() {
        let found = ImageSize::new(image.height() as usize, image.width() as usize);
        let expected = *size.get_or_insert(found);
        if found != expected {
            return Err(ModelError::SizesDiffer { image: at, expected, found });
        }
        samples.extend(image.samples().iter().map(|&sample| f32::from(sample) / 255.0));
    }
    let size =
        size.ok_or_else(|| Malformed::new("the network's input", "views", "at least one context view", "none"))?;
    Views::new(size, samples, cameras)
}
