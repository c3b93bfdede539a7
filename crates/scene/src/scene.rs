use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_camera::{Camera, ImageSize};
use atsplat_pixels::{DecodeLimits, ImageFormat, ImageU8, Orientation, PixelError, png_chunks};

use crate::checks::unposed::no_pose;
use crate::files::{read_file, read_start};
use crate::{SceneError, SharedBytes};

/// Bytes that contain the header of nearly every image file.
const LIKELY_HEADER: u64 = 1 << 16;

/// Where a frame's image is. It is read and decoded on demand.
#[derive(Clone, Debug)]
pub enum FrameImage {
    /// The source has no images.
    Absent,
    /// A listed file that does not exist.
    Missing(PathBuf),
    /// Several files, any of which may be it.
    Ambiguous(Vec<PathBuf>),
    /// A file.
    File(PathBuf),
    /// Encoded bytes inside a chunk, shared without a copy; they know its file. They may be unread, and are verified when they are.
    Encoded(SharedBytes),
    /// Generated on demand, as in simulated scenes.
    Generated(Arc<dyn GeneratedImage>),
    /// Not looked at, because the frame's pose is not finite or not a rotation. The frame keeps its position, as one whose image is
    /// missing does.
    Unposed {
        /// What was expected and found of the pose, and where.
        reason: String,
        /// The image as the source has it.
        image: Box<FrameImage>,
    },
}

impl FrameImage {
    /// The same image of a frame without a usable pose, for this reason.
    #[must_use]
    pub fn unposed(self, reason: impl Into<String>) -> Self {
        Self::Unposed { reason: reason.into(), image: Box::new(self) }
    }

    /// The image as the source has it, whether or not the frame has a usable pose.
    pub fn in_source(&self) -> &Self {
        match self {
            Self::Unposed { image, .. } => image.in_source(),
            image => image,
        }
    }

    /// The file that the source names, whether or not it exists and the frame has a usable pose; `None` if several may be it.
    pub fn listed_file(&self) -> Option<&Path> {
        match self.in_source() {
            Self::File(path) | Self::Missing(path) => Some(path),
            _ => None,
        }
    }

    /// Whether the source should have an image that is not there, or not to be told from others.
    pub const fn is_missing(&self) -> bool {
        matches!(self, Self::Missing(_) | Self::Ambiguous(_))
    }

    /// Whether there is an image to decode.
    pub const fn is_available(&self) -> bool {
        matches!(self, Self::File(_) | Self::Encoded(_) | Self::Generated(_))
    }

    /// The file to decode, if the image is in one.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::File(path) => Some(path),
            _ => None,
        }
    }

    /// The file, or what the image is in, for messages.
    pub fn place(&self) -> String {
        match self {
            Self::File(path) | Self::Missing(path) => path.display().to_string(),
            Self::Ambiguous(paths) => {
                let paths: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
                paths.join(" or ")
            }
            Self::Encoded(bytes) => {
                bytes.file().map_or_else(|| "in a chunk".to_owned(), |path| path.display().to_string())
            }
            Self::Generated(_) => "generated".to_owned(),
            Self::Absent => "no image".to_owned(),
            Self::Unposed { image, .. } => image.place(),
        }
    }
}

/// An image that is generated on demand.
pub trait GeneratedImage: fmt::Debug + Send + Sync {
    /// Its size, without generating it.
    fn size(&self) -> ImageSize;

    /// Its header, without generating it: by default that of an upright image of 8 bits without an alpha channel.
    fn header(&self) -> ImageHeader {
        ImageHeader::upright(self.size())
    }

    /// Everything that the image depends on, as text, so that equal texts mean equal images; without generating it. `None` if it
    /// depends on an image that cannot be read.
    fn fingerprint(&self) -> Option<String>;

    /// Generates the image, the same each time. `limits` are those of an image that has to be decoded for it.
    ///
    /// # Errors
    /// [`SceneError::Generating`]; if it depends on an image, those of [`Frame::decode_any_shape`].
    fn make(&self, limits: &DecodeLimits) -> Result<ImageU8, SceneError>;
}

/// The header of an encoded image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageHeader {
    /// Columns and rows as stored.
    pub size: ImageSize,
    /// The EXIF orientation, if the image is not upright. It is ignored when decoding, as everywhere in the field.
    pub orientation: Option<Orientation>,
    /// Whether there is an alpha channel. It is dropped when decoding, as everywhere in the field.
    pub has_alpha: bool,
    /// Whether samples have 16 bits. The low byte is dropped when decoding, as everywhere in the field.
    pub has_16_bits: bool,
    /// Whether samples are stated to be encoded for other displays than those of standard range. They are used as they are stored, as
    /// everywhere in the field.
    pub has_other_encoding: bool,
}

impl ImageHeader {
    /// That of an upright image of 8 bits in sRGB without an alpha channel.
    pub const fn upright(size: ImageSize) -> Self {
        Self { size, orientation: None, has_alpha: false, has_16_bits: false, has_other_encoding: false }
    }
}

/// Which copy of a capture's images to use, if there are several sizes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ImageFolder {
    /// The folder in the metadata. If it does not exist, the copy of the expected size ([`crate::NerfstudioOptions::expected_size`])
    /// among those by [`Self::FACTORS`], or else the largest, with a warning per frame.
    #[default]
    Listed,
    /// The folder with the suffix `_factor`: DepthSplat evaluates DL3DV on `images_8` (270×480) and `images_4`
    /// (540×960).
    Downscaled(u32),
}

impl ImageFolder {
    /// The factors of the scaled copies that captures have, the largest copy first.
    pub const FACTORS: [u32; 3] = [2, 4, 8];
}

/// One posed image of a scene.
///
/// Evaluation indices refer to a frame's position in [`Scene::frames`] (pixelSplat `src/dataset/dataset_re10k.py`): the
/// order of lines in a trajectory or of `frames[]` in a `transforms.json`, including frames with missing images.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The frame's name in the source: a timestamp or a file stem.
    pub name: String,
    /// For RE10K microseconds since the start of the video; for DL3DV and similar datasets the number at the end of the
    /// file's stem, as in their `.torch` chunks (depthsplat `src/scripts/convert_dl3dv_test.py`). `None` if there is
    /// neither.
    pub timestamp_micros: Option<i64>,
    /// Pose, intrinsics and lens. The pose is [`atsplat_camera::CameraFromWorld::UNKNOWN`] if the file's is unusable
    /// ([`FrameImage::Unposed`]).
    pub camera: Camera,
    /// Image size for which the metadata state the intrinsics. The image may be a scaled copy, for example in
    /// `images_4`; one of another shape does not fit ([`Self::mismatch`]).
    pub stated_size: Option<ImageSize>,
    /// Where the image is.
    pub image: FrameImage,
}

/// A posed capture, identified by a key in its dataset.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The scene's name, as used by evaluation indices.
    pub key: String,
    /// Source of the video or capture, if known.
    pub url: Option<String>,
    /// Frames in the source's order.
    pub frames: Vec<Frame>,
}

/// Where [`Frame::timestamp_micros`] comes from in a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimestampSource {
    /// A timestamp in the metadata, after which images may be named.
    Given,
    /// The number at the end of the image's name, if there is one: a counter, or the digits of a date, but never a time.
    FromNames,
}

/// Whether numbers can be times in microseconds: captures number their frames consecutively.
fn can_be_micros(numbers: &[i64]) -> bool {
    const MIN_STEP_MICROS: u64 = 1000;
    // Those of a chunk are any numbers.
    let span = numbers.iter().max().zip(numbers.iter().min()).map_or(0, |(last, first)| last.abs_diff(*first));
    (1u64..).zip(numbers).last().is_none_or(|(count, _)| span >= MIN_STEP_MICROS * (count - 1))
}

impl Scene {
    /// Whether every frame has a timestamp, and they can be microseconds: captures number their frames consecutively. `times`
    /// are those of the scene's dataset ([`crate::SceneSource::times`]).
    pub fn has_times(&self, times: TimestampSource) -> bool {
        let numbers: Option<Vec<i64>> = self.frames.iter().map(|frame| frame.timestamp_micros).collect();
        times == TimestampSource::Given && numbers.is_some_and(|numbers| can_be_micros(&numbers))
    }

    /// Decodes the image of the frame at `position`.
    ///
    /// # Errors
    /// Those of [`Frame::decode`]; [`SceneError::NoImage`] for a position past the last frame.
    pub fn decode(&self, position: usize, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        self.frame(position)?.decode(&self.key, position, limits)
    }

    /// [`Self::decode`] without the check that the image fits its camera, for diagnostics.
    ///
    /// # Errors
    /// Those of [`Self::decode`] except [`SceneError::ImageMismatch`].
    pub fn decode_any_shape(&self, position: usize, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        self.frame(position)?.decode_any_shape(&self.key, position, limits)
    }

    fn frame(&self, position: usize) -> Result<&Frame, SceneError> {
        let no_frame = || SceneError::NoImage {
            scene: self.key.clone(),
            frame: position,
            reason: format!("the scene has {} frames", self.frames.len()),
        };
        self.frames.get(position).ok_or_else(no_frame)
    }
}

impl Frame {
    /// Decodes the image. `scene` and `position` identify the frame in messages.
    ///
    /// # Errors
    /// [`SceneError::NoImage`], [`SceneError::NoPose`], [`SceneError::Io`], [`SceneError::LfsPointer`], [`SceneError::Damaged`],
    /// [`SceneError::Pixels`] for bytes that are not an image or exceed `limits`, and [`SceneError::ImageMismatch`] for an
    /// image that does not fit the frame's camera.
    pub fn decode(&self, scene: &str, position: usize, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        let image = self.decode_any_shape(scene, position, limits)?;
        match self.mismatch(ImageSize { width: image.width(), height: image.height() }) {
            Some(source) if source.is_fatal() => {
                Err(SceneError::ImageMismatch { scene: scene.to_owned(), frame: position, source })
            }
            _ => Ok(image),
        }
    }

    /// [`Self::decode`] without the check that the image fits the frame's camera.
    ///
    /// # Errors
    /// Those of [`Self::decode`] except [`SceneError::ImageMismatch`].
    pub fn decode_any_shape(&self, scene: &str, position: usize, limits: &DecodeLimits) -> Result<ImageU8, SceneError> {
        if let FrameImage::Generated(image) = &self.image {
            return image.make(limits);
        }
        self.decode_bytes(&self.bytes(scene, position)?, scene, position, limits)
    }

    /// Decodes the result of [`Self::bytes`].
    ///
    /// # Errors
    /// [`SceneError::Pixels`] for bytes that are not an image or exceed `limits`.
    pub fn decode_bytes(
        &self,
        bytes: &[u8],
        scene: &str,
        position: usize,
        limits: &DecodeLimits,
    ) -> Result<ImageU8, SceneError> {
        atsplat_pixels::decode(bytes, limits).map_err(self.in_frame(scene, position))
    }

    /// The encoded image: read from its file, borrowed from its chunk, or generated within the default limits and encoded as PNG.
    ///
    /// # Errors
    /// [`SceneError::NoImage`], [`SceneError::NoPose`], [`SceneError::Io`], [`SceneError::Damaged`],
    /// [`SceneError::Generating`].
    pub fn bytes(&self, scene: &str, position: usize) -> Result<Cow<'_, [u8]>, SceneError> {
        let no_image = |reason: String| SceneError::NoImage { scene: scene.to_owned(), frame: position, reason };
        match &self.image {
            FrameImage::File(path) => Ok(Cow::Owned(read_file("reading an image", path)?)),
            FrameImage::Encoded(bytes) => {
                let damaged = |source| {
                    let (scene, place) = (scene.to_owned(), self.image.place());
                    SceneError::Damaged { scene, frame: position, source: Box::new(source), place }
                };
                bytes.verify().map_err(damaged)?;
                Ok(Cow::Borrowed(bytes))
            }
            FrameImage::Generated(image) => {
                let image = image.make(&DecodeLimits::default())?;
                atsplat_pixels::encode_png(&image).map(Cow::Owned).map_err(self.in_frame(scene, position))
            }
            FrameImage::Absent => Err(no_image("the source has no images".to_owned())),
            FrameImage::Missing(path) => Err(no_image(format!("the file is missing ({})", path.display()))),
            FrameImage::Ambiguous(_) => Err(no_image(format!("several files may be it ({})", self.image.place()))),
            FrameImage::Unposed { reason, .. } => Err(no_pose(scene, position, reason)),
        }
    }

    /// The image's size, from its header.
    ///
    /// # Errors
    /// Those of [`Self::decode`] except [`SceneError::ImageMismatch`].
    pub fn size(&self, scene: &str, position: usize) -> Result<ImageSize, SceneError> {
        self.header(scene, position).map(|header| header.size)
    }

    /// The image's header.
    ///
    /// # Errors
    /// Those of [`Self::size`].
    pub fn header(&self, scene: &str, position: usize) -> Result<ImageHeader, SceneError> {
        self.header_by(scene, position, header_of)
    }

    /// The header of an image, unless [`Self::decode`] refuses an image of its size, which a damaged header may state. Generated images
    /// have no limits.
    ///
    /// # Errors
    /// Those of [`Self::header`]; [`SceneError::Pixels`] for a file beyond `limits`.
    pub fn header_within(
        &self,
        scene: &str,
        position: usize,
        limits: &DecodeLimits,
    ) -> Result<ImageHeader, SceneError> {
        self.header_by(scene, position, |bytes| {
            atsplat_pixels::size_within(bytes, limits)?;
            header_of(bytes)
        })
    }

    fn header_by(
        &self,
        scene: &str,
        position: usize,
        read: impl Fn(&[u8]) -> Result<ImageHeader, PixelError>,
    ) -> Result<ImageHeader, SceneError> {
        match &self.image {
            FrameImage::File(path) => header_of_file(path, read, self.in_frame(scene, position)),
            FrameImage::Generated(image) => Ok(image.header()),
            _ => read(&self.bytes(scene, position)?).map_err(self.in_frame(scene, position)),
        }
    }

    fn in_frame(&self, scene: &str, position: usize) -> impl FnOnce(PixelError) -> SceneError {
        in_frame(scene, position, &self.image)
    }
}

/// [`SceneError::Pixels`] for `map_err`.
pub(crate) fn in_frame(scene: &str, frame: usize, image: &FrameImage) -> impl FnOnce(PixelError) -> SceneError {
    let scene = scene.to_owned();
    move |source| SceneError::Pixels { scene, frame, source, place: image.place() }
}

/// Size of the image in a file, from its header.
pub(crate) fn size_of_file(path: &Path, error: impl FnOnce(PixelError) -> SceneError) -> Result<ImageSize, SceneError> {
    header_of_file(path, header_of, error).map(|header| header.size)
}

fn header_of_file(
    path: &Path,
    read: impl Fn(&[u8]) -> Result<ImageHeader, PixelError>,
    error: impl FnOnce(PixelError) -> SceneError,
) -> Result<ImageHeader, SceneError> {
    let action = "reading an image's header";
    let start = read_start(action, path, LIKELY_HEADER)?;
    if reaches_pixels(&start)
        && let Ok(header) = read(&start)
    {
        return Ok(header);
    }
    // Colour profiles and previews can precede a JPEG's size, so no fixed length suffices.
    read(&read_file(action, path)?).map_err(error)
}

/// Whether nothing of an image's header can follow its start, if its size is there.
fn reaches_pixels(start: &[u8]) -> bool {
    match ImageFormat::sniff(start) {
        // It stores EXIF at the end.
        Some(ImageFormat::WebP) => false,
        // A colour profile or text of any length can precede a transparent colour.
        Some(ImageFormat::Png) => png_chunks(start).any(|(name, _)| name == b"IDAT"),
        _ => true,
    }
}

fn header_of(bytes: &[u8]) -> Result<ImageHeader, PixelError> {
    let (width, height) = atsplat_pixels::size_of(bytes)?;
    Ok(ImageHeader {
        size: ImageSize { width, height },
        orientation: Orientation::of(bytes),
        has_alpha: atsplat_pixels::has_alpha(bytes),
        has_16_bits: atsplat_pixels::has_16_bits(bytes),
        has_other_encoding: atsplat_pixels::has_other_encoding(bytes),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_times_if_they_are_a_thousandth_of_a_second_apart() {
        assert!(can_be_micros(&[]) && can_be_micros(&[7]));
        assert!(can_be_micros(&[0, 1_500, 2_000]) && !can_be_micros(&[0, 1_500, 1_999]));
        assert!(can_be_micros(&[5, i64::MIN, i64::MAX]), "a span beyond 63 bits");
    }

    #[test]
    fn another_encoding_is_read_from_the_header() {
        let png = atsplat_pixels::encode_png(&ImageU8::new(2, 1, vec![5; 6]).unwrap()).unwrap();
        let (start, pixels) = png.split_at(33);
        let chunk = |name: &[u8; 4], data: &[u8]| {
            let length = u32::try_from(data.len()).unwrap().to_be_bytes();
            [&length[..], name, data, b"crc."].concat()
        };
        let [linear, usual] = [100_000u32, 45_455].map(|gamma| chunk(b"gAMA", &gamma.to_be_bytes()));
        let [hlg, srgb] = [18, 13].map(|transfer| chunk(b"cICP", &[9, transfer, 0, 1]));
        let is_other = |parts: &[&[u8]]| header_of(&parts.concat()).unwrap().has_other_encoding;
        assert_eq!(
            [&linear, &usual, &hlg, &srgb].map(|chunk| is_other(&[start, chunk, pixels])),
            [true, false, true, false]
        );
        assert!(!is_other(&[start, pixels]));
        assert!(!is_other(&[start, pixels, &linear]), "after the pixels it says nothing");
    }

    #[test]
    fn a_transparent_colour_after_long_text_is_found() {
        let png = atsplat_pixels::encode_png(&ImageU8::new(2, 1, vec![5; 6]).unwrap()).unwrap();
        let (start, pixels) = png.split_at(33);
        let text = [&70_000_u32.to_be_bytes()[..], b"tEXt", &b"a".repeat(70_000), b"crc."].concat();
        let transparent = &b"\0\0\0\x06tRNS\0\x05\0\x05\0\x05crc."[..];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let has_alpha = |parts: &[&[u8]]| {
            std::fs::write(&path, parts.concat()).unwrap();
            header_of_file(&path, header_of, in_frame("a", 0, &FrameImage::Absent)).unwrap().has_alpha
        };
        assert!(has_alpha(&[start, &text, transparent, pixels]));
        assert!(!has_alpha(&[start, &text, pixels]));
        assert!(!has_alpha(&[start, pixels, transparent, &text]), "after the pixels it says nothing");
    }
}
