//! SHA-256 of pictures' bytes. Those of files are remembered by path, size and time of modification.
//!
//! The file that remembers has a line for each picture: SHA-256 of the absolute path, bytes, nanoseconds since 1970, SHA-256
//! of the content. Lines are appended, and of two that differ in the last alone the later counts; a line that a crash tore is passed over, and its
//! picture read again. A wrong line can only make equal data look changed.

use atsplat_files::Sha256Digest;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use atsplat_scene::{Picture, Scene};

use crate::ProtocolError;

/// A file that is younger than this may be written again without its time of modification telling: some file systems
/// count in steps of two seconds.
const SETTLED: Duration = Duration::from_secs(3);

/// What is known of pictures' bytes.
#[derive(Debug, Default)]
pub struct PictureDigests {
    memory: Mutex<Memory>,
    file: Option<PathBuf>,
}

#[derive(Debug, Default)]
struct Memory {
    known: HashMap<Stamp, Sha256Digest>,
    /// Lines that the file lacks.
    fresh: String,
}

/// A file as it was when its bytes were read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Stamp {
    path: Sha256Digest,
    bytes: u64,
    modified: u64,
}

/// Bytes that were read. What the file looked like is noted before the first of them, so that one that changes meanwhile
/// is never taken for one that is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    stamp: Option<Stamp>,
    digest: Sha256Digest,
}

/// A reading that has not come to the bytes.
pub(super) struct Begun(Option<Stamp>);

impl PictureDigests {
    /// What a file remembers; nothing where there is none. With `reread` no line counts, and every picture is read again.
    ///
    /// # Errors
    /// [`ProtocolError::Io`].
    pub fn open(file: &Path, reread: bool) -> Result<Self, ProtocolError> {
        let text = match fs::read(file) {
            Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            Err(source) => return Err(io_error("reading hashes of pictures", file, source)),
        };
        let lines = text.lines().filter(|_| !reread).filter_map(parsed);
        let memory = Memory { known: lines.collect(), fresh: String::new() };
        Ok(Self { memory: Mutex::new(memory), file: Some(file.to_owned()) })
    }

    /// Appends what was learnt since to the file.
    ///
    /// # Errors
    /// [`ProtocolError::Io`].
    pub fn keep(&self) -> Result<(), ProtocolError> {
        let mut memory = self.memory();
        let Some(file) = self.file.as_ref().filter(|_| !memory.fresh.is_empty()) else { return Ok(()) };
        let appended = OpenOptions::new().create(true).append(true).open(file);
        let written = appended.and_then(|mut file| file.write_all(memory.fresh.as_bytes()));
        written.map_err(|source| io_error("keeping hashes of pictures", file, source))?;
        memory.fresh.clear();
        Ok(())
    }

    /// Of any file; `None` where it cannot be read.
    pub fn of_file(&self, path: &Path) -> Option<Sha256Digest> {
        let begun = Begun(Stamp::of(path));
        self.known(&begun).or_else(|| Some(self.learn(begun.end(&fs::read(path).ok()?))))
    }

    /// Of the picture of a frame; `None` where it cannot be read. A picture that is made is not: what it is made from
    /// stands for it.
    pub(super) fn of(&self, scene: &Scene, position: usize) -> Option<Sha256Digest> {
        let frame = scene.frames.get(position)?;
        if let Picture::Made(made) = &frame.picture {
            return Some(Sha256Digest::of(made.fingerprint().as_bytes()));
        }
        let begun = Reading::begin(&frame.picture);
        self.known(&begun).or_else(|| Some(self.learn(begun.end(&frame.bytes(&scene.key, position).ok()?))))
    }

    fn known(&self, begun: &Begun) -> Option<Sha256Digest> {
        begun.0.and_then(|stamp| self.memory().known.get(&stamp).copied())
    }

    /// Remembers what was read.
    pub(super) fn learn(&self, Reading { stamp, digest }: Reading) -> Sha256Digest {
        if let Some(stamp) = stamp {
            let mut memory = self.memory();
            if memory.known.insert(stamp, digest) != Some(digest) {
                let Stamp { path, bytes, modified } = stamp;
                writeln!(memory.fresh, "{path} {bytes} {modified} {digest}").ok();
            }
        }
        digest
    }

    fn memory(&self) -> MutexGuard<'_, Memory> {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Reading {
    pub(super) fn begin(picture: &Picture) -> Begun {
        match picture {
            Picture::File(path) => Begun(Stamp::of(path)),
            _ => Begun(None),
        }
    }
}

impl Begun {
    pub(super) fn end(self, bytes: &[u8]) -> Reading {
        Reading { stamp: self.0, digest: Sha256Digest::of(bytes) }
    }
}

impl Stamp {
    /// `None` for a file that cannot be looked at, or that was written a moment ago.
    fn of(path: &Path) -> Option<Self> {
        let metadata = fs::metadata(path).ok()?;
        let modified = metadata.modified().ok()?;
        let settled = SystemTime::now().duration_since(modified).is_ok_and(|age| age >= SETTLED);
        let modified = u64::try_from(modified.duration_since(UNIX_EPOCH).ok()?.as_nanos()).ok()?;
        let path = Sha256Digest::of(std::path::absolute(path).ok()?.as_os_str().as_encoded_bytes());
        settled.then_some(Self { path, bytes: metadata.len(), modified })
    }
}

fn parsed(line: &str) -> Option<(Stamp, Sha256Digest)> {
    let mut parts = line.split(' ');
    let (path, bytes, modified, digest) = (parts.next()?, parts.next()?, parts.next()?, parts.next()?);
    let stamp = Stamp { path: path.parse().ok()?, bytes: bytes.parse().ok()?, modified: modified.parse().ok()? };
    parts.next().is_none().then_some((stamp, digest.parse().ok()?))
}

fn io_error(action: &'static str, path: &Path, source: io::Error) -> ProtocolError {
    ProtocolError::Io { action, path: path.to_owned(), source }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::sync::Arc;

    use atsplat_camera::{Distortion, ImageSize, NormalizedIntrinsics, PoseNormalisation};
    use atsplat_pixels::{DecodeLimits, ImageU8};
    use atsplat_scene::preprocess::Preprocessing;
    use atsplat_scene::{MadePicture, SceneError, SharedBytes};

    use super::*;
    use crate::preset::{Filters, NearFar};
    use crate::test_source::{MemorySource, SIZE, camera, png, scene};
    use crate::trial::{DecodeAhead, Prefetch, TargetPictures, Trial, TrialRecipe, Trials};
    use crate::{EvaluationIndex, IndexEntry};

    /// A picture of which the text alone is known.
    #[derive(Debug)]
    struct Painted(&'static str);

    impl MadePicture for Painted {
        fn size(&self) -> ImageSize {
            SIZE
        }

        fn fingerprint(&self) -> String {
            self.0.to_owned()
        }

        fn make(&self) -> Result<ImageU8, SceneError> {
            panic!("nobody needs to paint it")
        }
    }

    fn recipe() -> TrialRecipe {
        TrialRecipe {
            preprocessing: Preprocessing { expected_size: Some(SIZE), ..Preprocessing::of([]) },
            pose_normalisation: PoseNormalisation::None,
            near_far: NearFar { near: 0.5, far: 100.0 },
            filters: Filters::default(),
            decode_limits: DecodeLimits::default(),
            allow_absent_pictures: true,
        }
    }

    fn trial(scene: Scene, context: &[usize], target: &[usize], recipe: TrialRecipe) -> (Trial, TargetPictures) {
        let entry = IndexEntry { context: context.to_vec(), target: target.to_vec(), overlap: None };
        let index = EvaluationIndex { scenes: [(scene.key.clone(), vec![entry])].into_iter().collect() };
        let lazily = Prefetch { trials: 0, decode: DecodeAhead::Nothing, max_bytes: 0 };
        Trials::new(Arc::new(MemorySource::new([scene])), &index, recipe, lazily).next().unwrap().unwrap()
    }

    fn data_hash(scene: Scene, digests: &PictureDigests) -> Sha256Digest {
        let (trial, targets) = trial(scene, &[0, 2], &[1], recipe());
        trial.data_hash(&targets, digests)
    }

    /// Written a minute ago, as far as the file system knows.
    fn write(path: &Path, bytes: &[u8]) {
        fs::write(path, bytes).unwrap();
        settle(path);
    }

    fn settle(path: &Path) {
        let then = SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000);
        File::options().write(true).open(path).unwrap().set_modified(then).unwrap();
    }

    /// Computed independently by `tests/fixtures/make_trial_hash.py`.
    #[test]
    fn the_hash_is_that_of_the_documented_layout() {
        let mut one = scene("scène", 3, 5);
        for (number, frame) in one.frames.iter_mut().enumerate() {
            let place = glam::DVec3::new(-(number as f64) * 0.1, -0.0, 0.25);
            frame.camera = atsplat_camera::Camera::pinhole(
                atsplat_camera::CameraFromWorld::new(glam::DMat3::IDENTITY, place).unwrap(),
                NormalizedIntrinsics::new(0.8, 1.0, 0.5, 0.5).unwrap(),
            );
        }
        one.frames[0].picture = Picture::Made(Arc::new(Painted("left")));
        one.frames[2].picture = Picture::Made(Arc::new(Painted("right")));
        one.frames[1].picture = Picture::Absent;
        one.frames[1].camera.distortion = Distortion::OpenCv { k1: 0.01, k2: -0.02, k3: 0.03, p1: 0.001, p2: -0.002 };
        one.frames[2].camera.distortion = Distortion::Fisheye { k: [0.1, 0.2, -0.3, 0.4] };
        let oracle: serde_json::Value =
            serde_json::from_str(include_str!("../../tests/fixtures/trial_hash_oracle.json")).unwrap();
        let found = data_hash(one, &PictureDigests::default());
        assert_eq!(found.to_string(), oracle["data_hash"].as_str().unwrap());
    }

    #[test]
    fn every_picture_and_camera_that_is_read_counts_and_nothing_else() {
        let base = || scene("s", 4, 5);
        let none = PictureDigests::default();
        let reference = data_hash(base(), &none);
        let repainted = |frame: usize| {
            let mut changed = base();
            changed.frames[frame].picture = Picture::Encoded(SharedBytes::new(png([9, 9, 9])));
            data_hash(changed, &none)
        };
        let moved = |frame: usize| {
            let mut changed = base();
            changed.frames[frame].camera = camera(77.0);
            data_hash(changed, &none)
        };
        for frame in [0, 1, 2] {
            assert_ne!(repainted(frame), reference, "picture {frame}");
            assert_ne!(moved(frame), reference, "camera {frame}");
        }
        assert_eq!((repainted(3), moved(3)), (reference, reference), "frame 3 is not read");
        let mut swapped = base();
        let [left, right] = [0, 2].map(|frame: usize| swapped.frames[frame].picture.clone());
        (swapped.frames[0].picture, swapped.frames[2].picture) = (right, left);
        assert_ne!(data_hash(swapped, &none), reference, "the order counts");
        let mut renamed = base();
        renamed.key.push('2');
        let normalised = TrialRecipe { pose_normalisation: PoseNormalisation::pixelsplat(), ..recipe() };
        let (trial, targets) = trial(renamed, &[0, 2], &[1], normalised);
        assert_eq!(trial.data_hash(&targets, &none), reference, "the same data for every method");
        assert!(trial.context()[0].picture().is_ok() && targets.get(0).unwrap().is_ok());
        assert_eq!(trial.data_hash(&targets, &none), reference, "decoded or not");
    }

    #[test]
    fn files_are_known_by_size_and_time_unless_they_are_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let [picture, memory] = ["0.png", "digests.txt"].map(|name| folder.path().join(name));
        let dataset = || {
            let mut filed = scene("s", 3, 5);
            filed.frames[1].picture = Picture::File(picture.clone());
            filed
        };
        let hash = |reread: bool| {
            let digests = PictureDigests::open(&memory, reread).unwrap();
            let found = data_hash(dataset(), &digests);
            digests.keep().unwrap();
            found
        };
        write(&picture, &png([1, 2, 3]));
        let first = hash(false);
        assert_eq!(fs::read_to_string(&memory).unwrap().lines().count(), 1);
        assert_eq!(hash(false), first);
        assert_eq!(fs::read_to_string(&memory).unwrap().lines().count(), 1, "nothing new was learnt");
        // Of another size: noticed.
        write(&picture, &[png([1, 2, 3]), b"tail".to_vec()].concat());
        assert_ne!(hash(false), first);
        // Of the same size and time: noticed by those who read again, and by all after them.
        write(&picture, &png([1, 2, 4]));
        assert_eq!(png([1, 2, 3]).len(), png([1, 2, 4]).len());
        assert_eq!(hash(false), first, "taken for the same");
        let reread = hash(true);
        assert_ne!(reread, first);
        assert_eq!(hash(false), reread, "the last line counts");
        // Lines that a crash tore cost no more than reading again.
        let text = fs::read_to_string(&memory).unwrap();
        fs::write(&memory, &text[..text.len() - 9]).unwrap();
        assert_eq!(hash(true), reread);
        fs::remove_file(&picture).unwrap();
        let gone = PictureDigests::open(&memory, false).unwrap();
        assert_eq!(gone.of(&dataset(), 1), None);
    }

    #[test]
    fn a_file_that_was_written_a_moment_ago_is_not_remembered() {
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("0.png");
        fs::write(&picture, png([1, 2, 3])).unwrap();
        let digests = PictureDigests::default();
        let first = digests.of_file(&picture).unwrap();
        fs::write(&picture, png([1, 2, 4])).unwrap();
        assert_ne!(digests.of_file(&picture).unwrap(), first);
    }

    /// What was decoded counts, even where the file has changed since.
    #[test]
    fn a_decoded_picture_counts_as_the_bytes_that_were_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("0.png");
        write(&picture, &png([1, 2, 3]));
        let mut filed = scene("s", 3, 5);
        filed.frames[1].picture = Picture::File(picture.clone());
        let digests = PictureDigests::default();
        let (trial, targets) = trial(filed.clone(), &[0, 2], &[1], recipe());
        let colour = targets.get(0).unwrap().unwrap().pixel(0, 0);
        write(&picture, &[png([9, 9, 9]), b"tail".to_vec()].concat());
        let decoded = trial.data_hash(&targets, &digests);
        assert_eq!(colour, Some([1, 2, 3]));
        assert_ne!(decoded, data_hash(filed.clone(), &digests), "the file as it is now");
        write(&picture, &png([1, 2, 3]));
        assert_eq!(decoded, data_hash(filed, &PictureDigests::default()), "the file as it was");
    }
}
