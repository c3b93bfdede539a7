//! SHA-256 digests of image bytes, cached for files by path, size, times and inode.
//!
//! The cache file has one line per image: SHA-256 of the absolute path, size in bytes, modification time, inode, time of the last
//! change of the inode, SHA-256 of the content. Times are nanoseconds since 1970; where the system has no inodes, they and their time
//! are 0. Lines are only appended; of two lines that differ only in the last field, the later one counts. A line truncated by a crash,
//! or of an earlier version, which had no inodes, is ignored and its image read again.
//!
//! Without inodes, an image that is replaced by another of the same size and modification time keeps the old digest, and results of the
//! old image pass for results of the new one, until the images are read with `reread` ([`ImageDigests::open`]).

use std::collections::HashMap;
use std::fs::{self, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use atsplat_files::{FileError, Malformed, Sha256Digest, read_if_exists};
use atsplat_scene::{FrameImage, Scene};

use crate::ProtocolError;

/// A file modified more recently than this may be rewritten without a change of its modification time: some file systems
/// have a resolution of two seconds.
const SETTLED: Duration = Duration::from_secs(3);

/// A cache of the digests of images.
#[derive(Debug, Default)]
pub struct ImageDigests {
    cache: Mutex<Cache>,
    file: Option<PathBuf>,
}

#[derive(Debug, Default)]
struct Cache {
    known: HashMap<FileVersion, Sha256Digest>,
    /// Lines that are not in the cache file yet.
    unsaved: String,
}

/// Identifies the state of a file at the time its bytes were read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct FileVersion {
    path: Sha256Digest,
    bytes: u64,
    modified: u64,
    inode: u64,
    /// Unlike `modified`, no program can set it.
    changed: u64,
}

/// The digest of bytes that were read. The file's version is taken before its first byte is read, so that a file that
/// changes meanwhile is never mistaken for a known one.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReadDigest {
    version: Option<FileVersion>,
    digest: Sha256Digest,
}

/// The version of a file that is about to be read.
pub(super) struct PendingDigest(Option<FileVersion>);

impl ImageDigests {
    /// Loads a cache file; the cache is empty if there is none. With `reread`, its lines are ignored and every image is
    /// read again.
    ///
    /// # Errors
    /// [`ProtocolError::Io`]; [`ProtocolError::Malformed`] for a file that is no cache, to which [`Self::save`] would append.
    pub fn open(file: &Path, reread: bool) -> Result<Self, ProtocolError> {
        let bytes =
            read_if_exists(file).map_err(FileError::during::<ProtocolError>("reading hashes of images", file))?;
        let text = String::from_utf8_lossy(&bytes.unwrap_or_default()).into_owned();
        if !is_cache(&text) {
            let expected =
                "six fields: SHA-256 of a path, size, time, inode, time, SHA-256 (if the file is not yours, remove it)";
            let found = format!("{:?}", text.lines().next().unwrap_or_default());
            return Err(Malformed::new("hashes of images", "line 1", expected, found).in_file(file).into());
        }
        let known = text.lines().filter(|_| !reread).filter_map(parse_line).collect();
        Ok(Self { cache: Mutex::new(Cache { known, unsaved: String::new() }), file: Some(file.to_owned()) })
    }

    /// Appends new digests to the cache file.
    ///
    /// # Errors
    /// [`ProtocolError::Io`].
    pub fn save(&self) -> Result<(), ProtocolError> {
        let mut cache = self.cache();
        let Some(file) = self.file.as_ref().filter(|_| !cache.unsaved.is_empty()) else { return Ok(()) };
        let opened = OpenOptions::new().create(true).append(true).open(file);
        let written = opened.and_then(|mut file| file.write_all(cache.unsaved.as_bytes()));
        written.map_err(FileError::during::<ProtocolError>("writing hashes of images", file))?;
        cache.unsaved.clear();
        Ok(())
    }

    /// The digest of any file; `None` if it cannot be read.
    pub fn of_file(&self, path: &Path) -> Option<Sha256Digest> {
        let pending = PendingDigest(FileVersion::of(path));
        self.known(&pending).or_else(|| Some(self.add(pending.finish(&atsplat_files::read(path).ok()?))))
    }

    /// The digest of a frame's image; `None` if it cannot be read. A generated image is not read: its digest is that
    /// of its fingerprint.
    pub(super) fn of(&self, scene: &Scene, position: usize) -> Option<Sha256Digest> {
        let frame = scene.frames.get(position)?;
        if let FrameImage::Generated(made) = &frame.image {
            return made.fingerprint().map(|text| Sha256Digest::of(text.as_bytes()));
        }
        let pending = PendingDigest::of(&frame.image);
        self.known(&pending).or_else(|| Some(self.add(pending.finish(&frame.bytes(&scene.key, position).ok()?))))
    }

    fn known(&self, pending: &PendingDigest) -> Option<Sha256Digest> {
        pending.0.and_then(|version| self.cache().known.get(&version).copied())
    }

    /// Adds a digest to the cache.
    pub(super) fn add(&self, ReadDigest { version, digest }: ReadDigest) -> Sha256Digest {
        if let Some(version) = version {
            let mut cache = self.cache();
            if cache.known.insert(version, digest) != Some(digest) {
                let FileVersion { path, bytes, modified, inode, changed } = version;
                let line = format!("{path} {bytes} {modified} {inode} {changed} {digest}\n");
                cache.unsaved.push_str(&line);
            }
        }
        digest
    }

    fn cache(&self) -> MutexGuard<'_, Cache> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl PendingDigest {
    /// To be called before the image is read.
    pub(super) fn of(image: &FrameImage) -> Self {
        match image {
            FrameImage::File(path) => Self(FileVersion::of(path)),
            _ => Self(None),
        }
    }

    pub(super) fn finish(self, bytes: &[u8]) -> ReadDigest {
        ReadDigest { version: self.0, digest: Sha256Digest::of(bytes) }
    }
}

impl FileVersion {
    /// `None` if the metadata of the file cannot be read, or if it was modified within [`SETTLED`].
    fn of(path: &Path) -> Option<Self> {
        let metadata = fs::metadata(path).ok()?;
        let modified = metadata.modified().ok()?;
        let settled = SystemTime::now().duration_since(modified).is_ok_and(|age| age >= SETTLED);
        let modified = u64::try_from(modified.duration_since(UNIX_EPOCH).ok()?.as_nanos()).ok()?;
        let path = Sha256Digest::of(std::path::absolute(path).ok()?.as_os_str().as_encoded_bytes());
        let [inode, changed] = inode_and_change(&metadata)?;
        settled.then_some(Self { path, bytes: metadata.len(), modified, inode, changed })
    }
}

/// The inode and the time of its last change, in nanoseconds since 1970; `None` for a time before.
#[cfg(unix)]
fn inode_and_change(metadata: &fs::Metadata) -> Option<[u64; 2]> {
    use std::os::unix::fs::MetadataExt as _;

    let nanoseconds = i128::from(metadata.ctime()) * 1_000_000_000 + i128::from(metadata.ctime_nsec());
    Some([metadata.ino(), u64::try_from(nanoseconds).ok()?])
}

#[cfg(not(unix))]
#[expect(clippy::unnecessary_wraps, reason = "as on systems with inodes")]
const fn inode_and_change(_: &fs::Metadata) -> Option<[u64; 2]> {
    Some([0; 2])
}

/// Whether a text can be the content of a cache file: it has a line of one, or a crash left the beginning of a line alone, or zeros.
fn is_cache(text: &str) -> bool {
    let is_part_of_line = |byte: u8| byte.is_ascii_hexdigit() || matches!(byte, b' ' | b'\n' | 0);
    text.lines().any(|line| parse_line(line).is_some()) || text.bytes().all(is_part_of_line)
}

fn parse_line(line: &str) -> Option<(FileVersion, Sha256Digest)> {
    let mut parts = line.split(' ');
    let path = parts.next()?.parse().ok()?;
    let mut number = || parts.next()?.parse().ok();
    let (bytes, modified, inode, changed) = (number()?, number()?, number()?, number()?);
    let digest = parts.next()?.parse().ok()?;
    let version = FileVersion { path, bytes, modified, inode, changed };
    parts.next().is_none().then_some((version, digest))
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::sync::Arc;

    use atsplat_camera::{Distortion, ImageSize, NormalizedIntrinsics, PoseNormalisation};
    use atsplat_pixels::{DecodeLimits, ImageU8};
    use atsplat_scene::preprocess::Preprocessing;
    use atsplat_scene::{GeneratedImage, SceneError, SharedBytes};

    use super::*;
    use crate::preset::{Filters, LensDistortion, NearFar};
    use crate::test_source::{MemorySource, SIZE, camera, png, scene};
    use crate::trial::{Prefetch, TargetImages, Trial, TrialRecipe, Trials};
    use crate::{EvaluationIndex, IndexEntry};

    /// A generated image with only a fingerprint.
    #[derive(Debug)]
    struct FingerprintOnly(&'static str);

    impl GeneratedImage for FingerprintOnly {
        fn size(&self) -> ImageSize {
            SIZE
        }

        fn fingerprint(&self) -> Option<String> {
            Some(self.0.to_owned())
        }

        fn make(&self, _: &DecodeLimits) -> Result<ImageU8, SceneError> {
            panic!("hashing must not generate the image")
        }
    }

    fn recipe() -> TrialRecipe {
        TrialRecipe {
            lens_distortion: LensDistortion::Used,
            preprocessing: Preprocessing { expected_size: Some(SIZE), ..Preprocessing::of([]) },
            pose_normalisation: PoseNormalisation::None,
            near_far: NearFar { near: 0.5, far: 100.0 },
            disparity_planes: None,
            filters: Filters::default(),
            decode_limits: DecodeLimits::default(),
            allow_absent_images: true,
        }
    }

    fn trial(scene: Scene, context: &[usize], target: &[usize], recipe: TrialRecipe) -> (Trial, TargetImages) {
        let entry = IndexEntry { context: context.to_vec(), target: target.to_vec(), overlap: None };
        let index = EvaluationIndex { scenes: [(scene.key.clone(), vec![entry])].into_iter().collect() };
        Trials::new(Arc::new(MemorySource::new([scene])), &index, recipe, Prefetch::NONE).next().unwrap().unwrap()
    }

    fn data_hash(scene: Scene, digests: &ImageDigests) -> Sha256Digest {
        let (trial, targets) = trial(scene, &[0, 2], &[1], recipe());
        trial.data_hash(&targets, digests)
    }

    /// Writes a file with an old modification time.
    fn write(path: &Path, bytes: &[u8]) {
        fs::write(path, bytes).unwrap();
        let then = SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000);
        File::options().write(true).open(path).unwrap().set_modified(then).unwrap();
    }

    /// Computed independently by `tests/fixtures/make_trial_hash.py`.
    #[test]
    fn the_data_hash_follows_the_documented_layout() {
        let mut one = scene("scène", 3, 5);
        for (number, frame) in one.frames.iter_mut().enumerate() {
            let place = glam::DVec3::new(-(number as f64) * 0.1, -0.0, 0.25);
            frame.camera = atsplat_camera::Camera::pinhole(
                atsplat_camera::CameraFromWorld::new(glam::DMat3::IDENTITY, place).unwrap(),
                NormalizedIntrinsics::new(0.8, 1.0, 0.5, 0.5).unwrap(),
            );
        }
        one.frames[0].image = FrameImage::Generated(Arc::new(FingerprintOnly("left")));
        one.frames[2].image = FrameImage::Generated(Arc::new(FingerprintOnly("right")));
        one.frames[1].image = FrameImage::Absent;
        one.frames[1].camera.distortion = Distortion::OpenCv { k1: 0.01, k2: -0.02, k3: 0.03, p1: 0.001, p2: -0.002 };
        one.frames[2].camera.distortion = Distortion::Fisheye { k: [0.1, 0.2, -0.3, 0.4] };
        let oracle: serde_json::Value =
            serde_json::from_str(include_str!("../../tests/fixtures/trial_hash_oracle.json")).unwrap();
        let found = data_hash(one, &ImageDigests::default());
        assert_eq!(found.to_string(), oracle["data_hash"].as_str().unwrap());
    }

    #[test]
    fn the_data_hash_depends_on_exactly_the_images_and_cameras_of_the_trial() {
        let base = || scene("s", 4, 5);
        let none = ImageDigests::default();
        let reference = data_hash(base(), &none);
        let repainted = |frame: usize| {
            let mut changed = base();
            changed.frames[frame].image = FrameImage::Encoded(SharedBytes::new(png([9, 9, 9])));
            data_hash(changed, &none)
        };
        let moved = |frame: usize| {
            let mut changed = base();
            changed.frames[frame].camera = camera(77.0);
            data_hash(changed, &none)
        };
        for frame in [0, 1, 2] {
            assert_ne!(repainted(frame), reference, "image {frame}");
            assert_ne!(moved(frame), reference, "camera {frame}");
        }
        assert_eq!((repainted(3), moved(3)), (reference, reference), "frame 3 is not read");
        let mut swapped = base();
        let [left, right] = [0, 2].map(|frame: usize| swapped.frames[frame].image.clone());
        (swapped.frames[0].image, swapped.frames[2].image) = (right, left);
        assert_ne!(data_hash(swapped, &none), reference, "the order matters");
        let mut renamed = base();
        renamed.key.push('2');
        let normalised = TrialRecipe { pose_normalisation: PoseNormalisation::pixelsplat(), ..recipe() };
        let (trial, targets) = trial(renamed, &[0, 2], &[1], normalised);
        assert_eq!(trial.data_hash(&targets, &none), reference, "the same data for every method");
        assert!(trial.context()[0].image().is_ok() && targets.get(0).unwrap().is_ok());
        assert_eq!(trial.data_hash(&targets, &none), reference, "decoded or not");
    }

    #[test]
    fn files_are_identified_by_size_times_and_inode_unless_reread() {
        let folder = tempfile::tempdir().unwrap();
        let [image, cache] = ["0.png", "digests.txt"].map(|name| folder.path().join(name));
        let dataset = || {
            let mut on_disk = scene("s", 3, 5);
            on_disk.frames[1].image = FrameImage::File(image.clone());
            on_disk
        };
        let hash = |reread: bool| {
            let digests = ImageDigests::open(&cache, reread).unwrap();
            let found = data_hash(dataset(), &digests);
            digests.save().unwrap();
            found
        };
        write(&image, &png([1, 2, 3]));
        let first = hash(false);
        assert_eq!(fs::read_to_string(&cache).unwrap().lines().count(), 1);
        assert_eq!(hash(false), first);
        assert_eq!(fs::read_to_string(&cache).unwrap().lines().count(), 1, "no new digest");
        // A different size is noticed.
        write(&image, &[png([1, 2, 3]), b"tail".to_vec()].concat());
        assert_ne!(hash(false), first);
        write(&image, &png([1, 2, 3]));
        assert_eq!(hash(false), first);
        // The same size and modification time. The system's clock may only advance every ten milliseconds.
        std::thread::sleep(Duration::from_millis(50));
        write(&image, &png([1, 2, 4]));
        assert_eq!(png([1, 2, 3]).len(), png([1, 2, 4]).len());
        let other = hash(!cfg!(unix));
        assert_ne!(other, first);
        assert_eq!(hash(false), other);
        // What a line says is believed until the image is read again, and then by no later run.
        let text = fs::read_to_string(&cache).unwrap();
        let (version, _) = text.trim_end().rsplit_once(' ').unwrap();
        fs::write(&cache, format!("{version} {}\n", Sha256Digest::of(&png([1, 2, 3])))).unwrap();
        assert_eq!(hash(false), first, "mistaken for another image");
        assert_eq!(hash(true), other);
        assert_eq!(hash(false), other, "the last line counts");
        // A truncated line only costs reading the image again.
        let text = fs::read_to_string(&cache).unwrap();
        fs::write(&cache, &text[..text.len() - 9]).unwrap();
        assert_eq!(hash(true), other);
        fs::remove_file(&image).unwrap();
        assert_eq!(ImageDigests::open(&cache, false).unwrap().of(&dataset(), 1), None);
    }

    #[test]
    fn a_file_of_the_user_is_not_taken_for_a_cache() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("digests.txt");
        let digest = Sha256Digest::of(b"photo");
        fs::write(&file, format!("{digest}  photo.png\n")).unwrap();
        let error = ImageDigests::open(&file, false).unwrap_err().to_string();
        assert!(error.contains("line 1") && error.contains("digests.txt"), "{error}");
        assert!(error.contains("six fields: "), "{error}");
        assert!(ImageDigests::open(&file, true).is_err());
        let line = format!("{digest} 12 1700000000000000000 77 1700000000000000009 {digest}\n");
        let earlier = format!("{digest} 12 1700000000000000000 {digest}\n");
        fs::write(&file, &earlier).unwrap();
        assert!(
            ImageDigests::open(&file, false).is_ok_and(|digests| digests.cache().known.is_empty()),
            "without inode"
        );
        // A crash can leave any part of the first line, to which later lines are appended.
        for left in [String::new(), "\0".repeat(9), line[..70].to_owned(), format!("{}{line}", &line[..9]), line] {
            fs::write(&file, &left).unwrap();
            assert!(ImageDigests::open(&file, false).is_ok(), "{left}");
        }
    }

    #[test]
    fn a_recently_modified_file_is_not_cached() {
        let folder = tempfile::tempdir().unwrap();
        let image = folder.path().join("0.png");
        fs::write(&image, png([1, 2, 3])).unwrap();
        let digests = ImageDigests::default();
        let first = digests.of_file(&image).unwrap();
        fs::write(&image, png([1, 2, 4])).unwrap();
        assert_ne!(digests.of_file(&image).unwrap(), first);
    }

    /// The decoded bytes count, even if the file has changed since.
    #[test]
    fn a_decoded_image_is_hashed_as_the_bytes_that_were_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let image = folder.path().join("0.png");
        write(&image, &png([1, 2, 3]));
        let mut on_disk = scene("s", 3, 5);
        on_disk.frames[1].image = FrameImage::File(image.clone());
        let digests = ImageDigests::default();
        let (trial, targets) = trial(on_disk.clone(), &[0, 2], &[1], recipe());
        let colour = targets.get(0).unwrap().unwrap().pixel(0, 0);
        write(&image, &[png([9, 9, 9]), b"tail".to_vec()].concat());
        let decoded = trial.data_hash(&targets, &digests);
        assert_eq!(colour, Some([1, 2, 3]));
        assert_ne!(decoded, data_hash(on_disk.clone(), &digests), "the file as it is now");
        write(&image, &png([1, 2, 3]));
        assert_eq!(decoded, data_hash(on_disk, &ImageDigests::default()), "the file as it was");
    }
}
