//! Scenes of a painted wall, whose pictures are known in closed form.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(dead_code, reason = "each test takes what it needs")]

use atsplat_files::Sha256Digest;
use std::sync::Arc;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_eval::runner::{Dataset, PlannedIndex};
use atsplat_pixels::{ImageU8, encode_png};
use atsplat_protocol::{EvaluationIndex, IndexEntry, Preset};
use atsplat_scene::{Frame, Picture, Scene, SceneError, SceneSource, SharedBytes, WarningKind, Warnings};
use glam::{DMat3, DVec3};

pub(crate) const SIZE: ImageSize = ImageSize { width: 64, height: 64 };
/// Distance of the wall from every camera.
pub(crate) const WALL: f64 = 4.0;

/// Cameras that look along +z, side by side, at a wall with waves of colour.
pub(crate) struct Walls {
    pub(crate) keys: Vec<String>,
    pub(crate) frames: usize,
    /// Scenes whose picture of this frame is no picture.
    pub(crate) damaged: Option<(usize, usize)>,
    /// A scene's frame whose picture is another one than the camera sees: by so much brighter, or darker.
    pub(crate) brighter: Option<(usize, usize, i16)>,
    /// Whether each seventh frame's picture is listed and not there.
    pub(crate) gaps: bool,
    /// Pictures, by scene and frame, that show another scene.
    pub(crate) replaced: Vec<(usize, usize)>,
    /// Whether loading a scene warns of something.
    pub(crate) warns: bool,
}

impl Walls {
    pub(crate) fn new(scenes: usize, frames: usize) -> Self {
        Self {
            keys: (0..scenes).map(|scene| format!("wall-{scene}")).collect(),
            frames,
            damaged: None,
            brighter: None,
            gaps: false,
            replaced: Vec::new(),
            warns: false,
        }
    }
}

pub(crate) fn camera(frame: usize) -> Camera {
    let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-0.2 * frame as f64, 0.0, 0.0)).unwrap();
    Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap())
}

fn colour(scene: usize, point: DVec3) -> [f64; 3] {
    let wave = |a: f64, b: f64| 0.5 + 0.35 * (a * point.x + b * point.y + scene as f64).sin();
    [wave(2.5, 0.7), wave(-1.1, 2.3), wave(1.7, 1.9)]
}

pub(crate) fn picture(scene: usize, frame: usize) -> ImageU8 {
    let projector = camera(frame).projector().unwrap();
    let mut samples = Vec::new();
    for ray in projector.pixel_rays(SIZE, atsplat_camera::DirectionScale::UnitDepth).unwrap() {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "colours lie in [0, 1]")]
        samples.extend(colour(scene, ray.unwrap().at(WALL)).map(|value| (255.0 * value).round() as u8));
    }
    ImageU8::new(SIZE.width, SIZE.height, samples).unwrap()
}

impl SceneSource for Walls {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        if self.warns {
            warnings.push(WarningKind::OffCentrePrincipalPoint, key, "for the test");
        }
        let scene = self.keys.iter().position(|known| known == key);
        let scene = scene.ok_or_else(|| SceneError::UnknownScene { key: key.to_owned(), path: "walls".into() })?;
        let frame = |frame: usize| {
            let seen = if self.replaced.contains(&(scene, frame)) { scene + 100 } else { scene };
            let mut shown = picture(seen, frame);
            if let Some((.., by)) = self.brighter.filter(|(of, at, _)| (*of, *at) == (scene, frame)) {
                let samples = shown.samples().iter();
                let samples = samples.map(|sample| u8::try_from((i16::from(*sample) + by).clamp(0, 255)).unwrap());
                shown = ImageU8::new(SIZE.width, SIZE.height, samples.collect()).unwrap();
            }
            let mut png = encode_png(&shown).unwrap();
            if self.damaged == Some((scene, frame)) {
                let middle = png.len() / 2;
                png.truncate(middle);
            }
            Frame {
                name: frame.to_string(),
                timestamp_micros: None,
                camera: camera(frame),
                stated_size: Some(SIZE),
                picture: match frame % 7 {
                    3 if self.gaps => Picture::Missing(format!("{frame}.png").into()),
                    _ => Picture::Encoded(SharedBytes::new(png)),
                },
            }
        };
        Ok(Scene { key: key.to_owned(), url: None, frames: (0..self.frames).map(frame).collect() })
    }
}

pub(crate) fn entry(context: &[usize], target: &[usize]) -> IndexEntry {
    IndexEntry { context: context.to_vec(), target: target.to_vec(), overlap: Some(0.5.into()) }
}

/// A published protocol on pictures as they are.
pub(crate) fn preset() -> Preset {
    let mut preset = Preset::named("re10k-2v-256").unwrap();
    preset.preprocessing.expected_size = None;
    preset.preprocessing.steps.clear();
    preset
}

/// Every scene is asked the same.
pub(crate) fn dataset(walls: Walls, entries: &[IndexEntry]) -> Dataset {
    let scenes = walls.keys.iter().map(|key| (key.clone(), entries.to_vec())).collect();
    let index = PlannedIndex {
        index: EvaluationIndex { scenes },
        told: "made for a test".to_owned(),
        sha256: Sha256Digest::of(b"test"),
        name: None,
    };
    let source: Arc<dyn SceneSource> = Arc::new(walls);
    Dataset { name: "walls".to_owned(), preset: preset(), source, told: "walls".to_owned(), index }
}
