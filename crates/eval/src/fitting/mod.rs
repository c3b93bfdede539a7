//! Photos and trials as input of per-scene optimisation.

mod cameras;
mod start;

use atsplat_camera::{Camera, ImageSize, PrincipalPointRule};
use atsplat_fit::TrainingView;
use atsplat_model::ModelConfig;
use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::trial::{ContextView, TrialRecipe};
use atsplat_protocol::{PoseNormalisation, ProtocolError};
use atsplat_scene::preprocess::{Preprocessing, RescaleAndCrop};
use atsplat_splat::View;

pub use cameras::FittedCameras;
pub use start::{PointsOf, Start, StartError, StartGaussians};

use crate::reconstruct::{Photos, photo_recipe};

/// A posed image as a training view; the image has the size of the view.
pub fn training_view(name: String, camera: Camera, size: ImageSize, image: &ImageU8) -> TrainingView {
    let rgb = Image::from_u8(image).samples().as_chunks::<3>().0.to_vec();
    TrainingView { name, view: View { camera, size }, rgb }
}

/// The recipe of photos to optimise for: scaled and cropped to `size`, by default in their given size, with the scene's
/// poses. If a network reconstructs them first, they are prepared as for its reconstructions, by default at its
/// resolution, and poses are normalised: lengths and cameras are then those of the trial's new world.
pub fn fit_recipe(size: Option<ImageSize>, network: Option<&ModelConfig>) -> TrialRecipe {
    if let Some(config) = network {
        return photo_recipe(size.map_or(config.resolution, Into::into));
    }
    let steps = size.map(|size| RescaleAndCrop::new(size.height, size.width).into());
    TrialRecipe {
        preprocessing: Preprocessing { principal_point: PrincipalPointRule::Corrected, ..Preprocessing::of(steps) },
        pose_normalisation: PoseNormalisation::None,
        ..photo_recipe(atsplat_model::ImageSize::new(1, 1))
    }
}

impl Photos {
    /// The context views with their images, to optimise for.
    ///
    /// # Errors
    /// [`ProtocolError`] for an image that cannot be read.
    pub fn training_views(&self) -> Result<Vec<TrainingView>, ProtocolError> {
        let view = |view: &ContextView| Ok(self.named(view.frame, view.camera, view.size, view.image()?.as_ref()));
        self.trial().context().iter().map(view).collect()
    }

    /// The targets with their images, to compare renders with.
    ///
    /// # Errors
    /// [`ProtocolError`] for an image that cannot be read.
    #[expect(clippy::expect_used, reason = "each target has an image")]
    pub fn held_out_views(&self) -> Result<Vec<TrainingView>, ProtocolError> {
        let image = |at| self.ground_truth().get(at).expect("an image for each target");
        let targets = self.trial().targets().iter().enumerate();
        targets.map(|(at, view)| Ok(self.named(view.frame, view.camera, view.size, image(at)?.as_ref()))).collect()
    }

    fn named(&self, frame: usize, camera: Camera, size: ImageSize, image: &ImageU8) -> TrainingView {
        let name = self.name(frame).map_or_else(|| format!("frame {frame}"), str::to_owned);
        training_view(name, camera, size, image)
    }
}

/// The size that all views have; `None` for several sizes, and without views.
pub fn common_size(views: &[TrainingView]) -> Option<ImageSize> {
    let first = views.first()?.view.size;
    views.iter().all(|view| view.view.size == first).then_some(first)
}
