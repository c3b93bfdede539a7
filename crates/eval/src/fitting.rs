//! Photos and trials as input of per-scene optimisation.

use atsplat_camera::{Camera, ImageSize};
use atsplat_fit::TrainingView;
use atsplat_pixels::{Image, ImageU8};
use atsplat_splat::View;

/// A posed picture as a training view; the picture has the size of the view.
pub fn training_view(name: String, camera: Camera, size: ImageSize, picture: &ImageU8) -> TrainingView {
    let rgb = Image::from_u8(picture).samples().as_chunks::<3>().0.to_vec();
    TrainingView { name, view: View { camera, size }, rgb }
}
