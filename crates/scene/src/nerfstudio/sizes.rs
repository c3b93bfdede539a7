use atsplat_camera::ImageSize;

use super::lens::LensFields;
use super::{FoundImage, Transforms};
use crate::scene::{in_frame, size_of_file};
use crate::{FrameImage, SceneError};

/// Whether lenses are complete only with the size of an image.
pub(super) fn needs_image_sizes(transforms: &Transforms) -> bool {
    transforms.frames.iter().any(|frame| frame.lens.or(transforms.lens).states_no_size())
}

/// Each frame's lens, completed by the global one and, if the file states no size, by that of the image in the listed folder.
///
/// All images are assumed to have the size of the first: others may be scaled copies. Only a frame that states lengths in
/// pixels of its own has those of its own image, if that can be read.
pub(super) fn lenses(key: &str, transforms: &Transforms, images: &[FoundImage]) -> Result<Vec<LensFields>, SceneError> {
    let first = if needs_image_sizes(transforms) { size_of_first(images, key)? } else { None };
    let frames = transforms.frames.iter().zip(images).enumerate();
    let lenses = frames.map(|(at, (frame, image))| {
        let stated = frame.lens.or(transforms.lens);
        if !stated.states_no_size() {
            return stated;
        }
        // An image that cannot be read is reported where it is decoded.
        let own = if frame.lens.states_pixels() { size_as_listed(image, key, at).and_then(Result::ok) } else { None };
        frame.lens.of_image(own.or(first)).or(transforms.lens.of_image(first))
    });
    Ok(lenses.collect())
}

/// Size of the first image found where the file lists it.
fn size_of_first(images: &[FoundImage], key: &str) -> Result<Option<ImageSize>, SceneError> {
    images.iter().enumerate().find_map(|(at, image)| size_as_listed(image, key, at)).transpose()
}

/// Size of the image of the frame at `position`; `None` if it is not where the file lists it.
fn size_as_listed(found: &FoundImage, key: &str, position: usize) -> Option<Result<ImageSize, SceneError>> {
    match &found.image {
        FrameImage::File(path) if found.as_listed => Some(size_of_file(path, in_frame(key, position, &found.image))),
        _ => None,
    }
}
