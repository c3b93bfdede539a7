//! Synthetic datasets in memory, for unit tests.

#![expect(clippy::unwrap_used, reason = "test support: the cameras are valid")]

use std::collections::BTreeSet;
use std::path::PathBuf;

use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics, WorldFromCamera};
use glam::{DMat3, DVec3};
use indexmap::IndexMap;

use crate::{Frame, FrameImage, Scene, SceneError, SceneSource, Warnings};

pub(crate) struct TestSource {
    scenes: IndexMap<String, Scene>,
    keys: Vec<String>,
    unreadable: BTreeSet<String>,
}

impl TestSource {
    pub(crate) fn new(scenes: impl IntoIterator<Item = Scene>) -> Self {
        let scenes: IndexMap<_, _> = scenes.into_iter().map(|scene| (scene.key.clone(), scene)).collect();
        Self { keys: scenes.keys().cloned().collect(), scenes, unreadable: BTreeSet::new() }
    }

    pub(crate) fn with_unreadable(mut self, key: &str) -> Self {
        assert!(self.scenes.contains_key(key));
        self.unreadable.insert(key.to_owned());
        self
    }

    /// The same captures after a rigid motion of the world.
    pub(crate) fn moved(mut self) -> Self {
        let rotation = DMat3::from_rotation_z(1.0) * DMat3::from_rotation_y(2.0);
        let new_from_old = WorldFromCamera::new(rotation, DVec3::new(30.0, -20.0, 10.0)).unwrap();
        for frame in self.scenes.values_mut().flat_map(|scene| &mut scene.frames) {
            let pose = frame.camera.camera_from_world.inverse().moved_by(&new_from_old);
            frame.camera.camera_from_world = pose.inverse();
        }
        self
    }

    pub(crate) fn scenes(&self) -> impl Iterator<Item = &Scene> {
        self.scenes.values()
    }
}

impl SceneSource for TestSource {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, _: &mut Warnings) -> Result<Scene, SceneError> {
        let path = || PathBuf::from("memory");
        if self.unreadable.contains(key) {
            let cut = std::io::Error::from(std::io::ErrorKind::UnexpectedEof);
            return Err(SceneError::io("reading a trajectory", path())(cut));
        }
        self.scenes.get(key).cloned().ok_or_else(|| SceneError::unknown_scene(key, &path()))
    }
}

/// A camera on a spiral that rotates as it moves, with RE10K's lens.
pub(crate) fn wandering_camera(step: f64) -> Camera {
    let rotation = DMat3::from_rotation_y(0.01 * step) * DMat3::from_rotation_x(0.003 * step);
    let centre = DVec3::new(step.sin(), 0.01 * step, 0.1 * step);
    let pose = WorldFromCamera::new(rotation, centre).unwrap().inverse();
    Camera::pinhole(pose, NormalizedIntrinsics::new(0.482_334_223, 0.857_483_091 + 1e-3 * step, 0.5, 0.5).unwrap())
}

/// A camera at `centre`, looking along +z.
pub(crate) fn camera_at(centre: [f64; 3]) -> Camera {
    rotated_camera_at(centre, 0.0)
}

/// A camera at `centre`, rotated about its y axis.
pub(crate) fn rotated_camera_at(centre: [f64; 3], degrees: f64) -> Camera {
    let rotation = DMat3::from_rotation_y(-degrees.to_radians());
    let pose = CameraFromWorld::new(rotation, rotation * -DVec3::from_array(centre)).unwrap();
    Camera::pinhole(pose, NormalizedIntrinsics::new(0.5, 0.9, 0.5, 0.5).unwrap())
}

pub(crate) fn frame(position: usize, camera: Camera) -> Frame {
    let timestamp = 33_367 * i64::try_from(position).unwrap();
    Frame {
        name: timestamp.to_string(),
        timestamp_micros: Some(timestamp),
        camera,
        stated_size: None,
        image: FrameImage::Absent,
    }
}

pub(crate) fn scene(key: &str, cameras: impl IntoIterator<Item = Camera>) -> Scene {
    let frames = cameras.into_iter().enumerate().map(|(position, camera)| frame(position, camera)).collect();
    Scene { key: key.to_owned(), url: None, frames }
}

pub(crate) fn wandering_scene(key: &str, frames: usize) -> Scene {
    let frames = (0..frames).map(|position| frame(position, wandering_camera(position as f64))).collect();
    Scene { key: key.to_owned(), url: Some(format!("https://example.org/{key}")), frames }
}
