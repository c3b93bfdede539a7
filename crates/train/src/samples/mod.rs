//! Training samples. A sample is a function of the seed, its number and the step alone, so that a resumed run and any number
//! of threads see the same samples.

mod data_warnings;
mod dataset;
mod digest;
mod distances;
mod exclude;
mod flip;
mod mixture;
mod replaced;
mod rooms;
mod unstable_poses;
mod views;

use atsplat_camera::{Camera, Fallback, PoseNormalisation, WorldFromCamera, normalise};
use atsplat_files::Sha256Digest;
use atsplat_model::ImageSize;
use atsplat_model::network::Views;
use atsplat_numeric::SplitMix64;
use atsplat_scene::Warnings;

pub use data_warnings::DataWarnings;
pub use dataset::{DatasetConfig, DatasetSource};
pub(crate) use digest::digest_of_all;
pub use distances::PatchDistances;
pub use exclude::ExcludedScenes;
pub use flip::mirrored;
pub use mixture::Mixture;
pub(crate) use mixture::description_of;
pub use replaced::{ReplacedCount, ReplacedDraws};
pub use rooms::{RoomsConfig, RoomsSource};
pub use unstable_poses::UnstablePoses;
pub use views::ViewChoice;

use crate::TrainError;
use crate::error::Purpose;
use crate::losses::Stack;
use crate::skipped_step::{FailureReason, SampleFailure};

/// Context views and target views with their images, in the network's frame.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Scene and frames, for messages.
    pub name: String,
    /// Input of the network.
    pub context: PosedImages,
    /// Ground truth of the renders.
    pub targets: PosedImages,
    /// Exact distances behind the context's patches, if the source knows them and the loss needs them.
    pub distances: Option<PatchDistances>,
}

/// Images of one size with their cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedImages {
    /// Size of every image.
    pub size: ImageSize,
    /// View by view, row by row, red, green, blue in 0…1.
    pub images: Vec<f32>,
    /// One camera per image.
    pub cameras: Vec<Camera>,
}

/// The identity of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleId {
    /// Seed of the run.
    pub seed: u64,
    /// Counts samples from 0.
    pub number: u64,
    /// The training step, for curricula.
    pub step: u64,
}

/// An endless sequence of samples.
pub trait Source: Send + Sync + std::fmt::Debug {
    /// Description, for provenance.
    fn name(&self) -> String;

    /// The sample with this identity: always the same.
    ///
    /// # Errors
    /// [`TrainError::NoSample`] if many draws in a row give none; errors of reading and rendering.
    fn sample(&self, id: SampleId) -> Result<Sample, TrainError>;

    /// Which of several sources a sample is of, counted from 0 in the order of the configuration.
    fn source_of(&self, _id: SampleId) -> usize {
        0
    }

    /// What was wrong with the data so far without stopping, each scene counted once, by the data: sources of the same data are counted
    /// together.
    fn data_warnings(&self) -> DataWarnings {
        DataWarnings::default()
    }

    /// All of [`Self::data_warnings`].
    fn warnings(&self) -> Warnings {
        self.data_warnings().total()
    }

    /// Draws so far that gave no sample, such as those of scenes with too few frames, and were replaced by others.
    fn replaced(&self) -> ReplacedDraws {
        ReplacedDraws::default()
    }

    /// The number of [`Self::replaced`], without its scenes.
    fn replaced_count(&self) -> u64 {
        self.replaced().count
    }

    /// Scenes with samples so far for whose poses the pose normalisation has no stable solution.
    fn unstable_poses(&self) -> UnstablePoses {
        UnstablePoses::default()
    }

    /// Hashes of the lists of scenes that samples are drawn from, each under its field in the configuration, for lists that can change
    /// although the configuration does not.
    fn scene_lists(&self) -> Vec<(String, Sha256Digest)> {
        Vec::new()
    }

    /// What a reader of the run must know about the data, such as how many scenes are excluded.
    fn notices(&self) -> Vec<String> {
        Vec::new()
    }
}

impl PosedImages {
    /// Dimensions of the images.
    pub fn stack(&self) -> Stack {
        Stack { views: self.cameras.len(), height: self.size.height, width: self.size.width }
    }

    /// The images as the network's input.
    ///
    /// # Errors
    /// [`atsplat_model::ModelError`] for images with NaN.
    pub fn views(&self) -> Result<Views, TrainError> {
        Ok(Views::new(self.size, self.images.clone(), self.cameras.clone())?)
    }

    /// One image.
    ///
    /// # Panics
    /// If there is no such view.
    pub fn image(&self, view: usize) -> &[f32] {
        let length = self.stack().pixels() * 3;
        &self.images[view * length..(view + 1) * length]
    }
}

impl Sample {
    /// The failure of this sample.
    pub(crate) fn failure(&self, reason: FailureReason) -> SampleFailure {
        SampleFailure { sample: self.name.clone(), reason }
    }

    /// If the network can see both at once.
    pub(crate) fn has_shape_of(&self, other: &Self) -> bool {
        self.context.stack() == other.context.stack()
    }

    /// For each target, the context view with the nearest camera: the nearest-view baseline copies it.
    ///
    /// # Panics
    /// If there is no context view.
    pub fn nearest(&self) -> Vec<usize> {
        let centre = |camera: &Camera| camera.camera_from_world.inverse().centre();
        let nearest = |target: &Camera| {
            let distance = |camera: &Camera| centre(camera).distance_squared(centre(target));
            let views = self.context.cameras.iter().map(distance).enumerate();
            #[expect(clippy::expect_used, reason = "every sample has context views")]
            let (view, _) = views.min_by(|a, b| a.1.total_cmp(&b.1)).expect("a context view");
            view
        };
        self.targets.cameras.iter().map(nearest).collect()
    }
}

/// The first sample that `attempt` makes from a random stream given by `id` and `stream`, or the reason of the last failure
/// after 20 attempts.
fn first_sample(
    source: &dyn Source,
    stream: &str,
    id: SampleId,
    mut attempt: impl FnMut(&mut SplitMix64) -> Result<Result<Sample, String>, TrainError>,
) -> Result<Sample, TrainError> {
    const ATTEMPTS: u32 = 20;
    let mut reason = String::new();
    for number in 0..ATTEMPTS {
        match attempt(&mut SplitMix64::for_scene(id.seed, &format!("{stream} {} {number}", id.number)))? {
            Ok(sample) => return Ok(sample),
            Err(error) => reason = error,
        }
    }
    Err(TrainError::NoSample { purpose: Purpose::Training, source_name: source.name(), attempts: ATTEMPTS, reason })
}

/// A size for the renderer and images, which count in 32 bits.
#[expect(clippy::expect_used, reason = "2³² pixels a side would not fit into memory")]
pub(crate) fn pixel_size(size: ImageSize) -> atsplat_camera::ImageSize {
    let [height, width] =
        [size.height, size.width].map(|side| u32::try_from(side).expect("an image of fewer than 2³² pixels a side"));
    atsplat_camera::ImageSize { width, height }
}

/// Context and target cameras in the network's frame.
struct NormalisedCameras {
    context: Vec<Camera>,
    targets: Vec<Camera>,
    /// Factor on all lengths.
    scale: f64,
    /// What applied because the rule has no stable solution.
    fallbacks: Vec<Fallback>,
}

/// Cameras normalised by a rule that depends on the context's poses.
fn normalised(
    context: &[Camera],
    targets: &[Camera],
    rule: &PoseNormalisation,
) -> Result<NormalisedCameras, TrainError> {
    let poses = |cameras: &[Camera]| -> Vec<WorldFromCamera> {
        cameras.iter().map(|camera| camera.camera_from_world.inverse()).collect()
    };
    let poses_of = normalise(&poses(context), &poses(targets), rule)?;
    let with = |cameras: &[Camera], poses: &[WorldFromCamera]| {
        let camera =
            |(camera, pose): (&Camera, &WorldFromCamera)| Camera { camera_from_world: pose.inverse(), ..*camera };
        cameras.iter().zip(poses).map(camera).collect()
    };
    Ok(NormalisedCameras {
        context: with(context, &poses_of.context),
        targets: with(targets, &poses_of.targets),
        scale: poses_of.new_from_old.scale,
        fallbacks: poses_of.fallbacks,
    })
}
