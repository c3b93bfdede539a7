//! Images with an alpha channel that are composited over a colour when they are decoded.

use std::sync::Arc;

use atsplat_camera::ImageSize;
use atsplat_files::Sha256Digest;
use atsplat_pixels::{DecodeLimits, ImageU8, decode_over};

use crate::scene::in_frame;
use crate::{Frame, FrameImage, GeneratedImage, ImageHeader, Scene, SceneError};

/// The image of a frame over a colour.
#[derive(Debug)]
struct Composited {
    frame: Frame,
    scene: String,
    position: usize,
    /// That of the stored image, without the alpha channel.
    header: ImageHeader,
    background: [u8; 3],
}

impl GeneratedImage for Composited {
    fn size(&self) -> ImageSize {
        self.header.size
    }

    fn header(&self) -> ImageHeader {
        self.header
    }

    fn fingerprint(&self) -> Option<String> {
        let bytes = self.frame.bytes(&self.scene, self.position).ok()?;
        Some(format!("{} over {:?}", Sha256Digest::of(&bytes), self.background))
    }

    fn make(&self, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        let Self { frame, scene, position, background, .. } = self;
        let bytes = frame.bytes(scene, *position)?;
        let decoded = decode_over(&bytes, limits, *background);
        decoded.map_err(in_frame(scene, *position, &frame.image))
    }
}

impl Scene {
    /// The scene with images that have an alpha channel composited over a colour when they are decoded, see [`decode_over`]. Only
    /// headers are read; images whose header cannot be read, or that are beyond the default limits of decoding, stay as they are, and
    /// fail when they are decoded.
    #[must_use]
    pub fn composited_over(mut self, background: [u8; 3]) -> Self {
        for (position, frame) in self.frames.iter_mut().enumerate() {
            let header = frame.header_within(&self.key, position, &DecodeLimits::default());
            if let Some(header) = header.ok().filter(|header| header.has_alpha) {
                let (frame_as_stored, scene) = (frame.clone(), self.key.clone());
                frame.image = FrameImage::Generated(Arc::new(Composited {
                    frame: frame_as_stored,
                    scene,
                    position,
                    header: ImageHeader { has_alpha: false, ..header },
                    background,
                }));
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::test_source::wandering_scene;

    /// Of two frames, one has an alpha channel of 16 bits. What compositing leaves as it is is still to be warned of.
    #[test]
    fn a_composited_image_has_the_header_of_the_stored_one_without_alpha() {
        let images = concat!(env!("CARGO_MANIFEST_DIR"), "/../pixels/tests/fixtures/images");
        let mut scene = wandering_scene("a", 2);
        for (frame, name) in scene.frames.iter_mut().zip(["colour6_16.png", "colour2_8.png"]) {
            frame.image = FrameImage::File([images, name].iter().collect());
        }
        let headers = |scene: &Scene| -> Vec<ImageHeader> {
            scene.frames.iter().enumerate().map(|(at, frame)| frame.header("a", at).unwrap()).collect()
        };
        let [stored, opaque]: [ImageHeader; 2] = headers(&scene).try_into().unwrap();
        assert!(stored.has_alpha && stored.has_16_bits && !opaque.has_alpha);
        let composited = headers(&scene.composited_over([255; 3]));
        assert_eq!(composited, [ImageHeader { has_alpha: false, ..stored }, opaque]);
    }

    const WITH_ALPHA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../pixels/tests/fixtures/images/colour6_16.png");

    fn composited(image: &Path, background: [u8; 3]) -> Scene {
        let mut scene = wandering_scene("a", 1);
        scene.frames[0].image = FrameImage::File(image.to_owned());
        scene.composited_over(background)
    }

    fn fingerprint(scene: &Scene) -> Option<String> {
        match &scene.frames[0].image {
            FrameImage::Generated(image) => image.fingerprint(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn images_over_two_colours_have_two_fingerprints() {
        let over = |background: [u8; 3]| fingerprint(&composited(WITH_ALPHA.as_ref(), background)).unwrap();
        assert_eq!(over([255, 0, 0]), over([255, 0, 0]));
        assert_ne!(over([255, 0, 0]), over([0, 0, 255]));
    }

    /// Of two of them, the messages could be the same.
    #[test]
    fn an_image_that_is_gone_has_no_fingerprint() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::copy(WITH_ALPHA, &path).unwrap();
        let scene = composited(&path, [255; 3]);
        assert!(fingerprint(&scene).is_some());
        std::fs::remove_file(&path).unwrap();
        assert_eq!(fingerprint(&scene), None);
    }

    #[test]
    fn the_limits_of_decoding_hold() {
        let scene = composited(WITH_ALPHA.as_ref(), [255; 3]);
        assert!(scene.decode_any_shape(0, &DecodeLimits::default()).is_ok());
        let narrow = DecodeLimits { max_width: 1, ..DecodeLimits::default() };
        let refused = scene.decode_any_shape(0, &narrow);
        assert!(matches!(refused, Err(SceneError::Pixels { .. })), "{refused:?}");
    }
}
