//! Images: decoding within limits of PNG, JPEG, WebP and EXR, encoding of all but WebP, NumPy's arrays, Pillow-exact resampling,
//! crops, 8-bit rounding rules, the transfer function of sRGB, animated PNG. Independent of cameras and datasets.

mod animation;
mod crop;
mod decode;
mod encode;
mod error;
pub mod exr;
mod format;
mod images;
mod jpeg;
mod jpeg_segments;
mod limits;
pub mod npy;
mod orientation;
mod png_chunks;
mod preview;
mod render;
mod resize;
mod rounding;
mod size;
mod srgb;

pub use animation::AnimatedPng;
pub use crop::crop;
pub use decode::{decode, decode_over, decode_render};
pub use encode::{encode_jpeg, encode_png};
pub use error::PixelError;
pub use format::ImageFormat;
pub use images::{Image, ImageU8};
pub use jpeg::{JPEG_END, jpeg_has_end};
pub use limits::DecodeLimits;
pub use orientation::Orientation;
pub use png_chunks::png_chunks;
pub use preview::{Preview, preview_frame};
pub use render::has_other_encoding;
pub use resize::{Filter, resize};
pub use rounding::Rounding;
pub use size::{has_16_bits, has_alpha, size_of, size_within};
pub use srgb::Srgb;
