//! What a training step learns from. A sample is a function of the seed and its number alone, so that a resumed run
//! and any number of threads see the same.

mod dataset;
mod exclude;
mod flip;
mod mixture;
mod rooms;
mod views;

use atsplat_camera::{Camera, PoseNormalisation, WorldFromCamera, normalise};
use atsplat_model::ImageSize;
use atsplat_model::network::Views;

pub use dataset::{DatasetConfig, DatasetSource};
pub use exclude::ExcludedScenes;
pub use flip::mirrored;
pub use mixture::Mixture;
pub use rooms::{RoomsConfig, RoomsSource};
pub use views::ViewChoice;

use crate::TrainError;
use crate::losses::Stack;

/// Context views with pictures, and target views with the pictures that they should get; in the network's frame.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Scene and frames, for messages.
    pub name: String,
    /// What the network is given.
    pub context: Posed,
    /// What its renders are compared with.
    pub targets: Posed,
}

/// Pictures of one size with their cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct Posed {
    /// Of every picture.
    pub size: ImageSize,
    /// View by view, row by row, red, green, blue in 0…1.
    pub pictures: Vec<f32>,
    /// One a picture.
    pub cameras: Vec<Camera>,
}

/// Which sample is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Of the run.
    pub seed: u64,
    /// Counts samples from 0.
    pub number: u64,
    /// The training step, for curricula.
    pub step: u64,
}

/// An endless list of samples.
pub trait Source: Send + Sync + std::fmt::Debug {
    /// What it is, for provenance.
    fn name(&self) -> String;

    /// The sample of a draw: always the same.
    ///
    /// # Errors
    /// [`TrainError::NoSample`] where many draws in a row give none, and what goes wrong in reading and rendering.
    fn sample(&self, draw: Draw) -> Result<Sample, TrainError>;
}

impl Posed {
    /// How many, and how large.
    pub fn stack(&self) -> Stack {
        Stack { views: self.cameras.len(), height: self.size.height, width: self.size.width }
    }

    /// As the network takes them.
    ///
    /// # Errors
    /// [`atsplat_model::ModelError`] for pictures with NaN.
    pub fn views(&self) -> Result<Views, TrainError> {
        Ok(Views::new(self.size, self.pictures.clone(), self.cameras.clone())?)
    }

    /// One picture.
    pub fn picture(&self, view: usize) -> &[f32] {
        let length = self.stack().pixels() * 3;
        self.pictures.get(view * length..(view + 1) * length).unwrap_or_default()
    }
}

impl Sample {
    /// Of each target, the context view whose camera stands nearest: the baseline that copies it.
    pub fn nearest(&self) -> Vec<usize> {
        let centre = |camera: &Camera| camera.camera_from_world.inverse().centre();
        let nearest = |target: &Camera| {
            let distance = |camera: &Camera| centre(camera).distance_squared(centre(target));
            let views = self.context.cameras.iter().map(distance).enumerate();
            views.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(view, _)| view)
        };
        self.targets.cameras.iter().map(nearest).collect()
    }
}

/// Cameras in the frame that a rule makes of the context.
fn normalised(
    context: &[Camera],
    targets: &[Camera],
    rule: &PoseNormalisation,
) -> Result<[Vec<Camera>; 2], TrainError> {
    let poses = |cameras: &[Camera]| -> Vec<WorldFromCamera> {
        cameras.iter().map(|camera| camera.camera_from_world.inverse()).collect()
    };
    let moved = normalise(&poses(context), &poses(targets), rule)?;
    let with = |cameras: &[Camera], poses: &[WorldFromCamera]| {
        let camera =
            |(camera, pose): (&Camera, &WorldFromCamera)| Camera { camera_from_world: pose.inverse(), ..*camera };
        cameras.iter().zip(poses).map(camera).collect()
    };
    Ok([with(context, &moved.context), with(targets, &moved.targets)])
}
