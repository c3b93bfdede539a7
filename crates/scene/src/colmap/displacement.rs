use std::collections::HashMap;
use std::path::Path;

use atsplat_numeric::median;
use glam::DVec3;

use super::{model_file, parse_images};
use crate::files::read_file;
use crate::nerfstudio::AppliedTransform;
use crate::{Scene, SceneError};

/// How far a model's cameras are from those of the same images in a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// Images of the model that are frames of the scene.
    pub images: usize,
    /// Median distance between the camera of an image and that of its frame, in diagonals of the box around these frames'
    /// cameras.
    pub distance: f64,
}

/// Compares the cameras of the model in `folder`, moved by what was `applied` to the scene's, with those of frames of the same
/// name. `None` if the model has no images, if fewer than two of them are frames, or if these frames' cameras are all in one place.
///
/// # Errors
/// [`SceneError::Io`] and the errors of [`parse_images`].
pub fn displacement(
    folder: &Path,
    scene: &Scene,
    applied: Option<AppliedTransform>,
) -> Result<Option<Displacement>, SceneError> {
    let (file, encoding) = model_file(folder, "images");
    if !file.is_file() {
        return Ok(None);
    }
    let images = parse_images(&read_file("reading COLMAP images", &file)?, encoding, &file)?;
    let centres: HashMap<&str, DVec3> = scene
        .frames
        .iter()
        .map(|frame| (frame.name.as_str(), frame.camera.camera_from_world.inverse().centre()))
        .collect();
    let pairs: Vec<(DVec3, DVec3)> = images
        .iter()
        .filter_map(|image| {
            let stem = Path::new(&image.name).file_stem()?.to_str()?;
            let centre = image.camera_from_world.inverse().centre();
            Some((applied.map_or(centre, |applied| applied.saved_point(centre)), *centres.get(stem)?))
        })
        .collect();
    let (low, high) = pairs
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (_, centre)| (low.min(*centre), high.max(*centre)));
    let extent = low.distance(high);
    if pairs.len() < 2 || extent <= 0.0 {
        return Ok(None);
    }
    let distance = median(pairs.iter().map(|(image, frame)| image.distance(*frame) / extent));
    Ok(distance.map(|distance| Displacement { images: pairs.len(), distance }))
}
