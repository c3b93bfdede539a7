use std::collections::{BTreeSet, HashMap};
use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use atsplat_camera::ImageSize;
use atsplat_pixels::{ImageU8, Rounding};
use atsplat_scene::{Frame, MadePicture, Picture, Scene, SceneError, SceneSource, Warnings};
use indexmap::IndexMap;

use crate::{GENERATOR, Request, RoomsError, Simulation};

/// Bytes of pictures that are kept, so that those who walk the scenes again do not simulate them again.
const KEPT: usize = 512 << 20;

/// Simulated scenes as a dataset that lies on no disk.
///
/// A scene is built when it is loaded, and each of its pictures is rendered when it is asked for. A scene may be asked for
/// some of its frames alone; the others keep their cameras and places.
#[derive(Clone, Debug, Default)]
pub struct SimulatedScenes {
    keys: Vec<String>,
    requests: IndexMap<String, (Request, Wanted)>,
    kept: Arc<Kept>,
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
        } else {
            // What was kept may be of another request.
            self.kept = Arc::default();
        }
    }

    fn frame(&self, key: &str, simulation: &Arc<Simulation>, at: usize, wanted: &Wanted) -> Result<Frame, RoomsError> {
        let timestamp = simulation.shot(at)?.timestamp_micros;
        let is_wanted = match wanted {
            Wanted::Every => true,
            Wanted::These(frames) => frames.contains(&at),
        };
        let made = || SimulatedPicture {
            key: key.to_owned(),
            frame: at,
            simulation: Arc::clone(simulation),
            kept: Arc::clone(&self.kept),
        };
        Ok(Frame {
            name: timestamp.to_string(),
            timestamp_micros: Some(timestamp),
            camera: simulation.camera(at)?,
            stated_size: Some(simulation.request().size),
            picture: if is_wanted { Picture::Made(Arc::new(made())) } else { Picture::Absent },
        })
    }
}

impl SceneSource for SimulatedScenes {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, _warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let unknown = || SceneError::UnknownScene { key: key.to_owned(), path: PathBuf::from("simulated scenes") };
        let (request, wanted) = self.requests.get(key).ok_or_else(unknown)?;
        let simulation = Arc::new(Simulation::new(request.clone()).map_err(making(key))?);
        let frames = (0..simulation.shots().len()).map(|at| self.frame(key, &simulation, at, wanted));
        let frames = frames.collect::<Result<_, _>>().map_err(making(key))?;
        Ok(Scene { key: simulation.key(), url: None, frames })
    }
}

/// A frame that is rendered when it is asked for, and remembered.
struct SimulatedPicture {
    key: String,
    frame: usize,
    simulation: Arc<Simulation>,
    kept: Arc<Kept>,
}

impl MadePicture for SimulatedPicture {
    fn size(&self) -> ImageSize {
        self.simulation.request().size
    }

    fn fingerprint(&self) -> String {
        format!("{GENERATOR}, frame {} of {:?}", self.frame, self.simulation.request())
    }

    fn make(&self) -> Result<ImageU8, SceneError> {
        if let Some(picture) = self.kept.get(&self.key, self.frame) {
            return Ok(picture);
        }
        let picture = self.simulation.picture(self.frame).map_err(making(&self.key))?;
        let picture = picture.to_u8(Rounding::Nearest).map_err(|error| making(&self.key)(error.into()))?;
        self.kept.put(&self.key, self.frame, &picture);
        Ok(picture)
    }
}

impl fmt::Debug for SimulatedPicture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SimulatedPicture({} {})", self.key, self.frame)
    }
}

fn making(key: &str) -> impl Fn(RoomsError) -> SceneError {
    move |error| SceneError::Making { scene: key.to_owned(), source: Box::new(error) }
}

/// Pictures that were rendered, up to [`KEPT`] bytes; what comes later is rendered anew each time.
#[derive(Default)]
struct Kept(Mutex<Pictures>);

#[derive(Default)]
struct Pictures {
    bytes: usize,
    /// By scene and frame.
    all: HashMap<(String, usize), ImageU8>,
}

impl Kept {
    fn get(&self, key: &str, frame: usize) -> Option<ImageU8> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.all.get(&(key.to_owned(), frame)).cloned()
    }

    fn put(&self, key: &str, frame: usize, picture: &ImageU8) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let bytes = picture.samples().len();
        if kept.bytes + bytes <= KEPT && kept.all.insert((key.to_owned(), frame), picture.clone()).is_none() {
            kept.bytes += bytes;
        }
    }
}

impl fmt::Debug for Kept {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Kept")
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
