use std::ops::Deref;
use std::sync::Arc;

use atsplat_numeric::{Extremes as _, median};
use atsplat_splat::View;
use glam::DVec3;
use rayon::prelude::*;

use crate::FitError;

/// A posed image.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingView {
    /// For messages.
    pub name: String,
    /// Camera and size.
    pub view: View,
    /// Display-referred RGB in [0, 1], row by row.
    pub rgb: Vec<[f32; 3]>,
}

/// The images that an optimisation trains on. Clones share them, so that they are in memory once.
#[derive(Clone, Debug, Default)]
pub struct TrainingViews {
    views: Arc<[TrainingView]>,
    /// Bytes of other images.
    others: u64,
}

impl TrainingViews {
    /// The same views, while this many bytes of other images are in memory too, such as those of held-out views:
    /// [`crate::FitConfig::memory_limit`] covers all of them together.
    #[must_use]
    pub fn with_other_images(self, others: u64) -> Self {
        Self { others, ..self }
    }

    /// Bytes of the other images.
    pub(crate) const fn others(&self) -> u64 {
        self.others
    }

    /// Bytes of all images.
    pub(crate) fn image_bytes(&self) -> u64 {
        self.iter().map(TrainingView::bytes).fold(self.others, u64::saturating_add)
    }
}

impl From<Vec<TrainingView>> for TrainingViews {
    fn from(views: Vec<TrainingView>) -> Self {
        Self { views: views.into(), others: 0 }
    }
}

impl Deref for TrainingViews {
    type Target = [TrainingView];

    fn deref(&self) -> &[TrainingView] {
        &self.views
    }
}

impl TrainingView {
    /// Bytes of the image.
    pub fn bytes(&self) -> u64 {
        (self.view.pixels() as u64).saturating_mul(size_of::<[f32; 3]>() as u64)
    }

    /// # Errors
    /// [`FitError::View`] for another number of pixels than the view's, or values that are not finite.
    pub(crate) fn check(&self) -> Result<(), FitError> {
        let wrong = |expected: String, found: String| Err(FitError::View { name: self.name.clone(), expected, found });
        if self.rgb.len() != self.view.pixels() {
            return wrong(format!("{} pixels", self.view.pixels()), self.rgb.len().to_string());
        }
        match self.rgb.as_flattened().iter().find(|value| !value.is_finite()) {
            Some(found) => wrong("finite colours".to_owned(), found.to_string()),
            None => Ok(()),
        }
    }
}

/// Radius of the scene by its cameras: 1.1 times the largest distance of a camera from their mean
/// (graphdeco-inria/gaussian-splatting `scene/dataset_readers.py`). Zero for cameras in one place.
pub fn camera_extent<'a>(views: impl IntoIterator<Item = &'a View>) -> f64 {
    let centres: Vec<DVec3> = views.into_iter().map(|view| view.camera.camera_from_world.inverse().centre()).collect();
    let mean = centres.iter().sum::<DVec3>() / centres.len().max(1) as f64;
    1.1 * centres.iter().fold(0.0, |most, centre| most.maximum_of(centre.distance(mean)))
}

/// Least extent in units of the median depth of the initial Gaussians.
const LEAST_EXTENT: f64 = 0.5;

/// The extent that learning rates and thresholds are multiples of: [`camera_extent`], but at least half the median depth at
/// which cameras see the initial Gaussians. The published radius of the cameras is meant for captures around a scene; where cameras hardly
/// move, a hundredth of it is smaller than a pixel.
pub(crate) fn scene_extent(views: &[TrainingView], means: &[[f32; 3]]) -> Result<f64, FitError> {
    let cameras = views.iter().map(|view| view.view.camera.projector()).collect::<Result<Vec<_>, _>>()?;
    let depths: Vec<f64> = means
        .par_iter()
        .flat_map_iter(|mean| {
            let mean = DVec3::from_array(mean.map(f64::from));
            let seen = cameras.iter().filter_map(move |camera| camera.project(mean).ok());
            seen.filter(|seen| seen.depth > 0.0 && seen.is_inside()).map(|seen| seen.depth)
        })
        .collect();
    let by_depth = median(depths).map_or(0.0, |depth| LEAST_EXTENT * depth);
    Ok(camera_extent(views.iter().map(|view| &view.view)).maximum_of(by_depth))
}
