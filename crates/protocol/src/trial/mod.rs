//! Trials: everything a method may see of a scene, and the views it has to render.
//!
//! [`Trials`] iterates over an index on a dataset. Each item has two parts: a [`Trial`] for the method, with context
//! images and target *cameras*, and [`TargetImages`] for scoring. The target images cannot be reached from the
//! trial.

mod digests;
mod hash;
mod images;
mod lazy;
mod prefetch;
mod prepare;
mod recipe;
mod skip;
mod trials;

use atsplat_camera::{Camera, Fallback, ImageSize, PoseNormalisation, Similarity};
use atsplat_files::Sha256Digest;
use atsplat_scene::preprocess::Preprocessing;
use sha2::Sha256;

pub use digests::ImageDigests;
pub use images::{ContextView, TargetImages};
pub use prefetch::{DecodeAhead, Prefetch};
pub use prepare::check;
pub use recipe::TrialRecipe;
pub use skip::{Rejection, SkipReason, SkipReport, Skipped};
pub use trials::Trials;

use crate::IndexEntry;
use crate::extrapolation::FrameLabel;
use crate::preset::NearFar;

/// The input of a method: context views with images, target views without.
#[derive(Clone, Debug)]
pub struct Trial {
    scene: String,
    position: usize,
    entry_number: usize,
    entry: IndexEntry,
    context: Vec<ContextView>,
    targets: Vec<TargetView>,
    preprocessing: Preprocessing,
    normalisation: AppliedNormalisation,
    near_far: NearFar,
    hash: Sha256Digest,
    pose_hash: Sha256Digest,
    /// The hasher of the data after the cameras; the images follow.
    data: Sha256,
}

/// A view to render: its camera, and its position relative to the context.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetView {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// Camera in the normalised world, with the intrinsics of the preprocessed image.
    pub camera: Camera,
    /// Size of the preprocessed image, which is the size to render.
    pub size: ImageSize,
    /// Whether it is also a context frame, and its distance from the window.
    pub label: FrameLabel,
}

/// The pose normalisation applied to a trial's cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct AppliedNormalisation {
    /// The rule.
    pub rule: PoseNormalisation,
    /// From the dataset's world to the trial's world.
    pub new_from_old: Similarity,
    /// Factor applied to the near and far planes.
    pub near_far_multiplier: f64,
    /// Fallbacks used where the rule had no stable solution.
    pub fallbacks: Vec<Fallback>,
}

impl Trial {
    /// Key of the scene.
    pub fn scene(&self) -> &str {
        &self.scene
    }

    /// Position of the index entry among all entries of the index, from 0.
    pub const fn position(&self) -> usize {
        self.position
    }

    /// Position of the index entry in the scene's list; 0 except in latentSplat's indices.
    pub const fn entry_number(&self) -> usize {
        self.entry_number
    }

    /// The index entry.
    pub const fn entry(&self) -> &IndexEntry {
        &self.entry
    }

    /// Context views, in the index's order.
    pub fn context(&self) -> &[ContextView] {
        &self.context
    }

    /// Target views, in the index's order.
    pub fn targets(&self) -> &[TargetView] {
        &self.targets
    }

    /// How images and intrinsics were preprocessed.
    pub const fn preprocessing(&self) -> &Preprocessing {
        &self.preprocessing
    }

    /// How poses were normalised.
    pub const fn normalisation(&self) -> &AppliedNormalisation {
        &self.normalisation
    }

    /// Near and far plane in the trial's world.
    pub const fn near_far(&self) -> NearFar {
        self.near_far
    }

    /// Identity of the trial: scene key, frames, source cameras with their lenses, preprocessing, normalisation,
    /// near and far. The byte layout is documented in `trial/hash.rs`. Trials of equal hash give a method the same
    /// input, provided that the images under one scene key are the same, which [`Self::data_hash`] verifies.
    pub const fn hash(&self) -> Sha256Digest {
        self.hash
    }

    /// Identity of the source poses alone, context then target, independent of the scene's key, the crop of its images,
    /// preprocessing and normalisation.
    pub const fn pose_hash(&self) -> Sha256Digest {
        self.pose_hash
    }

    /// Identity of the data that the trial reads: the bytes of every context and target image, and the source cameras
    /// with their lenses. It is the same for every method and normalisation. Decoded images count as the bytes that
    /// were decoded, others as the digests cached or computed by `digests`. The byte layout is documented in
    /// `trial/hash.rs`.
    pub fn data_hash(&self, targets: &TargetImages, digests: &ImageDigests) -> Sha256Digest {
        let mut hasher = self.data.clone();
        let images = self.context.iter().map(|view| &view.image).chain(&targets.images);
        images.for_each(|lazy| hash::image(&mut hasher, lazy.digest(digests)));
        Sha256Digest::finish(hasher)
    }
}

#[cfg(test)]
mod tests;
