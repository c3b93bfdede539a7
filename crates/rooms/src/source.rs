use std::collections::HashMap;
use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use atsplat_camera::ImageSize;
use atsplat_pixels::{ImageU8, Rounding};
use atsplat_scene::{Frame, FrameImage, GeneratedImage, Scene, SceneError, SceneSource, Warnings};
use indexmap::IndexMap;

use crate::{GENERATOR, Request, RoomsError, Simulation};

/// Size of the image cache, in bytes.
const CACHE_BYTES: usize = 512 << 20;

/// Simulated scenes as a dataset in memory.
///
/// A scene is built when it is loaded, and each of its images is rendered when it is first decoded.
#[derive(Clone, Debug, Default)]
pub struct SimulatedScenes {
    keys: Vec<String>,
    requests: IndexMap<String, Request>,
    cache: Arc<ImageCache>,
}

impl SimulatedScenes {
    /// A dataset without scenes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a scene; it replaces one of the same key.
    pub fn add(&mut self, request: Request) {
        let key = request.seed.key(request.kind);
        if self.requests.insert(key.clone(), request).is_none() {
            self.keys.push(key);
        } else {
            // Cached images may be of the replaced request.
            self.cache = Arc::default();
        }
    }

    fn frame(&self, key: &str, simulation: &Arc<Simulation>, at: usize) -> Result<Frame, RoomsError> {
        let timestamp = simulation.shot(at)?.timestamp_micros;
        let image = SimulatedImage {
            key: key.to_owned(),
            frame: at,
            simulation: Arc::clone(simulation),
            cache: Arc::clone(&self.cache),
        };
        Ok(Frame {
            name: timestamp.to_string(),
            timestamp_micros: Some(timestamp),
            camera: simulation.camera(at)?,
            stated_size: Some(simulation.request().size),
            image: FrameImage::Generated(Arc::new(image)),
        })
    }
}

impl SceneSource for SimulatedScenes {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, _warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let unknown = || SceneError::UnknownScene { key: key.to_owned(), path: PathBuf::from("simulated scenes") };
        let request = self.requests.get(key).ok_or_else(unknown)?;
        let simulation = Arc::new(Simulation::new(request.clone()).map_err(making(key))?);
        let frames = (0..simulation.shots().len()).map(|at| self.frame(key, &simulation, at));
        let frames = frames.collect::<Result<_, _>>().map_err(making(key))?;
        Ok(Scene { key: simulation.key(), url: None, frames })
    }
}

/// An image that is rendered on request and cached.
struct SimulatedImage {
    key: String,
    frame: usize,
    simulation: Arc<Simulation>,
    cache: Arc<ImageCache>,
}

impl GeneratedImage for SimulatedImage {
    fn size(&self) -> ImageSize {
        self.simulation.request().size
    }

    fn fingerprint(&self) -> String {
        format!("{GENERATOR}, frame {} of {:?}", self.frame, self.simulation.request())
    }

    fn make(&self) -> Result<ImageU8, SceneError> {
        if let Some(image) = self.cache.get(&self.key, self.frame) {
            return Ok(image);
        }
        let image = self.simulation.image(self.frame).map_err(making(&self.key))?;
        let image = image.to_u8(Rounding::Nearest).map_err(|error| making(&self.key)(error.into()))?;
        self.cache.put(&self.key, self.frame, &image);
        Ok(image)
    }
}

impl fmt::Debug for SimulatedImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SimulatedImage({} {})", self.key, self.frame)
    }
}

fn making(key: &str) -> impl Fn(RoomsError) -> SceneError {
    move |error| SceneError::Generating { scene: key.to_owned(), source: Box::new(error) }
}

/// Rendered images, up to [`CACHE_BYTES`] bytes; later ones are rendered again each time.
#[derive(Default)]
struct ImageCache(Mutex<Images>);

#[derive(Default)]
struct Images {
    bytes: usize,
    /// By scene and frame.
    all: HashMap<(String, usize), ImageU8>,
}

impl ImageCache {
    fn get(&self, key: &str, frame: usize) -> Option<ImageU8> {
        let images = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        images.all.get(&(key.to_owned(), frame)).cloned()
    }

    fn put(&self, key: &str, frame: usize, image: &ImageU8) {
        let mut images = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let bytes = image.samples().len();
        if images.bytes + bytes <= CACHE_BYTES && images.all.insert((key.to_owned(), frame), image.clone()).is_none() {
            images.bytes += bytes;
        }
    }
}

impl fmt::Debug for ImageCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ImageCache")
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
    fn a_request_replaces_the_one_of_the_same_key() {
        let mut source = SimulatedScenes::new();
        source.add(Request { frames: 2, ..request() });
        source.add(request());
        assert_eq!(source.keys(), ["rooms-test-00000003"], "the second request replaces the first");
        let scene = source.load("rooms-test-00000003", &mut Warnings::new()).unwrap();
        let simulation = Simulation::new(request()).unwrap();
        assert_eq!(scene.frames.len(), 4);
        for (at, frame) in scene.frames.iter().enumerate() {
            assert_eq!(frame.camera, simulation.camera(at).unwrap());
            let image = scene.decode(at, &DecodeLimits::default()).unwrap();
            assert_eq!(image, simulation.image(at).unwrap().to_u8(Rounding::Nearest).unwrap());
        }
    }

    #[test]
    fn unknown_keys_and_impossible_requests_are_errors() {
        let mut source = SimulatedScenes::new();
        source.add(Request { samples: 0, ..request() });
        let message = |key: &str| source.load(key, &mut Warnings::new()).unwrap_err().to_string();
        assert!(message("a").contains("no scene \"a\""), "{}", message("a"));
        let error = message("rooms-test-00000003");
        assert!(error.contains("samples: expected 1 to 256, found 0"), "{error}");
    }
}
