use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use atsplat_camera::Projector;
use atsplat_numeric::{Extremes as _, median};
use atsplat_splat::View;
use glam::DVec3;
use rayon::prelude::*;

use crate::FitError;
use crate::checkpoint::lines_of;

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
    /// As [`Self::lines`].
    lines: Arc<OnceLock<Vec<String>>>,
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

    /// What checkpoints and records hash of each view, made when it is first needed.
    pub(crate) fn lines(&self) -> &[String] {
        if let Some(lines) = self.lines.get() {
            return lines;
        }
        // Not inside the cell: other tasks of the threads that hash the pixels may ask for the lines too.
        let lines = lines_of(self);
        self.lines.get_or_init(|| lines)
    }
}

impl From<Vec<TrainingView>> for TrainingViews {
    fn from(views: Vec<TrainingView>) -> Self {
        Self { views: views.into(), ..Self::default() }
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
const MIN_EXTENT: f64 = 0.5;
/// Most pairs of a Gaussian and a camera of which the median depth is computed exactly: their depths take 256 MiB.
const MAX_PAIRS: usize = 1 << 25;

/// The extent that learning rates and thresholds are multiples of: [`camera_extent`], but at least half the median depth at
/// which cameras see the initial Gaussians. The published radius of the cameras is meant for captures around a scene; where cameras hardly
/// move, a hundredth of it is smaller than a pixel.
pub(crate) fn scene_extent(views: &[TrainingView], means: &[[f32; 3]]) -> Result<f64, FitError> {
    let cameras = views.iter().map(|view| view.view.camera.projector()).collect::<Result<Vec<_>, _>>()?;
    let by_depth = median_depth(&cameras, means, MAX_PAIRS).map_or(0.0, |depth| MIN_EXTENT * depth);
    Ok(camera_extent(views.iter().map(|view| &view.view)).maximum_of(by_depth))
}

/// The median depth at which cameras see means; if there are more than `most` pairs of both, of every second mean, or of every third, and
/// so on. `None` if no mean is seen.
fn median_depth(cameras: &[Projector], means: &[[f32; 3]], most: usize) -> Option<f64> {
    let every = means.len().saturating_mul(cameras.len()).div_ceil(most).max(1);
    let depths: Vec<f64> = means
        .par_iter()
        .step_by(every)
        .flat_map_iter(|mean| {
            let mean = DVec3::from_array(mean.map(f64::from));
            let seen = cameras.iter().filter_map(move |camera| camera.project(mean).ok());
            seen.filter(|seen| seen.depth > 0.0 && seen.is_inside()).map(|seen| seen.depth)
        })
        .collect();
    median(depths)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;
    use glam::DMat3;

    use super::*;

    /// A camera at a place on the optical axis, which all of them share.
    fn camera(z: f64) -> Camera {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(0.0, 0.0, -z)).unwrap();
        Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap())
    }

    /// Depths of 1, 2, 3, 4, 7 and 9 in the first camera, one more in the second; a mean behind both is seen by none.
    #[test]
    fn the_median_depth_is_of_all_means_up_to_a_number_and_then_of_every_second() {
        let cameras = [camera(0.0), camera(-1.0)].map(|camera| camera.projector().unwrap());
        let means = [1.0, 2.0, 3.0, 4.0, 7.0, 9.0, -5.0].map(|z| [0.0, 0.0, z]);
        let found = [14, 13, 7, 4].map(|most| median_depth(&cameras, &means, most).unwrap());
        Tolerance::EXACT.assert(found, [4.0, 3.5, 3.5, 4.5], "of all, of 1, 3 and 7, and of 1 and 7");
        assert_eq!(median_depth(&cameras, &means[6..], 14), None);
    }

    /// Hashing the pixels takes seconds for many photos.
    #[test]
    fn lines_of_views_are_made_once() {
        let size = ImageSize { width: 2, height: 1 };
        let view = View { camera: camera(1.5), size };
        let views = TrainingViews::from(vec![TrainingView { name: String::new(), view, rgb: vec![[0.5; 3]; 2] }]);
        let copy = views.clone().with_other_images(9);
        assert_eq!((views.lines().len(), views.lines()), (1, &lines_of(&views)[..]));
        assert!(std::ptr::eq(views.lines(), copy.lines()));
    }
}
