use crate::{PictureFormat, PixelError};

/// What a header may ask for before anything is allocated.
///
/// Every limit is checked against the header, so a file of fifty bytes that promises 65535×65535
/// pixels costs nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DecodeLimits {
    /// Most columns.
    pub max_width: u32,
    /// Most rows.
    pub max_height: u32,
    /// Most bytes of decoded samples, counted as the file stores them or as they are handed out,
    /// whichever is more (an RGBA picture of 16 bits counts 8 bytes a pixel). A decoder's own
    /// working memory comes on top: up to twice as much again for a progressive JPEG.
    pub max_bytes: u64,
}

impl Default for DecodeLimits {
    /// 16384×16384 at most, and 256 MiB of samples: 89 megapixels of RGB, over ten times the 4K
    /// captures that DL3DV starts from.
    fn default() -> Self {
        Self { max_width: 16_384, max_height: 16_384, max_bytes: 256 << 20 }
    }
}

impl DecodeLimits {
    /// Whether a picture of this size may be decoded.
    pub(crate) fn check(
        &self,
        format: PictureFormat,
        (width, height): (u32, u32),
        bytes_per_pixel: u64,
    ) -> Result<(), PixelError> {
        let bytes = (u64::from(width) * u64::from(height)).saturating_mul(bytes_per_pixel);
        let checks = [
            ("width", u64::from(self.max_width), u64::from(width)),
            ("height", u64::from(self.max_height), u64::from(height)),
            ("decoded bytes", self.max_bytes, bytes),
        ];
        for (what, limit, found) in checks {
            if found > limit {
                return Err(PixelError::OverLimit { format, width, height, what, limit, found });
            }
        }
        Ok(())
    }
}
