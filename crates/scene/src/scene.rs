use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_camera::{Camera, ImageSize};
use atsplat_pixels::{DecodeLimits, ImageU8, Orientation, PictureFormat, PixelError};

use crate::files::{read_file, read_start};
use crate::{SceneError, SharedBytes};

/// Enough of a file to hold nearly every picture's header, in bytes.
const LIKELY_HEADER: u64 = 1 << 16;

/// Where a frame's picture is. Nothing is read or decoded until it is asked for.
#[derive(Clone, Debug)]
pub enum Picture {
    /// The trajectory came without pictures.
    Absent,
    /// A file that is listed but not there.
    Missing(PathBuf),
    /// A file.
    File(PathBuf),
    /// Encoded bytes inside a chunk, shared and not copied.
    Encoded(SharedBytes),
    /// Made whenever it is asked for, as simulated scenes are.
    Made(Arc<dyn MadePicture>),
}

impl Picture {
    /// Whether there is something to decode.
    pub const fn is_there(&self) -> bool {
        matches!(self, Self::File(_) | Self::Encoded(_) | Self::Made(_))
    }
}

/// A picture that lies nowhere until somebody asks for it.
pub trait MadePicture: fmt::Debug + Send + Sync {
    /// Its size, told without making it.
    fn size(&self) -> ImageSize;

    /// All that the picture depends on, as text: equal texts, equal pictures. Told without making it.
    fn fingerprint(&self) -> String;

    /// The picture; the same each time.
    ///
    /// # Errors
    /// [`SceneError::Making`].
    fn make(&self) -> Result<ImageU8, SceneError>;
}

/// What the first bytes of a picture say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureHeader {
    /// Columns and rows as stored.
    pub size: ImageSize,
    /// How EXIF asks for the picture to be shown, where that is not as it is stored. It is stored pixels that are
    /// decoded, as everywhere in the field.
    pub orientation: Option<Orientation>,
}

/// Which copy of a capture's pictures to take, where it comes in several sizes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PictureFolder {
    /// The folder that the metadata lists. Where that is absent, the largest of `…_2`, `…_4`, `…_8` that
    /// is there, reported frame by frame.
    #[default]
    Listed,
    /// The folder with `_factor` after its name: DepthSplat evaluates DL3DV on `images_8` (270×480) and
    /// `images_4` (540×960).
    Downscaled(u32),
}

/// One posed picture of a scene.
///
/// A frame's position in [`Scene::frames`] is what every evaluation index counts in
/// (pixelSplat `src/dataset/dataset_re10k.py`): the order of lines in a trajectory or of `frames[]` in a
/// `transforms.json`, with missing pictures keeping their place.
#[derive(Clone, Debug)]
pub struct Frame {
    /// What the source calls the frame: a timestamp or a file stem.
    pub name: String,
    /// Microseconds since the start of the video for RE10K; for DL3DV and its kin the number that the
    /// file's stem ends with, which is what their `.torch` chunks hold in this place (depthsplat
    /// `src/scripts/convert_dl3dv_test.py`). `None` where the source has neither.
    pub timestamp_micros: Option<i64>,
    /// Pose, intrinsics and lens.
    pub camera: Camera,
    /// Picture size that the metadata states; the file's own size wins where they differ.
    pub stated_size: Option<ImageSize>,
    /// Where the picture is.
    pub picture: Picture,
}

/// A posed capture: what a dataset holds under one key.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The dataset's name for the scene, as evaluation indices use it.
    pub key: String,
    /// Where the video or capture came from, if the source says so.
    pub url: Option<String>,
    /// Frames in the source's order.
    pub frames: Vec<Frame>,
}

impl Scene {
    /// Decodes the picture of the frame at `position`.
    ///
    /// # Errors
    /// As [`Frame::decode`]; [`SceneError::NoPicture`] for a position past the last frame.
    pub fn decode(&self, position: usize, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        self.frame(position)?.decode(&self.key, position, limits)
    }

    /// [`Self::decode`] of a picture that need not fit its camera, for whoever looks for what is wrong with it.
    ///
    /// # Errors
    /// As [`Self::decode`], but for [`SceneError::Misfit`].
    pub fn decode_any_shape(&self, position: usize, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        self.frame(position)?.decode_any_shape(&self.key, position, limits)
    }

    fn frame(&self, position: usize) -> Result<&Frame, SceneError> {
        let no_frame = || SceneError::NoPicture {
            scene: self.key.clone(),
            frame: position,
            reason: format!("the scene has {} frames", self.frames.len()),
        };
        self.frames.get(position).ok_or_else(no_frame)
    }
}

impl Frame {
    /// Decodes the picture. `scene` and `position` say in messages which frame this is.
    ///
    /// # Errors
    /// [`SceneError::NoPicture`], [`SceneError::Io`], [`SceneError::LfsPointer`], [`SceneError::Pixels`] for bytes that
    /// are no picture or exceed `limits`, and [`SceneError::Misfit`] for a picture that does not fit the frame's camera.
    pub fn decode(&self, scene: &str, position: usize, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        let picture = self.decode_any_shape(scene, position, limits)?;
        match self.misfit(ImageSize { width: picture.width(), height: picture.height() }) {
            Some(source) if source.is_fatal() => {
                Err(SceneError::Misfit { scene: scene.to_owned(), frame: position, source })
            }
            _ => Ok(picture),
        }
    }

    /// [`Self::decode`] of a picture that need not fit the frame's camera.
    ///
    /// # Errors
    /// As [`Self::decode`], but for [`SceneError::Misfit`].
    pub fn decode_any_shape(&self, scene: &str, position: usize, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        if let Picture::Made(picture) = &self.picture {
            return picture.make();
        }
        Self::decode_bytes(&self.bytes(scene, position)?, scene, position, limits)
    }

    /// Decodes what [`Self::bytes`] gave.
    ///
    /// # Errors
    /// [`SceneError::Pixels`] for bytes that are no picture or exceed `limits`.
    pub fn decode_bytes(
        bytes: &[u8],
        scene: &str,
        position: usize,
        limits: &DecodeLimits,
    ) -> Result<ImageU8, SceneError> {
        atsplat_pixels::decode(bytes, limits).map_err(in_frame(scene, position))
    }

    /// The encoded picture: read from its file, borrowed from its chunk, or made and encoded as PNG.
    ///
    /// # Errors
    /// [`SceneError::NoPicture`], [`SceneError::Io`], [`SceneError::Making`].
    pub fn bytes(&self, scene: &str, position: usize) -> Result<Cow<'_, [u8]>, SceneError> {
        let no_picture = |reason: String| SceneError::NoPicture { scene: scene.to_owned(), frame: position, reason };
        match &self.picture {
            Picture::File(path) => Ok(Cow::Owned(read_file("reading a picture", path)?)),
            Picture::Encoded(bytes) => Ok(Cow::Borrowed(bytes)),
            Picture::Made(picture) => {
                atsplat_pixels::encode_png(&picture.make()?).map(Cow::Owned).map_err(in_frame(scene, position))
            }
            Picture::Absent => Err(no_picture("the trajectory came without pictures".to_owned())),
            Picture::Missing(path) => Err(no_picture(format!("the file is missing ({})", path.display()))),
        }
    }

    /// The picture's size from its header; nothing is decoded.
    ///
    /// # Errors
    /// As [`Self::decode`], but for [`SceneError::Misfit`].
    pub fn size(&self, scene: &str, position: usize) -> Result<ImageSize, SceneError> {
        self.header(scene, position).map(|header| header.size)
    }

    /// What the picture says of itself; nothing is decoded.
    ///
    /// # Errors
    /// As [`Self::size`].
    pub fn header(&self, scene: &str, position: usize) -> Result<PictureHeader, SceneError> {
        match &self.picture {
            Picture::File(path) => header_of_file(path, in_frame(scene, position)),
            Picture::Made(picture) => Ok(PictureHeader { size: picture.size(), orientation: None }),
            _ => header_of(&self.bytes(scene, position)?).map_err(in_frame(scene, position)),
        }
    }
}

pub(crate) fn in_frame(scene: &str, frame: usize) -> impl FnOnce(PixelError) -> SceneError {
    let scene = scene.to_owned();
    move |source| SceneError::Pixels { scene, frame, source }
}

/// Size of the picture in a file, from its header.
pub(crate) fn size_of_file(path: &Path, error: impl FnOnce(PixelError) -> SceneError) -> Result<ImageSize, SceneError> {
    header_of_file(path, error).map(|header| header.size)
}

fn header_of_file(path: &Path, error: impl FnOnce(PixelError) -> SceneError) -> Result<PictureHeader, SceneError> {
    let action = "reading a picture's header";
    let start = read_start(action, path, LIKELY_HEADER)?;
    // WebP has its EXIF at the end.
    let suffices = PictureFormat::sniff(&start) != Some(PictureFormat::WebP);
    if suffices && let Ok(header) = header_of(&start) {
        return Ok(header);
    }
    // Colour profiles and previews can push a JPEG's size past any fixed length.
    header_of(&read_file(action, path)?).map_err(error)
}

fn header_of(bytes: &[u8]) -> Result<PictureHeader, PixelError> {
    let (width, height) = atsplat_pixels::size_of(bytes)?;
    Ok(PictureHeader { size: ImageSize { width, height }, orientation: Orientation::of(bytes) })
}
