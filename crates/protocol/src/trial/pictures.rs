use std::fmt;
use std::sync::Arc;

use atsplat_camera::{Camera, ImageSize};
use atsplat_files::Sha256Digest;
use atsplat_pixels::{DecodeLimits, ImageU8};
use atsplat_scene::preprocess::Plan;
use atsplat_scene::{Picture, Scene, SceneError};

use super::digests::{PendingDigest, PictureDigests, ReadDigest};
use super::lazy::LazyValue;
use super::prefetch::Reservation;
use crate::ProtocolError;

/// A context view.
#[derive(Clone)]
pub struct ContextView {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// Camera in the normalised world, with the intrinsics of the preprocessed picture.
    pub camera: Camera,
    /// Size of the preprocessed picture.
    pub size: ImageSize,
    pub(super) picture: Arc<LazyPicture>,
    pub(super) reservation: Option<Arc<Reservation>>,
}

impl ContextView {
    /// The preprocessed picture, decoded on first use (or ahead, by [`super::Prefetch`]).
    ///
    /// # Errors
    /// [`ProtocolError::Picture`] if the file cannot be read, decoded or preprocessed; the same error on every call.
    pub fn picture(&self) -> Result<Arc<ImageU8>, ProtocolError> {
        self.picture.get()
    }
}

/// The target pictures of a trial, for scoring only.
#[derive(Clone)]
pub struct TargetPictures {
    pub(super) trial: Sha256Digest,
    pub(super) pictures: Vec<Arc<LazyPicture>>,
    pub(super) reservation: Option<Arc<Reservation>>,
}

impl TargetPictures {
    /// Hash of the trial that these pictures belong to.
    pub const fn trial(&self) -> Sha256Digest {
        self.trial
    }

    /// Number of pictures, equal to that of [`super::Trial::targets`].
    pub fn len(&self) -> usize {
        self.pictures.len()
    }

    /// Whether there are no target pictures.
    pub fn is_empty(&self) -> bool {
        self.pictures.is_empty()
    }

    /// The preprocessed picture of the target at `position` in [`super::Trial::targets`]; `None` past the last.
    ///
    /// # Errors
    /// Those of [`ContextView::picture`].
    pub fn get(&self, position: usize) -> Option<Result<Arc<ImageU8>, ProtocolError>> {
        self.pictures.get(position).map(|picture| picture.get())
    }
}

/// A picture that is decoded and preprocessed once. A frame that is both context and target shares one.
pub(super) struct LazyPicture {
    scene: Arc<Scene>,
    frame: usize,
    plan: Arc<Plan>,
    limits: DecodeLimits,
    decoded: LazyValue<Decoded>,
}

/// A preprocessed picture, and the bytes that it was decoded from.
#[derive(Clone)]
struct Decoded {
    picture: Result<Arc<ImageU8>, Arc<ProtocolError>>,
    /// `None` if there are no encoded bytes, or they cannot be read.
    bytes: Option<ReadDigest>,
}

impl LazyPicture {
    pub(super) const fn new(scene: Arc<Scene>, frame: usize, plan: Arc<Plan>, limits: DecodeLimits) -> Self {
        Self { scene, frame, plan, limits, decoded: LazyValue::new() }
    }

    pub(super) fn get(&self) -> Result<Arc<ImageU8>, ProtocolError> {
        self.decoded.get(|| self.decode()).picture.map_err(ProtocolError::Picture)
    }

    /// SHA-256 of the bytes that were or would be decoded; `None` if they cannot be read.
    pub(super) fn digest(&self, digests: &PictureDigests) -> Option<Sha256Digest> {
        if let Some(Decoded { bytes: Some(digest), .. }) = self.decoded.get_if_computed() {
            return Some(digests.add(digest));
        }
        digests.of(&self.scene, self.frame)
    }

    /// Size of the preprocessed picture in bytes: three per pixel.
    pub(super) fn bytes(&self) -> u64 {
        let size = self.plan.output();
        u64::from(size.width) * u64::from(size.height) * 3
    }

    fn decode(&self) -> Decoded {
        let (picture, bytes) = self.read();
        let picture = picture.map_err(ProtocolError::from).and_then(|picture| {
            self.plan.apply(&picture).map_err(|source| ProtocolError::Preprocess {
                scene: self.scene.key.clone(),
                frame: self.frame,
                source,
            })
        });
        Decoded { picture: picture.map(Arc::new).map_err(Arc::new), bytes }
    }

    /// The decoded picture before preprocessing. Bytes are read once, so that exactly the decoded bytes are hashed.
    fn read(&self) -> (Result<ImageU8, SceneError>, Option<ReadDigest>) {
        let (scene, position) = (&self.scene.key, self.frame);
        match self.scene.frames.get(position) {
            Some(frame) if matches!(frame.picture, Picture::File(_) | Picture::Encoded(_)) => {
                let pending = PendingDigest::of(&frame.picture);
                match frame.bytes(scene, position) {
                    Ok(bytes) => {
                        let picture = frame.decode_bytes(&bytes, scene, position, &self.limits);
                        (picture, Some(pending.finish(&bytes)))
                    }
                    Err(error) => (Err(error), None),
                }
            }
            _ => (self.scene.decode(position, &self.limits), None),
        }
    }
}

impl fmt::Debug for ContextView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frame, camera, size, picture, reservation: _ } = self;
        f.debug_struct("ContextView")
            .field("frame", frame)
            .field("camera", camera)
            .field("size", size)
            .field("decoded", &picture.decoded.get_if_computed().is_some())
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
