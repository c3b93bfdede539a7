use std::sync::Arc;

use atsplat_camera::{Camera, ImageSize};
use atsplat_numeric::Tolerance;
use atsplat_protocol::Preset;
use atsplat_scene::preprocess::{Plan, Preprocessing};
use atsplat_scene::{Scene, SceneError, SceneSource, WarningKind, Warnings, ratio_of_focal_lengths};

/// A dataset whose images have already been through a preset's preprocessing. Copies of RE10K and DL3DV are distributed as crops,
/// either with the official cameras of the whole images, which are cropped here, or with cameras that are already cropped, which are
/// left unchanged: pixels are closer to square with the right ones.
#[derive(Clone)]
pub struct AlreadyCropped {
    inner: Arc<dyn SceneSource>,
    plan: Plan,
}

impl AlreadyCropped {
    /// The dataset with cameras that match its images, and the preset without its preprocessing. `None` if the images have
    /// the expected size, or neither that nor the cropped size; one frame of the first scene with an image decides.
    pub fn of(source: &Arc<dyn SceneSource>, preset: &Preset) -> Option<(Self, Preset)> {
        let expected = preset.preprocessing.expected_size?;
        let plan = preset.preprocessing.plan(expected).ok()?;
        let output = plan.output();
        let found = source.keys().iter().find_map(|key| first_size(source.as_ref(), key))?;
        if found != output || found == expected {
            return None;
        }
        let preprocessing = Preprocessing {
            expected_size: Some(output),
            principal_point: preset.preprocessing.principal_point,
            steps: Vec::new(),
        };
        let preset = Preset { preprocessing, ..preset.clone() };
        Some((Self { inner: Arc::clone(source), plan }, preset))
    }
}

fn first_size(source: &dyn SceneSource, key: &str) -> Option<ImageSize> {
    let scene = source.load(key, &mut Warnings::new()).ok()?;
    let at = scene.frames.iter().position(|frame| frame.image.is_available())?;
    scene.frames.get(at)?.size(key, at).ok()
}

impl SceneSource for AlreadyCropped {
    fn keys(&self) -> &[String] {
        self.inner.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let mut scene = self.inner.load(key, warnings)?;
        for (at, frame) in scene.frames.iter_mut().enumerate() {
            // The stated size may say that the camera is not of the whole image.
            let output = self.plan.output();
            if frame.stated_size.is_some() && !frame.mismatch(output).is_some_and(|mismatch| mismatch.is_fatal()) {
                continue;
            }
            let cropped = self.plan.camera(&frame.camera);
            let cropped = cropped.map_err(|error| {
                let (scene, source) = (key.to_owned(), Box::new(error));
                SceneError::Preprocess { scene, frame: at, source }
            })?;
            if frame.stated_size.is_some() || self.is_of_whole((key, at), [&frame.camera, &cropped], warnings) {
                frame.camera = cropped;
                // The stated size is that of the whole image; the crop is checked by its pixels' shape.
                frame.stated_size = None;
            }
        }
        Ok(scene)
    }

    fn inner(&self) -> Option<&dyn SceneSource> {
        Some(self.inner.as_ref())
    }
}

impl AlreadyCropped {
    /// Whether a frame's camera, as given, is that of the whole image: pixels are closer to square when it is cropped. Warns if both
    /// would do, although they differ.
    fn is_of_whole(&self, (key, at): (&str, usize), [given, cropped]: [&Camera; 2], warnings: &mut Warnings) -> bool {
        /// The same as a difference of focal lengths by half a percent.
        const CLOSE: Tolerance = Tolerance::absolute(5e-3);
        let is_of_whole = self.stretch(cropped) < self.stretch(given);
        let differs = !CLOSE.accepts(cropped.intrinsics.fx / given.intrinsics.fx, 1.0);
        if differs && CLOSE.accepts(self.stretch(given), self.stretch(cropped)) {
            let taken = if is_of_whole { "of the whole image" } else { "of the crop" };
            let detail = format!(
                "frame {at}: expected a camera of the whole image or of its crop, found one whose pixels are as square in either: taken as \
                 {taken}"
            );
            warnings.push(WarningKind::UnexpectedSize, key, detail);
        }
        is_of_whole
    }

    /// How far the pixels of a crop are from square with this camera: the absolute logarithm of fx / fy.
    fn stretch(&self, camera: &Camera) -> f64 {
        ratio_of_focal_lengths(&camera.intrinsics, self.plan.output()).ln().abs()
    }
}

impl std::fmt::Debug for AlreadyCropped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "AlreadyCropped({} scenes)", self.keys().len())
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
    use atsplat_files::FileError;
    use atsplat_pixels::{ImageU8, encode_png};
    use atsplat_scene::nerfstudio::AppliedTransform;
    use atsplat_scene::{Frame, SharedBytes, TimestampSource};

    use super::*;

    /// A scene of one frame of this size and with these focal lengths.
    struct OneFrame(Vec<String>, ImageSize, [f64; 2]);

    impl SceneSource for OneFrame {
        fn keys(&self) -> &[String] {
            &self.0
        }

        fn load(&self, key: &str, _: &mut Warnings) -> Result<Scene, SceneError> {
            let ImageSize { width, height } = self.1;
            let image = ImageU8::new(width, height, vec![9; (width * height * 3) as usize]).unwrap();
            let [fx, fy] = self.2;
            let k = NormalizedIntrinsics::new(fx, fy, 0.5, 0.5).unwrap();
            let frame = Frame {
                name: "0".to_owned(),
                timestamp_micros: None,
                camera: Camera::pinhole(CameraFromWorld::IDENTITY, k),
                stated_size: None,
                image: atsplat_scene::FrameImage::Encoded(SharedBytes::new(encode_png(&image).unwrap())),
            };
            Ok(Scene { key: key.to_owned(), url: None, frames: vec![frame] })
        }
    }

    /// A dataset elsewhere, of which nothing can be fetched any more.
    struct Elsewhere(OneFrame);

    impl SceneSource for Elsewhere {
        fn keys(&self) -> &[String] {
            self.0.keys()
        }

        fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
            self.0.load(key, warnings)
        }

        fn times(&self) -> TimestampSource {
            TimestampSource::FromNames
        }

        fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
            Ok(vec![format!("{key}.txt").into()])
        }

        fn images_for_sizes(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
            Ok(vec![format!("{key}/0.png").into()])
        }

        fn check_fetched(&self) -> Result<(), FileError> {
            Err(FileError::during("fetching a scene", "data")(std::io::ErrorKind::TimedOut.into()))
        }

        fn applied_transform(&self, key: &str) -> Result<Option<AppliedTransform>, SceneError> {
            Err(SceneError::UnknownScene { key: key.to_owned(), path: "data".into() })
        }
    }

    #[test]
    fn what_the_dataset_says_about_itself_is_passed_on() {
        let size = ImageSize { width: 256, height: 256 };
        let source: Arc<dyn SceneSource> = Arc::new(Elsewhere(OneFrame(vec!["a".to_owned()], size, [0.5, 0.9])));
        let (cropped, _) = AlreadyCropped::of(&source, &Preset::named("re10k-2v-256").unwrap()).unwrap();
        assert_eq!(cropped.times(), TimestampSource::FromNames);
        assert_eq!(cropped.files("a").unwrap(), [PathBuf::from("a.txt")]);
        assert_eq!(cropped.images_for_sizes("a").unwrap(), [PathBuf::from("a/0.png")]);
        assert!(cropped.check_fetched().unwrap_err().to_string().starts_with("fetching a scene: "));
        assert!(matches!(cropped.applied_transform("a"), Err(SceneError::UnknownScene { .. })));
    }

    fn source(width: u32, height: u32) -> Arc<dyn SceneSource> {
        Arc::new(OneFrame(vec!["a".to_owned()], ImageSize { width, height }, [0.5, 0.9]))
    }

    #[test]
    fn cropped_cameras_are_unchanged() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        let size = ImageSize { width: 256, height: 256 };
        let squares: Arc<dyn SceneSource> = Arc::new(OneFrame(vec!["a".to_owned()], size, [0.88, 0.88]));
        let (cropped, adapted) = AlreadyCropped::of(&squares, &preset).unwrap();
        let k = cropped.load("a", &mut Warnings::new()).unwrap().frames[0].camera.intrinsics;
        Tolerance::EXACT.assert([k.fx, k.fy], [0.88, 0.88], "not cropped a second time");
        assert_eq!(adapted.preprocessing.expected_size, Some(size));
    }

    #[test]
    fn cameras_of_whole_images_are_cropped() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        let (cropped, adapted) = AlreadyCropped::of(&source(256, 256), &preset).unwrap();
        let scene = cropped.load("a", &mut Warnings::new()).unwrap();
        let k = scene.frames[0].camera.intrinsics;
        Tolerance::EXACT.assert([k.fx, k.fy], [0.5 * (455.0 / 256.0), 0.9], "as the papers' crop");
        assert_eq!(adapted.preprocessing.expected_size, Some(ImageSize { width: 256, height: 256 }));
        assert_ne!(adapted.hash().unwrap(), preset.hash().unwrap(), "another protocol, strictly");
    }

    /// Whole images of 480×270, of which the crop takes 448 of 480 columns: pixels differ from square by 1.6 % with the wrong camera.
    #[test]
    fn cameras_of_dl3dv_are_told_by_pixels_that_are_closer_to_square() {
        let preset = Preset::named("dl3dv-2v-256x448").unwrap();
        let size = ImageSize { width: 448, height: 256 };
        let loaded = |focals: [f64; 2]| {
            let source: Arc<dyn SceneSource> = Arc::new(OneFrame(vec!["a".to_owned()], size, focals));
            let (cropped, _) = AlreadyCropped::of(&source, &preset).unwrap();
            let mut warnings = Warnings::new();
            let k = cropped.load("a", &mut warnings).unwrap().frames[0].camera.intrinsics;
            ([k.fx, k.fy], warnings.total())
        };
        let whole = [0.5, 0.5 * 480.0 / 270.0];
        let crop = [0.5 * 480.0 / 448.0, 0.5 * 480.0 / 256.0];
        let (found, warnings) = loaded(whole);
        Tolerance::relative(2e-3).assert(found, crop, "cropped");
        assert_eq!(warnings, 0);
        let (found, warnings) = loaded(crop);
        Tolerance::EXACT.assert(found, crop, "not cropped a second time");
        assert_eq!(warnings, 0);
        // Between both: pixels are 0.8 % too wide or too narrow.
        let (_, warnings) = loaded([crop[0], crop[1] * 1.008]);
        assert_eq!(warnings, 1);
    }

    #[test]
    fn a_camera_that_cannot_be_cropped_is_an_error_about_its_frame() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        let size = ImageSize { width: 256, height: 256 };
        let source: Arc<dyn SceneSource> = Arc::new(OneFrame(vec!["a".to_owned()], size, [1.5e308, 0.9]));
        let (cropped, _) = AlreadyCropped::of(&source, &preset).unwrap();
        let error = cropped.load("a", &mut Warnings::new()).unwrap_err();
        assert!(matches!(error, SceneError::Preprocess { frame: 0, .. }), "{error}");
        assert!(error.to_string().starts_with("frame 0 of scene \"a\": "), "{error}");
    }

    #[test]
    fn images_of_other_sizes_are_ignored() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        assert!(AlreadyCropped::of(&source(640, 360), &preset).is_none());
        assert!(AlreadyCropped::of(&source(128, 128), &preset).is_none());
        assert!(AlreadyCropped::of(&source(256, 256), &Preset::named("photos-3v-256").unwrap()).is_none());
    }
}
