use std::fmt;
use std::sync::Arc;

use atsplat_camera::{Camera, ImageSize};
use atsplat_pixels::{DecodeLimits, ImageU8};
use atsplat_scene::Scene;
use atsplat_scene::preprocess::Plan;

use super::prefetch::Reservation;
use super::unwaited::Unwaited;
use crate::{ProtocolError, Sha256Digest};

/// A view that a method is given.
#[derive(Clone)]
pub struct ContextView {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// Camera in the normalised world, intrinsics of the preprocessed picture.
    pub camera: Camera,
    /// Size of the preprocessed picture.
    pub size: ImageSize,
    pub(super) picture: Arc<LazyPicture>,
    pub(super) reservation: Option<Arc<Reservation>>,
}

impl ContextView {
    /// The preprocessed picture, decoded when first asked for (or ahead, by [`super::Prefetch`]).
    ///
    /// # Errors
    /// [`ProtocolError::Picture`] where the file cannot be read, decoded or preprocessed; the same each time.
    pub fn picture(&self) -> Result<Arc<ImageU8>, ProtocolError> {
        self.picture.get()
    }
}

/// The target pictures of one trial: for scoring, never for a method.
#[derive(Clone)]
pub struct TargetPictures {
    pub(super) trial: Sha256Digest,
    pub(super) pictures: Vec<Arc<LazyPicture>>,
    pub(super) reservation: Option<Arc<Reservation>>,
}

impl TargetPictures {
    /// Hash of the trial that these belong to.
    pub const fn trial(&self) -> Sha256Digest {
        self.trial
    }

    /// How many there are: as many as [`super::Trial::targets`].
    pub fn len(&self) -> usize {
        self.pictures.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.pictures.is_empty()
    }

    /// The preprocessed picture of the target at `position` in [`super::Trial::targets`]; `None` past the last.
    ///
    /// # Errors
    /// As [`ContextView::picture`].
    pub fn get(&self, position: usize) -> Option<Result<Arc<ImageU8>, ProtocolError>> {
        self.pictures.get(position).map(|picture| picture.get())
    }
}

/// A picture that is decoded and preprocessed once. A frame that is context and target is one of these.
pub(super) struct LazyPicture {
    scene: Arc<Scene>,
    frame: usize,
    plan: Arc<Plan>,
    limits: DecodeLimits,
    decoded: Unwaited<Result<Arc<ImageU8>, Arc<ProtocolError>>>,
}

impl LazyPicture {
    pub(super) const fn new(scene: Arc<Scene>, frame: usize, plan: Arc<Plan>, limits: DecodeLimits) -> Self {
        Self { scene, frame, plan, limits, decoded: Unwaited::new() }
    }

    pub(super) fn get(&self) -> Result<Arc<ImageU8>, ProtocolError> {
        self.decoded.get(|| self.decode().map(Arc::new).map_err(Arc::new)).map_err(ProtocolError::Picture)
    }

    /// Bytes that the preprocessed picture takes: three a pixel.
    pub(super) fn bytes(&self) -> u64 {
        let size = self.plan.output();
        u64::from(size.width) * u64::from(size.height) * 3
    }

    fn decode(&self) -> Result<ImageU8, ProtocolError> {
        let picture = self.scene.decode(self.frame, &self.limits)?;
        self.plan.apply(&picture).map_err(|source| ProtocolError::Preprocess {
            scene: self.scene.key.clone(),
            frame: self.frame,
            source,
        })
    }
}

impl fmt::Debug for ContextView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frame, camera, size, picture, reservation: _ } = self;
        f.debug_struct("ContextView")
            .field("frame", frame)
            .field("camera", camera)
            .field("size", size)
            .field("decoded", &picture.decoded.is_made())
            .finish()
    }
}

impl fmt::Debug for TargetPictures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TargetPictures")
            .field("trial", &self.trial)
            .field("pictures", &self.len())
            .finish_non_exhaustive()
    }
}
