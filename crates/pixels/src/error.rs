use std::error::Error as StdError;

use thiserror::Error;

use crate::PictureFormat;

/// Why bytes do not make a picture, or a picture cannot be changed as asked.
#[derive(Debug, Error)]
pub enum PixelError {
    /// The number of samples does not match the size.
    #[error("{width}×{height} RGB needs {expected} samples, found {found}")]
    SampleCount {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// `width · height · 3`.
        expected: u64,
        /// What was given.
        found: usize,
    },
    /// The first bytes are those of no format that is read here.
    #[error("expected a PNG, JPEG, WebP or EXR file, found {length} bytes that start with [{start}]")]
    UnknownFormat {
        /// Up to eight first bytes in hexadecimal.
        start: String,
        /// Length of the input in bytes.
        length: usize,
    },
    /// The file is what Git LFS leaves in the place of one that was not fetched.
    #[error(
        "expected a picture, found a Git LFS pointer to it: run `git lfs pull` in the repository that it came from"
    )]
    LfsPointer,
    /// Pixels that are not opaque, where the picture has to be.
    #[error(
        "expected an opaque picture, found {count} transparent pixels, the first at column {column}, row {row}: compose it \
         over the background that it is to be compared on"
    )]
    Transparent {
        /// Pixels whose alpha is not full.
        count: usize,
        /// Column of the first.
        column: usize,
        /// Row of the first.
        row: usize,
    },
    /// The file holds floats; 8-bit samples were asked for.
    #[error("expected 8-bit samples, found an EXR of floats: read it with the exr functions")]
    HoldsFloats,
    /// The header is cut short or contradicts itself.
    #[error("{format} header: {problem}")]
    Header {
        /// Format by its magic bytes.
        format: PictureFormat,
        /// What was expected and what was found.
        problem: String,
    },
    /// The picture is larger than the caller's [`DecodeLimits`](crate::DecodeLimits).
    #[error("{format} of {width}×{height}: {what} of at most {limit} allowed, found {found}")]
    OverLimit {
        /// Format by its magic bytes.
        format: PictureFormat,
        /// Columns, as the header says.
        width: u32,
        /// Rows, as the header says.
        height: u32,
        /// Which limit: `width`, `height` or `decoded bytes`.
        what: &'static str,
        /// The limit.
        limit: u64,
        /// What the header asks for.
        found: u64,
    },
    /// The header promises more pixels than a file of this length can hold.
    #[error("{format} of {width}×{height} does not fit into a file of {length} bytes")]
    FileTooShort {
        /// Format by its magic bytes.
        format: PictureFormat,
        /// Columns, as the header says.
        width: u32,
        /// Rows, as the header says.
        height: u32,
        /// Length of the file in bytes.
        length: usize,
    },
    /// The file is valid, but uses a feature that is not read here.
    #[error("{format}: {feature} is not supported")]
    Unsupported {
        /// Format by its magic bytes.
        format: PictureFormat,
        /// The feature, in words.
        feature: String,
    },
    /// The data behind the header are damaged or cut short.
    #[error("{format} data: {source}")]
    Decode {
        /// Format by its magic bytes.
        format: PictureFormat,
        /// What the decoder found.
        source: Box<dyn StdError + Send + Sync>,
    },
    /// A picture could not be written.
    #[error("writing {format}: {source}")]
    Encode {
        /// The format asked for.
        format: PictureFormat,
        /// What the encoder found.
        source: Box<dyn StdError + Send + Sync>,
    },
    /// A width or height is zero.
    #[error("{what}: expected at least one pixel, found {width}×{height}")]
    Empty {
        /// Which picture or rectangle.
        what: &'static str,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The machine cannot hold a picture of this size.
    #[error("{what} of {width}×{height}: expected a size that fits into memory")]
    TooLarge {
        /// Which picture.
        what: &'static str,
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
    },
    /// A crop reaches outside the picture.
    #[error(
        "crop of {width}×{height} at column {column}, row {row} does not fit into {picture_width}×{picture_height}"
    )]
    CropOutside {
        /// First column.
        column: u32,
        /// First row.
        row: u32,
        /// Columns of the crop.
        width: u32,
        /// Rows of the crop.
        height: u32,
        /// Columns of the picture.
        picture_width: u32,
        /// Rows of the picture.
        picture_height: u32,
    },
    /// A frame of another size than its animation.
    #[error("frame of an animation: expected {}×{}, found {}×{}", expected.0, expected.1, found.0, found.1)]
    FrameSize {
        /// Columns and rows of the animation.
        expected: (u32, u32),
        /// Columns and rows of the frame.
        found: (u32, u32),
    },
    /// An animation has more or fewer frames than its header says.
    #[error("animation: expected {expected} frames, found {found}")]
    FrameCount {
        /// Frames that the header says.
        expected: u32,
        /// Frames that were written.
        found: u32,
    },
    /// A JPEG quality outside its range.
    #[error("JPEG quality: expected 1 to 100, found {found}")]
    Quality {
        /// What was asked for.
        found: u8,
    },
    /// Samples that are NaN or infinite cannot become bytes.
    #[error("{count} samples are NaN or infinite, the first at column {column}, row {row}, channel {channel}")]
    NonFinite {
        /// How many.
        count: usize,
        /// Column of the first.
        column: usize,
        /// Row of the first.
        row: usize,
        /// Channel of the first: 0 red, 1 green, 2 blue.
        channel: usize,
    },
    /// A name that an EXR channel cannot have.
    #[error("channel {name:?}: {problem}")]
    ChannelName {
        /// The name.
        name: String,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A channel of another size than its picture.
    #[error("channel {name:?}: expected {expected} samples, found {found}")]
    ChannelSize {
        /// The channel.
        name: String,
        /// `width · height`.
        expected: u64,
        /// What was given.
        found: usize,
    },
    /// An EXR lacks a channel.
    #[error("expected a channel {expected:?}, found {found:?}")]
    MissingChannel {
        /// The channel asked for.
        expected: String,
        /// The channels that there are.
        found: Vec<String>,
    },
}
