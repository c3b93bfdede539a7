use std::path::PathBuf;

use crate::checks::cameras::report_cameras;
use crate::nerfstudio::AppliedTransform;
use crate::{Scene, SceneError, SceneSource, TimestampSource, Warnings};

/// The scenes of one format, as its files have them. Every reader is a [`SceneSource`], whose [`SceneSource::load`] checks what was
/// read: a format neither has to do that nor can leave it out.
pub(crate) trait SceneReader: Send + Sync {
    /// [`SceneSource::keys`].
    fn keys(&self) -> &[String];

    /// Reads one scene's cameras and locates its images. What can be wrong in any format is checked afterwards.
    ///
    /// # Errors
    /// Those of [`SceneSource::load`].
    fn read(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError>;

    /// Warns of what can be wrong in this format alone, after the checks of all formats.
    fn check(&self, _scene: &Scene, _warnings: &mut Warnings) {}

    /// [`SceneSource::files`]. In object storage, others are empty when [`Self::read`] is called.
    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError>;

    /// [`SceneSource::images_for_sizes`].
    fn images_for_sizes(&self, _key: &str) -> Result<Vec<PathBuf>, SceneError> {
        Ok(Vec::new())
    }

    /// [`SceneSource::times`].
    fn times(&self) -> TimestampSource {
        TimestampSource::Given
    }

    /// [`Self::times`] of one scene, if they depend on its numbers.
    fn times_of(&self, _scene: &Scene) -> TimestampSource {
        SceneReader::times(self)
    }

    /// [`SceneSource::applied_transform`].
    fn applied_transform(&self, _key: &str) -> Result<Option<AppliedTransform>, SceneError> {
        Ok(None)
    }
}

impl<R: SceneReader + ?Sized> SceneSource for R {
    fn keys(&self) -> &[String] {
        SceneReader::keys(self)
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let scene = self.read(key, warnings)?.require_a_pose()?;
        report_cameras(&scene, self.times_of(&scene), warnings);
        self.check(&scene, warnings);
        Ok(scene)
    }

    fn times(&self) -> TimestampSource {
        SceneReader::times(self)
    }

    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        SceneReader::files(self, key)
    }

    fn images_for_sizes(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        SceneReader::images_for_sizes(self, key)
    }

    fn applied_transform(&self, key: &str) -> Result<Option<AppliedTransform>, SceneError> {
        SceneReader::applied_transform(self, key)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use atsplat_pixels::{ImageU8, encode_png};

    use super::*;
    use crate::colmap::{ColmapOptions, ColmapScenes};
    use crate::nerfstudio::{NerfstudioOptions, NerfstudioScenes};
    use crate::re10k::{Re10kOptions, Re10kScenes, parse_trajectory};
    use crate::torch::{TorchChunks, export_chunks};
    use crate::{FrameImage, WarningKind, open};

    /// A reader that has no shared check in it.
    struct Fifth {
        keys: [String; 1],
        times: TimestampSource,
        has_pose: bool,
    }

    impl SceneReader for Fifth {
        fn keys(&self) -> &[String] {
            &self.keys
        }

        fn read(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
            warnings.push(WarningKind::MissingImage, key, "found while reading");
            let rows = "7 0.4 0.8 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n7 0.4 0.8 0.5 0.5 0 0 1 0 0 3 0 1 0 0 0 0 1 0";
            let mut scene = parse_trajectory(rows.as_bytes(), Path::new("fifth"))?.to_scene(key);
            for frame in scene.frames.iter_mut().filter(|_| !self.has_pose) {
                frame.image = FrameImage::Absent.unposed("no rotation");
            }
            Ok(scene)
        }

        fn check(&self, scene: &Scene, warnings: &mut Warnings) {
            warnings.push(WarningKind::UnreadField, &scene.key, "found by its own check");
        }

        fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
            Ok(vec![key.into()])
        }

        fn times_of(&self, scene: &Scene) -> TimestampSource {
            assert_eq!(scene.frames.len(), 2);
            self.times
        }
    }

    fn kinds(warnings: &Warnings) -> Vec<WarningKind> {
        warnings.kept().iter().map(|warning| warning.kind).collect()
    }

    #[test]
    fn scenes_of_a_new_format_are_checked_between_reading_and_its_own_check() {
        let load = |times, has_pose| {
            let (source, mut warnings) = (Fifth { keys: ["s".to_owned()], times, has_pose }, Warnings::new());
            (source.load("s", &mut warnings).map(drop), warnings)
        };
        for (times, what) in [
            (TimestampSource::Given, "1 timestamps repeat"),
            (TimestampSource::FromNames, "1 numbers at the end of images' names repeat"),
        ] {
            let (loaded, warnings) = load(times, true);
            loaded.unwrap();
            let expected = [
                WarningKind::MissingImage,
                WarningKind::DuplicateTimestamp,
                WarningKind::WideFieldOfView,
                WarningKind::UnreadField,
            ];
            assert_eq!(kinds(&warnings), expected);
            assert!(warnings.kept()[1].detail.starts_with(what), "{:?}", warnings.kept());
        }
        let (loaded, warnings) = load(TimestampSource::Given, false);
        assert!(matches!(loaded, Err(SceneError::NoPose { frame: 0, .. })), "{loaded:?}");
        assert_eq!(kinds(&warnings), [WarningKind::MissingImage]);
    }

    /// A scene in each format: three frames with one pose and a wide lens, whose images are there.
    fn write_formats(folder: &Path) {
        let write = |name: &str, text: &str| {
            atsplat_tests::write_file(&folder.join(name), text);
        };
        let row = |time: u32| format!("{time} 0.4 0.8 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n");
        write("re10k/s.txt", &[0, 50_000, 100_000].map(row).concat());
        let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
        let frame = |at: u32| format!(r#"{{"file_path": "images/{at}.png", "transform_matrix": {pose}}}"#);
        let frames = [2, 9, 10].map(frame).join(", ");
        let lens = r#""w": 200, "h": 100, "fl_x": 80, "cx": 100, "cy": 50"#;
        write("nerfstudio/s/transforms.json", &format!(r#"{{{lens}, "frames": [{frames}]}}"#));
        write("colmap/s/sparse/0/cameras.txt", "1 PINHOLE 200 100 80 80 100 50\n");
        let image = |at: u32| format!("{at} 1 0 0 0 0 0 0 1 {at}.png\n\n");
        write("colmap/s/sparse/0/images.txt", &[2, 9, 10].map(image).concat());
        let of_captures =
            |number: u32| ["nerfstudio", "colmap"].map(|format| format!("{format}/s/images/{number}.png"));
        let of_times = [0, 50_000, 100_000].map(|time: u32| format!("re10k/s/{time}.png"));
        let image = encode_png(&ImageU8::new(200, 100, vec![9; 60_000]).unwrap()).unwrap();
        for name in [2, 9, 10].into_iter().flat_map(of_captures).chain(of_times) {
            atsplat_tests::write_file(&folder.join(name), &image);
        }
        let trajectories = open(folder.join("re10k"), &mut Warnings::new()).unwrap();
        export_chunks(&trajectories, &folder.join("torch"), 1, &mut Warnings::new(), &|| ()).unwrap();
    }

    #[test]
    fn scenes_of_every_format_are_checked_once_however_they_are_opened() {
        let folder = tempfile::tempdir().unwrap();
        write_formats(folder.path());
        let below = |format: &str| folder.path().join(format);
        let mut opening = Warnings::new();
        let shared = [WarningKind::RepeatedPose, WarningKind::WideFieldOfView];
        // Names are sorted as text.
        let with_order = [&shared[..], &[WarningKind::UnorderedTimestamps]].concat();
        let re10k = Re10kScenes::open(&below("re10k"), Re10kOptions::default(), &mut opening).unwrap();
        let torch = TorchChunks::open(below("torch"), &mut opening).unwrap();
        let nerfstudio = NerfstudioScenes::open(&below("nerfstudio"), NerfstudioOptions::default(), &mut opening);
        let colmap = ColmapScenes::open(&below("colmap"), ColmapOptions::default()).unwrap();
        let sources: [(&str, Box<dyn SceneSource>, &[WarningKind]); 4] = [
            ("re10k", Box::new(re10k), &shared),
            ("torch", Box::new(torch), &shared),
            ("nerfstudio", Box::new(nerfstudio.unwrap()), &shared),
            ("colmap", Box::new(colmap), &with_order),
        ];
        for (format, by_itself, expected) in sources {
            let detected = open(below(format), &mut opening).unwrap();
            for source in [by_itself.as_ref(), &detected] {
                let mut warnings = Warnings::new();
                source.load("s", &mut warnings).unwrap();
                assert_eq!(kinds(&warnings), expected, "{format}");
            }
        }
        assert_eq!(opening.total(), 0);
    }
}
