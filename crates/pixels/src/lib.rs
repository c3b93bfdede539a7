//! Bytes into pictures and back: decoding within limits, PNG, JPEG, WebP and EXR, Pillow-exact
//! resampling, crops, 8-bit rounding rules. Knows nothing of cameras or datasets.

mod error;
mod picture;

pub use error::PixelError;
pub use picture::{Image, ImageU8};
