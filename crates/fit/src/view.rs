use atsplat_numeric::Extremes as _;
use atsplat_splat::View;
use glam::DVec3;

use crate::FitError;

/// A posed picture.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingView {
    /// For messages.
    pub name: String,
    /// Camera and size.
    pub view: View,
    /// Display-referred RGB in [0, 1], row by row.
    pub rgb: Vec<[f32; 3]>,
}

impl TrainingView {
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
