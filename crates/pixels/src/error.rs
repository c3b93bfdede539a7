use std::error::Error as StdError;

use thiserror::Error;

use crate::ImageFormat;

/// Why an image cannot be decoded, processed or encoded.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum PixelError {
    /// The number of samples does not match the size.
    #[error("{width}×{height} RGB needs {expected} samples, found {found}")]
    SampleCount {
        width: u32,
        height: u32,
        /// `width · height · 3`.
        expected: u64,
        found: usize,
    },
    /// The first bytes are not those of a supported format.
    #[error("expected a PNG, JPEG, WebP or EXR file, found {length} bytes that start with [{start}]")]
    UnknownFormat {
        /// Up to eight first bytes in hexadecimal.
        start: String,
        length: usize,
    },
    /// The file is a Git LFS pointer: the content was not fetched.
    #[error("expected an image, found a Git LFS pointer to it: run `git lfs pull` in its repository")]
    LfsPointer,
    /// An image that must be opaque has transparent pixels.
    #[error(
        "expected an opaque image, found {count} transparent pixels, the first at column {column}, row {row}: \
    composite it over the background of the comparison"
    )]
    Transparent { count: usize, column: usize, row: usize },
    /// A render's stored samples are not the image that is to be compared.
    #[error("expected {expected}, found {found}: {remedy}")]
    UnusableRender { expected: &'static str, found: String, remedy: &'static str },
    /// The file contains floats, not 8-bit samples.
    #[error("expected 8-bit samples, found an EXR of floats: read it with the exr functions")]
    HoldsFloats,
    /// The header is truncated or inconsistent.
    #[error("{format} header: {problem}")]
    Header { format: ImageFormat, problem: String },
    /// The image is larger than the caller's [`DecodeLimits`](crate::DecodeLimits).
    #[error("{format} of {width}×{height}: {what} of at most {limit} allowed, found {found}")]
    OverLimit {
        format: ImageFormat,
        width: u32,
        height: u32,
        /// Which limit: `width`, `height` or `decoded bytes`.
        what: &'static str,
        limit: u64,
        found: u64,
    },
    /// The header declares more pixels than a file of this length can hold.
    #[error("{format} of {width}×{height} does not fit into a file of {length} bytes")]
    FileTooShort { format: ImageFormat, width: u32, height: u32, length: usize },
    /// The file is valid, but uses an unsupported feature.
    #[error("{format}: {feature} is not supported")]
    Unsupported { format: ImageFormat, feature: String },
    /// The data after the header is corrupt or truncated.
    #[error("{format} data: {source}")]
    Decode { format: ImageFormat, source: Box<dyn StdError + Send + Sync> },
    /// An image could not be encoded.
    #[error("writing {format}: {source}")]
    Encode { format: ImageFormat, source: Box<dyn StdError + Send + Sync> },
    /// A width or height is zero.
    #[error("{what}: expected at least one pixel, found {width}×{height}")]
    Empty { what: &'static str, width: u32, height: u32 },
    /// An image of this size does not fit into memory.
    #[error("{what} of {width}×{height} does not fit into memory")]
    TooLarge { what: &'static str, width: u64, height: u64 },
    /// A crop is not inside the image.
    #[error("crop of {width}×{height} at column {column}, row {row} does not fit into {image_width}×{image_height}")]
    CropOutside { column: u32, row: u32, width: u32, height: u32, image_width: u32, image_height: u32 },
    /// A frame does not have the size of its animation.
    #[error("frame of an animation: expected {}×{}, found {}×{}", expected.0, expected.1, found.0, found.1)]
    FrameSize { expected: (u32, u32), found: (u32, u32) },
    /// An animation has more or fewer frames than its header declares.
    #[error("animation: expected {expected} frames, found {found}")]
    FrameCount { expected: u32, found: u32 },
    /// A JPEG quality outside its range.
    #[error("JPEG quality: expected 1 to 100, found {found}")]
    Quality { found: u8 },
    /// Samples that are NaN or infinite cannot be converted to 8 bits.
    #[error("{count} samples are NaN or infinite, the first at column {column}, row {row}, channel {channel}")]
    NonFinite {
        count: usize,
        column: usize,
        row: usize,
        /// Channel of the first: 0 red, 1 green, 2 blue.
        channel: usize,
    },
    /// An invalid name of an EXR channel.
    #[error("channel {name:?}: {problem}")]
    ChannelName { name: String, problem: &'static str },
    /// A channel does not have the size of its image.
    #[error("channel {name:?}: expected {expected} samples, found {found}")]
    ChannelSize {
        name: String,
        /// `width · height`.
        expected: u64,
        found: usize,
    },
    /// A `.npy` file does not have the expected array.
    #[error("expected {expected}, found {found}")]
    Npy { expected: String, found: String },
    /// An EXR does not have a channel.
    #[error("expected a channel {expected:?}, found {found:?}")]
    MissingChannel { expected: String, found: Vec<String> },
}
