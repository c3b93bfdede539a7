use std::collections::BTreeSet;
use std::path::PathBuf;

use atsplat_scene::{Scene, SceneError, SceneSource, Warnings};
use indexmap::IndexMap;

use crate::dataset::{PictureCoding, scene_with};
use crate::{Request, RoomsError, Simulation};

/// Simulated scenes as a dataset that lies on no disk: each is simulated when it is loaded.
///
/// Pictures cost the most, so a scene may be asked for some of its frames alone; the others keep their cameras and
/// places. Pictures are stored without loss.
#[derive(Clone, Debug, Default)]
pub struct SimulatedScenes {
    keys: Vec<String>,
    requests: IndexMap<String, (Request, Wanted)>,
}

#[derive(Clone, Debug)]
enum Wanted {
    Every,
    These(BTreeSet<usize>),
}

impl SimulatedScenes {
    /// No scene yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a scene with all of its pictures.
    pub fn add(&mut self, request: Request) {
        self.insert(request, Wanted::Every);
    }

    /// Adds a scene with the pictures of `frames` alone.
    pub fn add_frames(&mut self, request: Request, frames: impl IntoIterator<Item = usize>) {
        self.insert(request, Wanted::These(frames.into_iter().collect()));
    }

    fn insert(&mut self, request: Request, wanted: Wanted) {
        let key = request.seed.key(request.kind);
        if self.requests.insert(key.clone(), (request, wanted)).is_none() {
            self.keys.push(key);
        }
    }
}

impl SceneSource for SimulatedScenes {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, _warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let unknown = || SceneError::UnknownScene { key: key.to_owned(), path: PathBuf::from("simulated scenes") };
        let (request, wanted) = self.requests.get(key).ok_or_else(unknown)?;
        let making = |error: RoomsError| SceneError::Making { scene: key.to_owned(), source: Box::new(error) };
        let simulation = Simulation::new(request.clone()).map_err(making)?;
        let has_picture = |frame: usize| match wanted {
            Wanted::Every => true,
            Wanted::These(frames) => frames.contains(&frame),
        };
        scene_with(&simulation, PictureCoding::Png, has_picture).map_err(making)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::ImageSize;
    use atsplat_pixels::{DecodeLimits, Rounding};

    use super::*;
    use crate::{SceneKind, SceneSeed, Split};

    fn request() -> Request {
        let seed = SceneSeed { split: Split::Test, number: 3 };
        Request { size: ImageSize { width: 24, height: 16 }, frames: 4, ..Request::new(SceneKind::Rooms, seed) }
    }

    #[test]
    fn frames_that_nobody_wants_keep_their_cameras() {
        let mut source = SimulatedScenes::new();
        source.add(request());
        source.add_frames(request(), [2]);
        assert_eq!(source.keys(), ["rooms-test-00000003"], "asked for again, it replaces the first request");
        let scene = source.load("rooms-test-00000003", &mut Warnings::new()).unwrap();
        let simulation = Simulation::new(request()).unwrap();
        assert_eq!(scene.frames.len(), 4);
        for (at, frame) in scene.frames.iter().enumerate() {
            assert_eq!(frame.camera, simulation.camera(at).unwrap());
            let decoded = scene.decode(at, &DecodeLimits::default());
            assert_eq!(decoded.is_ok(), at == 2);
            if let Ok(picture) = decoded {
                assert_eq!(picture, simulation.picture(at).unwrap().to_u8(Rounding::Nearest).unwrap());
            }
        }
    }

    #[test]
    fn unknown_keys_and_impossible_requests_are_errors() {
        let mut source = SimulatedScenes::new();
        source.add(Request { samples: 0, ..request() });
        let told = |key: &str| source.load(key, &mut Warnings::new()).unwrap_err().to_string();
        assert!(told("a").contains("no scene \"a\""), "{}", told("a"));
        let error = told("rooms-test-00000003");
        assert!(error.contains("samples: expected 1 to 256, found 0"), "{error}");
    }
}
