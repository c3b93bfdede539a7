use atsplat_camera::Camera;
use atsplat_model::network::Views;
use atsplat_model::{ImageSize, ModelError};
use atsplat_pixels::ImageU8;

/// Context pictures with their cameras, as the network takes them: 8-bit samples become shares of 255.
///
/// # Errors
/// [`ModelError::SizesDiffer`] for pictures of several sizes, and what [`Views::new`] refuses.
pub fn network_views<'a>(
    pictures: impl IntoIterator<Item = &'a ImageU8>,
    cameras: Vec<Camera>,
) -> Result<Views, ModelError> {
    let mut size = None;
    let mut samples = Vec::new();
    for (picture, image) in pictures.into_iter().enumerate() {
        let found = ImageSize::new(image.height() as usize, image.width() as usize);
        let expected = *size.get_or_insert(found);
        if found != expected {
            return Err(ModelError::SizesDiffer { picture, expected, found });
        }
        samples.extend(image.samples().iter().map(|&sample| f32::from(sample) / 255.0));
    }
    Views::new(size.unwrap_or(ImageSize::new(0, 0)), samples, cameras)
}
