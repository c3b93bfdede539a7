//! Trials: all that a method may see of a scene, and the frames it is asked to render.
//!
//! [`Trials`] walks an index over a dataset. Each step gives two things that go to two places: a [`Trial`]
//! to the method, with context pictures and target *cameras*; and [`TargetPictures`] to whoever scores. There
//! is no way from the one to the other.

mod digests;
mod hash;
mod pictures;
mod prefetch;
mod prepare;
mod recipe;
mod skip;
mod unwaited;
mod walk;

use atsplat_camera::{Camera, Fallback, ImageSize, PoseNormalisation, Similarity};
use atsplat_files::Sha256Digest;
use atsplat_scene::preprocess::Preprocessing;
use sha2::Sha256;

pub use digests::PictureDigests;
pub use pictures::{ContextView, TargetPictures};
pub use prefetch::{DecodeAhead, Prefetch};
pub use prepare::check;
pub use recipe::TrialRecipe;
pub use skip::{Refusal, SkipReason, SkipReport, Skipped};
pub use walk::Trials;

use crate::IndexEntry;
use crate::extrapolation::FrameLabel;
use crate::preset::NearFar;

/// What a method gets: context views with pictures, target cameras without.
#[derive(Clone, Debug)]
pub struct Trial {
    scene: String,
    entry_number: usize,
    entry: IndexEntry,
    context: Vec<ContextView>,
    targets: Vec<TargetView>,
    preprocessing: Preprocessing,
    normalisation: AppliedNormalisation,
    near_far: NearFar,
    hash: Sha256Digest,
    pose_hash: Sha256Digest,
    /// The hash of the data as far as cameras go.
    data: Sha256,
}

/// A view to render: its camera, and what it is to the context.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetView {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// Camera in the normalised world, intrinsics of the preprocessed picture.
    pub camera: Camera,
    /// Size of the preprocessed picture: what to render.
    pub size: ImageSize,
    /// Whether the method was given this frame, and how far outside the window it lies.
    pub label: FrameLabel,
}

/// The pose normalisation that a trial's cameras went through.
#[derive(Clone, Debug, PartialEq)]
pub struct AppliedNormalisation {
    /// The rule.
    pub rule: PoseNormalisation,
    /// From the dataset's world to the trial's world.
    pub new_from_old: Similarity,
    /// What the dataset's near and far planes were multiplied with.
    pub near_far_multiplier: f64,
    /// Where the rule had no stable answer and something else was done.
    pub fallbacks: Vec<Fallback>,
}

impl Trial {
    /// Key of the scene.
    pub fn scene(&self) -> &str {
        &self.scene
    }

    /// Position of the index entry among those of the scene; 0 but for latentSplat's lists.
    pub const fn entry_number(&self) -> usize {
        self.entry_number
    }

    /// The index entry: frame positions as the index has them.
    pub const fn entry(&self) -> &IndexEntry {
        &self.entry
    }

    /// Views that the method is given, in the index's order.
    pub fn context(&self) -> &[ContextView] {
        &self.context
    }

    /// Views that the method is asked for, in the index's order.
    pub fn targets(&self) -> &[TargetView] {
        &self.targets
    }

    /// What happened to pictures and intrinsics.
    pub const fn preprocessing(&self) -> &Preprocessing {
        &self.preprocessing
    }

    /// What happened to poses.
    pub const fn normalisation(&self) -> &AppliedNormalisation {
        &self.normalisation
    }

    /// Near and far plane in the trial's world.
    pub const fn near_far(&self) -> NearFar {
        self.near_far
    }

    /// Identity of the trial: scene key, frames, source cameras with their lenses, preprocessing, normalisation,
    /// near and far. The byte layout is documented in `trial/hash.rs`; two trials of equal hash ask a method the
    /// same question, as far as pictures under one scene key are the same: [`Self::data_hash`] says whether they are.
    pub const fn hash(&self) -> Sha256Digest {
        self.hash
    }

    /// Identity of the source poses alone, context then target, whatever the scene is called, however its
    /// pictures were cropped and whatever is done to it.
    pub const fn pose_hash(&self) -> Sha256Digest {
        self.pose_hash
    }

    /// Identity of what the trial reads of its dataset: the bytes of every picture, context and target, and the source
    /// cameras with their lenses; the same for every method, whatever is done to poses. Pictures that were decoded count
    /// as the bytes that were decoded, others as `digests` knows or reads them. The byte layout is documented in
    /// `trial/hash.rs`.
    pub fn data_hash(&self, targets: &TargetPictures, digests: &PictureDigests) -> Sha256Digest {
        let mut hasher = self.data.clone();
        let pictures = self.context.iter().map(|view| &view.picture).chain(&targets.pictures);
        pictures.for_each(|lazy| hash::picture(&mut hasher, lazy.digest(digests)));
        Sha256Digest::finish(hasher)
    }
}

#[cfg(test)]
mod tests;
