use std::path::{Path, PathBuf};

use atsplat_camera::ImageSize;
use rayon::prelude::*;

use super::Transforms;
use super::lens::LensFields;
use super::transforms::FORMAT;
use crate::image_finder::FoundImage;
use crate::scene::{in_frame, size_of_file};
use crate::{FrameImage, SceneError};

/// Whether lenses are complete only with the size of an image.
pub(super) fn needs_image_sizes(transforms: &Transforms) -> bool {
    transforms.frames.iter().any(|frame| frame.lens.or(transforms.lens).states_no_size())
}

/// The images whose size [`lenses`] reads, if it has to: the first that is where the file lists it, and those of all frames with
/// lengths in pixels.
pub(super) fn images_for_sizes(transforms: &Transforms, images: &[FoundImage]) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for (frame, image) in transforms.frames.iter().zip(images) {
        let stated = frame.lens.or(transforms.lens);
        let is_needed = files.is_empty() || (stated.states_no_size() && stated.states_pixels());
        files.extend(image.image.file().filter(|_| image.as_listed && is_needed).map(Path::to_owned));
    }
    files
}

/// Each frame's lens, completed by the global one and, if the file states no size, by that of the image in the listed folder.
///
/// A frame that states lengths in pixels itself gets the size of its image, if that can be read. All others get the size of the
/// first image; if lengths are in pixels, an image of another size is an error.
pub(super) fn lenses(
    key: &str,
    transforms: &Transforms,
    images: &[FoundImage],
    file: &Path,
) -> Result<Vec<LensFields>, SceneError> {
    let first = if needs_image_sizes(transforms) { size_of_first(images, key)? } else { None };
    if let Some((first, size)) = first {
        require_one_size(key, transforms, images, first, size, file)?;
    }
    let first = first.map(|(_, size)| size);
    let frames = transforms.frames.iter().zip(images).enumerate();
    let lenses = frames.map(|(at, (frame, image))| {
        let stated = frame.lens.or(transforms.lens);
        if !stated.states_no_size() {
            return stated;
        }
        // An image that cannot be read is reported where it is decoded.
        let of_frame =
            if frame.lens.states_pixels() { size_as_listed(image, key, at).and_then(Result::ok) } else { None };
        frame.lens.of_image(of_frame.or(first)).or(transforms.lens.of_image(first))
    });
    Ok(lenses.collect())
}

/// Position and size of the first image found where the file lists it.
fn size_of_first(images: &[FoundImage], key: &str) -> Result<Option<(usize, ImageSize)>, SceneError> {
    let mut sizes = images.iter().enumerate().filter_map(|(at, image)| Some((at, size_as_listed(image, key, at)?)));
    sizes.next().map(|(at, size)| Ok((at, size?))).transpose()
}

/// An error if frames share lengths in pixels, but their images differ in size: nothing says which image the lengths are for.
///
/// Headers of all these images are read; one that cannot be read is reported where it is decoded.
fn require_one_size(
    key: &str,
    transforms: &Transforms,
    images: &[FoundImage],
    first: usize,
    size: ImageSize,
    file: &Path,
) -> Result<(), SceneError> {
    let shares_pixels = |at: usize| {
        transforms.frames.get(at).is_some_and(|frame| {
            let stated = frame.lens.or(transforms.lens);
            stated.states_no_size() && stated.states_pixels() && !frame.lens.states_pixels()
        })
    };
    let other = images.par_iter().enumerate().filter(|(at, _)| shares_pixels(*at)).find_map_first(|(at, image)| {
        let found = size_as_listed(image, key, at)?.ok()?;
        (found != size).then(|| format!("{found} in frame {at} ({})", image.image.place()))
    });
    let Some(other) = other else { return Ok(()) };
    let place = images.get(first).map(|image| image.image.place()).unwrap_or_default();
    let expected = "the size that lengths in pixels are stated for, because images have several sizes";
    let found = format!("neither, and images of {size} in frame {first} ({place}) and {other}");
    Err(SceneError::malformed(FORMAT, file, "w, h", expected, found))
}

/// Size of the image of the frame at `position`; `None` if it is not where the file lists it.
fn size_as_listed(found: &FoundImage, key: &str, position: usize) -> Option<Result<ImageSize, SceneError>> {
    match &found.image {
        FrameImage::File(path) if found.as_listed => Some(size_of_file(path, in_frame(key, position, &found.image))),
        _ => None,
    }
}
