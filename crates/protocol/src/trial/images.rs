use std::fmt;
use std::sync::Arc;

use atsplat_camera::{Camera, ImageSize};
use atsplat_files::Sha256Digest;
use atsplat_pixels::{DecodeLimits, ImageU8};
use atsplat_scene::preprocess::Plan;
use atsplat_scene::{FrameImage, Scene, SceneError};

use super::digests::{ImageDigests, PendingDigest, ReadDigest};
use super::lazy::LazyValue;
use super::prefetch::Reservation;
use crate::ProtocolError;

/// A context view.
#[derive(Clone)]
pub struct ContextView {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// Camera in the normalised world, with the intrinsics of the preprocessed image.
    pub camera: Camera,
    /// Size of the preprocessed image.
    pub size: ImageSize,
    pub(super) image: Arc<LazyImage>,
    pub(super) reservation: Option<Arc<Reservation>>,
}

impl ContextView {
    /// The preprocessed image, decoded on first use (or ahead, by [`super::Prefetch`]).
    ///
    /// # Errors
    /// [`ProtocolError::Image`] if the file cannot be read, decoded or preprocessed; the same error on every call.
    pub fn image(&self) -> Result<Arc<ImageU8>, ProtocolError> {
        self.image.get()
    }
}

/// The target images of a trial, for scoring only.
#[derive(Clone)]
pub struct TargetImages {
    pub(super) trial: Sha256Digest,
    pub(super) images: Vec<Arc<LazyImage>>,
    pub(super) reservation: Option<Arc<Reservation>>,
}

impl TargetImages {
    /// Hash of the trial that these images belong to.
    pub const fn trial(&self) -> Sha256Digest {
        self.trial
    }

    /// Number of images, equal to that of [`super::Trial::targets`].
    pub fn len(&self) -> usize {
        self.images.len()
    }

    /// Whether there are no target images.
    pub fn is_empty(&self) -> bool {
        self.images.is_empty()
    }

    /// The preprocessed image of the target at `position` in [`super::Trial::targets`]; `None` past the last.
    ///
    /// # Errors
    /// Those of [`ContextView::image`].
    pub fn get(&self, position: usize) -> Option<Result<Arc<ImageU8>, ProtocolError>> {
        self.images.get(position).map(|image| image.get())
    }
}

/// An image that is decoded and preprocessed once. A frame that is both context and target shares one.
pub(super) struct LazyImage {
    scene: Arc<Scene>,
    frame: usize,
    plan: Arc<Plan>,
    limits: DecodeLimits,
    decoded: LazyValue<Decoded>,
}

/// A preprocessed image, and the bytes that it was decoded from.
#[derive(Clone)]
struct Decoded {
    image: Result<Arc<ImageU8>, Arc<ProtocolError>>,
    /// `None` if there are no encoded bytes, or they cannot be read.
    bytes: Option<ReadDigest>,
}

impl LazyImage {
    pub(super) const fn new(scene: Arc<Scene>, frame: usize, plan: Arc<Plan>, limits: DecodeLimits) -> Self {
        Self { scene, frame, plan, limits, decoded: LazyValue::new() }
    }

    pub(super) fn get(&self) -> Result<Arc<ImageU8>, ProtocolError> {
        self.decoded.get(|| self.decode()).image.map_err(ProtocolError::Image)
    }

    /// SHA-256 of the bytes that were or would be decoded; `None` if they cannot be read.
    pub(super) fn digest(&self, digests: &ImageDigests) -> Option<Sha256Digest> {
        if let Some(Decoded { bytes: Some(digest), .. }) = self.decoded.get_if_computed() {
            return Some(digests.add(digest));
        }
        digests.of(&self.scene, self.frame)
    }

    /// Size of the preprocessed image in bytes: three per pixel.
    pub(super) fn bytes(&self) -> u64 {
        let size = self.plan.output();
        u64::from(size.width) * u64::from(size.height) * 3
    }

    fn decode(&self) -> Decoded {
        let (image, bytes) = self.read();
        let image = image.map_err(ProtocolError::from).and_then(|image| {
            self.plan.apply(&image).map_err(|source| ProtocolError::Preprocess {
                scene: self.scene.key.clone(),
                frame: self.frame,
                source,
            })
        });
        Decoded { image: image.map(Arc::new).map_err(Arc::new), bytes }
    }

    /// The decoded image before preprocessing. Bytes are read once, so that exactly the decoded bytes are hashed.
    fn read(&self) -> (Result<ImageU8, SceneError>, Option<ReadDigest>) {
        let (scene, position) = (&self.scene.key, self.frame);
        match self.scene.frames.get(position) {
            Some(frame) if matches!(frame.image, FrameImage::File(_) | FrameImage::Encoded(_)) => {
                let pending = PendingDigest::of(&frame.image);
                match frame.bytes(scene, position) {
                    Ok(bytes) => {
                        let image = frame.decode_bytes(&bytes, scene, position, &self.limits);
                        (image, Some(pending.finish(&bytes)))
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
        let Self { frame, camera, size, image, reservation: _ } = self;
        f.debug_struct("ContextView")
            .field("frame", frame)
            .field("camera", camera)
            .field("size", size)
            .field("decoded", &image.decoded.get_if_computed().is_some())
            .finish()
    }
}

impl fmt::Debug for TargetImages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TargetImages").field("trial", &self.trial).field("images", &self.len()).finish_non_exhaustive()
    }
}
