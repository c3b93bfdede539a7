use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use atsplat_camera::ImageSize;
use atsplat_pixels::{DecodeLimits, ImageU8, Rounding};
use atsplat_scene::{Frame, FrameImage, GeneratedImage, Scene, SceneError, SceneSource, Warnings};
use indexmap::IndexMap;

use crate::{GENERATOR, Request, RoomsError, Simulation};

/// Bytes of images that a dataset and its clones keep.
const CACHE_BYTES: usize = 512 << 20;

/// Simulated scenes as a dataset in memory.
///
/// A scene is built when it is loaded, and each of its images is rendered when it is first decoded.
#[derive(Clone, Debug, Default)]
pub struct SimulatedScenes {
    keys: Vec<String>,
    requests: IndexMap<String, (Request, Arc<ImageCache>)>,
    /// Bytes of all caches together.
    cached_bytes: Arc<Mutex<usize>>,
}

impl SimulatedScenes {
    /// A dataset without scenes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a scene; it replaces one of the same key.
    pub fn add(&mut self, request: Request) {
        let key = request.seed.key(request.kind);
        // Of one key, clones may have different requests.
        let cache = ImageCache { images: Mutex::default(), cached_bytes: Arc::clone(&self.cached_bytes) };
        if self.requests.insert(key.clone(), (request, Arc::new(cache))).is_none() {
            self.keys.push(key);
        }
    }
}

impl SimulatedImage {
    fn frame(self) -> Result<Frame, RoomsError> {
        let (simulation, at) = (Arc::clone(&self.simulation), self.frame);
        simulation.frame_with(at, FrameImage::Generated(Arc::new(self)))
    }
}

impl SceneSource for SimulatedScenes {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, _warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let unknown = || SceneError::UnknownScene { key: key.to_owned(), path: PathBuf::from("simulated scenes") };
        let (request, cache) = self.requests.get(key).ok_or_else(unknown)?;
        let simulation = Arc::new(Simulation::new(request.clone()).map_err(making(key))?);
        let request_text: Arc<OnceLock<String>> = Arc::default();
        let frames = (0..simulation.shots().len()).map(|frame| {
            let (simulation, cache, request_text) =
                (Arc::clone(&simulation), Arc::clone(cache), Arc::clone(&request_text));
            SimulatedImage { key: key.to_owned(), frame, simulation, cache, request_text }.frame()
        });
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
    /// The request as text, once for all frames of a scene: a given route has a camera for each of them.
    request_text: Arc<OnceLock<String>>,
}

impl GeneratedImage for SimulatedImage {
    fn size(&self) -> ImageSize {
        self.simulation.request().size
    }

    fn fingerprint(&self) -> Option<String> {
        let request = self.request_text.get_or_init(|| format!("{:?}", self.simulation.request()));
        Some(fingerprint(self.frame, request))
    }

    fn make(&self, _: &DecodeLimits) -> Result<ImageU8, SceneError> {
        if let Some(image) = self.cache.get(self.frame) {
            return Ok(image);
        }
        let image = self.simulation.image(self.frame).map_err(making(&self.key))?;
        let image = image.to_u8(Rounding::Nearest).map_err(|error| making(&self.key)(error.into()))?;
        self.cache.put(self.frame, &image);
        Ok(image)
    }
}

impl fmt::Debug for SimulatedImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SimulatedImage({} {})", self.key, self.frame)
    }
}

/// A text that identifies a frame's image by the debug output of a [`Request`]. The names of the request's types and fields are part of
/// it: whoever changes one of them makes results of simulated data, and baselines, look as if their data had changed.
pub(crate) fn fingerprint(frame: usize, request: &str) -> String {
    format!("{GENERATOR}, frame {frame} of {request}")
}

fn making(key: &str) -> impl Fn(RoomsError) -> SceneError {
    move |error| SceneError::Generating { scene: key.to_owned(), source: Box::new(error) }
}

/// Rendered images of one request, by frame. Once the caches of a dataset contain [`CACHE_BYTES`] together, further images are
/// rendered again each time.
struct ImageCache {
    images: Mutex<BTreeMap<usize, ImageU8>>,
    cached_bytes: Arc<Mutex<usize>>,
}

impl ImageCache {
    fn get(&self, frame: usize) -> Option<ImageU8> {
        self.images.lock().unwrap_or_else(PoisonError::into_inner).get(&frame).cloned()
    }

    fn put(&self, frame: usize, image: &ImageU8) {
        let mut images = self.images.lock().unwrap_or_else(PoisonError::into_inner);
        let mut cached_bytes = self.cached_bytes.lock().unwrap_or_else(PoisonError::into_inner);
        let bytes = image.samples().len();
        if *cached_bytes + bytes <= CACHE_BYTES && images.insert(frame, image.clone()).is_none() {
            *cached_bytes += bytes;
        }
    }
}

impl Drop for ImageCache {
    fn drop(&mut self) {
        let images = self.images.get_mut().unwrap_or_else(PoisonError::into_inner);
        let bytes: usize = images.values().map(|image| image.samples().len()).sum();
        *self.cached_bytes.lock().unwrap_or_else(PoisonError::into_inner) -= bytes;
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
            let FrameImage::Generated(generated) = &frame.image else { panic!("not rendered: {:?}", frame.image) };
            assert_eq!(generated.fingerprint().unwrap(), fingerprint(at, &format!("{:?}", request())));
            let image = scene.decode(at, &DecodeLimits::default()).unwrap();
            assert_eq!(image, simulation.image(at).unwrap().to_u8(Rounding::Nearest).unwrap());
        }
    }

    /// The images of each clone are those of its requests, whichever is decoded first; a request that both have is rendered
    /// once.
    #[test]
    fn clones_do_not_share_images_of_different_requests() {
        let shared = Request { seed: SceneSeed { number: 4, ..request().seed }, ..request() };
        let mut small = SimulatedScenes::new();
        small.add(shared);
        let mut large = small.clone();
        small.add(request());
        large.add(Request { size: ImageSize { width: 48, height: 32 }, ..request() });
        let size = |source: &SimulatedScenes, key: &str| {
            let scene = source.load(key, &mut Warnings::new()).unwrap();
            let image = scene.decode(1, &DecodeLimits::default()).unwrap();
            (image.width(), image.height())
        };
        let bytes = |source: &SimulatedScenes| *source.cached_bytes.lock().unwrap();
        assert_eq!(size(&small, "rooms-test-00000003"), (24, 16));
        assert_eq!(size(&large, "rooms-test-00000003"), (48, 32));
        let of_both = 3 * (24 * 16 + 48 * 32);
        assert_eq!(bytes(&small), of_both);
        for source in [&small, &large] {
            assert_eq!(size(source, "rooms-test-00000004"), (24, 16));
            assert_eq!(bytes(source), of_both + 3 * 24 * 16);
        }
        small.add(request());
        assert_eq!(bytes(&large), 3 * (24 * 16 + 48 * 32), "a request that was replaced gives its bytes back");
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
