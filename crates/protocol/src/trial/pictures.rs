use atsplat_files::Sha256Digest;
use std::fmt;
use std::sync::Arc;

use atsplat_camera::{Camera, ImageSize};
use atsplat_pixels::{DecodeLimits, ImageU8};
use atsplat_scene::preprocess::Plan;
use atsplat_scene::{Frame, Picture, Scene, SceneError};

use super::digests::{PictureDigests, Reading};
use super::prefetch::Reservation;
use super::unwaited::Unwaited;
use crate::ProtocolError;

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
    decoded: Unwaited<Decoded>,
}

/// A preprocessed picture, and the bytes that it was decoded from.
#[derive(Clone)]
struct Decoded {
    picture: Result<Arc<ImageU8>, Arc<ProtocolError>>,
    /// `None` where there were none to read, or none need to be.
    bytes: Option<Reading>,
}

impl LazyPicture {
    pub(super) const fn new(scene: Arc<Scene>, frame: usize, plan: Arc<Plan>, limits: DecodeLimits) -> Self {
        Self { scene, frame, plan, limits, decoded: Unwaited::new() }
    }

    pub(super) fn get(&self) -> Result<Arc<ImageU8>, ProtocolError> {
        self.decoded.get(|| self.decode()).picture.map_err(ProtocolError::Picture)
    }

    /// SHA-256 of the bytes that were decoded, or would be; `None` where they cannot be read.
    pub(super) fn digest(&self, digests: &PictureDigests) -> Option<Sha256Digest> {
        if let Some(Decoded { bytes: Some(reading), .. }) = self.decoded.made() {
            return Some(digests.learn(reading));
        }
        digests.of(&self.scene, self.frame)
    }

    /// Bytes that the preprocessed picture takes: three a pixel.
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

    /// The picture as the dataset has it. Bytes are read once: what is hashed is what is decoded.
    fn read(&self) -> (Result<ImageU8, SceneError>, Option<Reading>) {
        let (scene, position) = (&self.scene.key, self.frame);
        match self.scene.frames.get(position) {
            Some(frame) if matches!(frame.picture, Picture::File(_) | Picture::Encoded(_)) => {
                let begun = Reading::begin(&frame.picture);
                match frame.bytes(scene, position) {
                    Ok(bytes) => {
                        let picture = Frame::decode_bytes(&bytes, scene, position, &self.limits);
                        (picture, Some(begun.end(&bytes)))
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
            .field("decoded", &picture.decoded.made().is_some())
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
