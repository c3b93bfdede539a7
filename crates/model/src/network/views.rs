use atsplat_camera::{Camera, CameraError, DirectionScale, Ray};
use atsplat_pixels::ImageU8;
use burn::Tensor;
use burn::tensor::{Device, TensorData};
use rayon::prelude::*;

use super::resize::resized;
use crate::config::Grid;
use crate::{ImageSize, ModelError};

const WHAT: &str = "model input";
pub(super) const RGB: usize = 3;

/// The posed context images of one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Views {
    size: ImageSize,
    /// View by view, row by row, red, green, blue in 0…1.
    pub(super) images: Vec<f32>,
    pub(super) cameras: Vec<Camera>,
    /// Features of a frozen backbone for the images.
    features: Option<Vec<f32>>,
}

impl Views {
    /// Images of one size with cameras whose poses are normalised as in training.
    ///
    /// `images` are view by view, row by row, red, green, blue, display-referred in 0…1.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if there is no view or lengths do not agree, [`ModelError::NonFinite`] if a value of an
    /// image is NaN or infinite.
    pub fn new(size: ImageSize, images: Vec<f32>, cameras: Vec<Camera>) -> Result<Self, ModelError> {
        let expected = cameras.len() * size.height * size.width * RGB;
        if cameras.is_empty() || images.len() != expected {
            let expected = format!("{expected} values for {} views of {size}, and at least one view", cameras.len());
            return Err(ModelError::malformed(WHAT, "images", expected, images.len()));
        }
        for (view, image) in images.chunks_exact((size.height * size.width * RGB).max(1)).enumerate() {
            all_finite(image, || format!("image {view}"))?;
        }
        Ok(Self { size, images, cameras, features: None })
    }

    /// Decoded images with their cameras: 8-bit samples are divided by 255.
    ///
    /// # Errors
    /// [`ModelError::SizesDiffer`] for images of different sizes, and those of [`Self::new`].
    pub fn of_images<'a>(
        images: impl IntoIterator<Item = &'a ImageU8>,
        cameras: Vec<Camera>,
    ) -> Result<Self, ModelError> {
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
        let size = size.ok_or_else(|| ModelError::malformed(WHAT, "images", "at least one view", "none"))?;
        Self::new(size, samples, cameras)
    }

    /// The same views with cached `features` of [`Network::frozen_features`](super::Network::frozen_features), view after
    /// view, so that the network skips its frozen backbone.
    #[must_use]
    pub fn with_frozen_features(self, features: Vec<f32>) -> Self {
        Self { features: Some(features), ..self }
    }

    /// Cached features, `[views, patches, channels]`.
    pub(super) fn features(&self, shape: [usize; 3], device: &Device) -> Option<Result<Tensor<3>, ModelError>> {
        let features = self.features.as_ref()?;
        if features.len() != shape.iter().product::<usize>() {
            let expected = format!("{shape:?} numbers");
            return Some(Err(ModelError::malformed(WHAT, "features of the frozen backbone", expected, features.len())));
        }
        Some(Ok(Tensor::from_data(TensorData::new(features.clone(), shape), device)))
    }

    /// Number of views.
    pub const fn len(&self) -> usize {
        self.cameras.len()
    }

    /// Whether there are no views; always false.
    pub const fn is_empty(&self) -> bool {
        self.cameras.is_empty()
    }

    /// Size of every image.
    pub const fn size(&self) -> ImageSize {
        self.size
    }

    /// The same views downscaled by a whole factor.
    pub(super) fn smaller(&self, factor: usize) -> Self {
        if factor == 1 {
            return self.clone();
        }
        let size = ImageSize::new(self.size.height / factor.max(1), self.size.width / factor.max(1));
        Self { features: self.features.clone(), ..self.resized(size) }
    }

    /// The same views at another size.
    pub(super) fn resized(&self, size: ImageSize) -> Self {
        let images = self.each().flat_map(|image| resized(image, self.size, size, RGB)).collect();
        Self { size, images, cameras: self.cameras.clone(), features: None }
    }

    /// Rays through the centres of a grid of equal cells, view by view, row by row.
    pub(super) fn rays(&self, grid: Grid) -> Result<Vec<Ray>, ModelError> {
        let size = camera_size(ImageSize::new(grid.rows, grid.columns))?;
        let rays = self.cameras.iter().enumerate().map(|(view, camera)| {
            camera.pixel_rays(size, DirectionScale::UnitLength).map_err(|error| camera_error(view, &error))
        });
        Ok(rays.collect::<Result<Vec<Vec<Ray>>, ModelError>>()?.concat())
    }

    /// Moment and direction of the ray of every pixel, in the order of the images.
    pub(super) fn plucker_maps(&self) -> Result<Vec<f32>, ModelError> {
        let size = camera_size(self.size)?;
        let map = |(view, camera): (usize, &Camera)| {
            let map = camera.plucker_map(size).map_err(|error| camera_error(view, &error))?;
            all_finite(&map, || format!("rays of camera {view}"))?;
            Ok(map)
        };
        let maps: Result<Vec<Vec<f32>>, ModelError> = self.cameras.par_iter().enumerate().map(map).collect();
        Ok(maps?.concat())
    }

    fn each(&self) -> impl Iterator<Item = &[f32]> {
        self.images.chunks_exact((self.size.height * self.size.width * RGB).max(1))
    }
}

fn all_finite(values: &[f32], location: impl FnOnce() -> String) -> Result<(), ModelError> {
    match values.iter().filter(|value| !value.is_finite()).count() {
        0 => Ok(()),
        count => Err(ModelError::NonFinite { location: location(), count }),
    }
}

fn camera_size(size: ImageSize) -> Result<atsplat_camera::ImageSize, ModelError> {
    match (u32::try_from(size.width), u32::try_from(size.height)) {
        (Ok(width), Ok(height)) => Ok(atsplat_camera::ImageSize { width, height }),
        _ => Err(ModelError::malformed(WHAT, "image size", "at most 4294967295 pixels a side", size)),
    }
}

fn camera_error(view: usize, error: &CameraError) -> ModelError {
    ModelError::malformed(WHAT, format!("camera of view {view}"), "a ray through every pixel", error)
}
