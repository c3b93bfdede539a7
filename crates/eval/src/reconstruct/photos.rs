use std::sync::Arc;

use atsplat_camera::PrincipalPointRule;
use atsplat_model::ImageSize;
use atsplat_model::network::Views;
use atsplat_pixels::{DecodeLimits, ImageU8};
use atsplat_protocol::trial::{ContextView, Prefetch, TargetImages, Trial, TrialRecipe, Trials};
use atsplat_protocol::{
    EvaluationIndex, Filters, IndexEntry, LensDistortion, MeanCameraScale, NearFar, PoseNormalisation,
};
use atsplat_scene::preprocess::{Preprocessing, RescaleAndCrop};
use atsplat_scene::{OneScene, Scene, Warnings};
use atsplat_splat::Gaussians;
use indexmap::IndexMap;
use rayon::prelude::*;

use super::ReconstructError;

/// iLRM's planes in the normalised world, which the presets infer for ATSplat too.
const NEAR_FAR: NearFar = NearFar { near: 0.01, far: 500.0 };

/// Positions of frames in a scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PhotoSelection {
    /// Photos to reconstruct from, in the order given to the network.
    pub context: Vec<usize>,
    /// Further views, to render and compare.
    pub targets: Vec<usize>,
}

/// The recipe that suits any photos: scaled and cropped to `size` with the principal point corrected for the crop, poses
/// normalised to the mean camera with Long-LRM's scale.
pub fn photo_recipe(size: ImageSize) -> TrialRecipe {
    TrialRecipe {
        preprocessing: Preprocessing {
            principal_point: PrincipalPointRule::Corrected,
            ..Preprocessing::of([RescaleAndCrop::new(side(size.height), side(size.width)).into()])
        },
        lens_distortion: LensDistortion::Used,
        pose_normalisation: PoseNormalisation::mean_camera(MeanCameraScale::LongLrm),
        near_far: NEAR_FAR,
        disparity_planes: None,
        filters: Filters::default(),
        decode_limits: DecodeLimits::default(),
        allow_absent_images: false,
    }
}

#[expect(clippy::expect_used, reason = "no image has a side of 2^32 pixels")]
fn side(pixels: usize) -> u32 {
    u32::try_from(pixels).expect("an image side below 2^32")
}

/// The photos of one scene with preprocessed cameras. Images are decoded on demand.
#[derive(Clone)]
#[expect(missing_debug_implementations, reason = "lazy images have none")]
pub struct Photos {
    trial: Trial,
    ground_truth: TargetImages,
    names: IndexMap<usize, String>,
}

impl Photos {
    /// Prepares the cameras of a scene; no image is decoded.
    ///
    /// # Errors
    /// [`ReconstructError::Skipped`] with the reason if the frames do not make a trial.
    pub fn new(
        scene: Scene,
        PhotoSelection { context, targets }: PhotoSelection,
        recipe: TrialRecipe,
        warnings: &mut Warnings,
    ) -> Result<Self, ReconstructError> {
        let name = |&frame: &usize| Some((frame, scene.frames.get(frame)?.name.clone()));
        let names = context.iter().chain(&targets).filter_map(name).collect();
        let entry = IndexEntry { context, target: targets, overlap: None };
        let index = EvaluationIndex { scenes: IndexMap::from([(scene.key.clone(), vec![entry])]) };
        let source = Arc::new(OneScene::new(scene));
        let mut trials = Trials::new(source, &index, recipe, Prefetch::NONE);
        let trial = trials.next();
        warnings.merge(trials.warnings().clone());
        let trial = trial.ok_or(ReconstructError::NoContext)?;
        let (trial, ground_truth) = trial.map_err(ReconstructError::Skipped)?;
        Ok(Self { trial, ground_truth, names })
    }

    /// Context and target views with normalised cameras.
    pub const fn trial(&self) -> &Trial {
        &self.trial
    }

    /// Ground truth of the targets, which the network must not see.
    pub const fn ground_truth(&self) -> &TargetImages {
        &self.ground_truth
    }

    /// The common size of the context images, in pixels.
    ///
    /// # Errors
    /// [`ReconstructError::NoContext`], [`ReconstructError::Sizes`].
    pub fn size(&self) -> Result<ImageSize, ReconstructError> {
        let sizes = || self.trial.context().iter().map(|view| (view.frame, view.size));
        let (first, expected) = sizes().next().ok_or(ReconstructError::NoContext)?;
        if let Some((frame, found)) = sizes().find(|(_, size)| *size != expected) {
            return Err(ReconstructError::Sizes { expected, first, found, frame });
        }
        Ok(expected.into())
    }

    /// Decodes the context images, and returns them with their cameras as network input.
    ///
    /// # Errors
    /// [`ReconstructError::Protocol`] if an image cannot be read, [`ReconstructError::Model`] for images of several sizes.
    pub fn views(&self) -> Result<Views, ReconstructError> {
        let images: Result<Vec<Arc<ImageU8>>, _> = self.trial.context().par_iter().map(ContextView::image).collect();
        let cameras = self.trial.context().iter().map(|view| view.camera).collect();
        Ok(Views::of_images(images?.iter().map(AsRef::as_ref), cameras)?)
    }

    /// Transforms Gaussians from the network's frame into the axes and unit of length of the scene.
    ///
    /// # Errors
    /// [`ReconstructError::Gaussians`] if the normalisation cannot be inverted.
    pub fn in_scene(&self, gaussians: &Gaussians) -> Result<Gaussians, ReconstructError> {
        Ok(gaussians.transformed(&self.trial.normalisation().new_from_old.inverse())?)
    }

    /// The dataset's name of a selected frame; `None` for other frames.
    pub fn name(&self, frame: usize) -> Option<&str> {
        self.names.get(&frame).map(String::as_str)
    }
}
