use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics, WorldFromCamera};
use atsplat_files::Malformed;
use atsplat_scene::{Frame, FrameImage, Scene, SceneError, SceneSource, SharedBytes, WarningKind, Warnings};
use glam::{DMat3, DVec3};

pub(crate) const SIZE: ImageSize = ImageSize { width: 64, height: 48 };

/// An in-memory dataset that counts scene loads.
pub(crate) struct MemorySource {
    keys: Vec<String>,
    scenes: BTreeMap<String, Scene>,
    pub(crate) loads: AtomicUsize,
}

impl MemorySource {
    pub(crate) fn new(scenes: impl IntoIterator<Item = Scene>) -> Self {
        let scenes: Vec<Scene> = scenes.into_iter().collect();
        let keys = scenes.iter().map(|scene| scene.key.clone()).collect();
        let scenes = scenes.into_iter().map(|scene| (scene.key.clone(), scene)).collect();
        Self { keys, scenes, loads: AtomicUsize::new(0) }
    }

    /// Adds the key of a scene that cannot be loaded.
    pub(crate) fn with_key(mut self, key: &str) -> Self {
        self.keys.push(key.to_owned());
        self
    }
}

impl SceneSource for MemorySource {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        self.loads.fetch_add(1, Ordering::SeqCst);
        let scene = self.scenes.get(key).cloned();
        let scene = scene.ok_or_else(|| {
            let (key, path) = (key.to_owned(), PathBuf::new());
            if !self.keys.contains(&key) {
                return SceneError::UnknownScene { key, path };
            }
            Malformed::new("test", "line 1", "a scene", "nothing").in_file(path).into()
        })?;
        warnings.push(WarningKind::LensDistortion, key, "for the test");
        Ok(scene)
    }
}

/// A scene of cameras in a row, half a unit apart; the image of frame `n` has red = `n`, green = `shade`.
pub(crate) fn scene(key: &str, frames: u8, shade: u8) -> Scene {
    let frames = (0..frames).map(|number| Frame {
        name: number.to_string(),
        timestamp_micros: None,
        camera: camera(f64::from(number) * 0.5),
        stated_size: None,
        image: FrameImage::Encoded(SharedBytes::new(png([number, shade, 7]))),
    });
    Scene { key: key.to_owned(), url: None, frames: frames.collect() }
}

pub(crate) fn camera(x: f64) -> Camera {
    let pose = WorldFromCamera::new(DMat3::from_rotation_y(x * 0.1), DVec3::new(x, 0.0, 0.0)).unwrap();
    Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.8, 1.0, 0.5, 0.5).unwrap())
}

pub(crate) fn png(colour: [u8; 3]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let image = image::RgbImage::from_pixel(SIZE.width, SIZE.height, image::Rgb(colour));
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}
