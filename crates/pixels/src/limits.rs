use crate::{ImageFormat, PixelError};

/// Limits of decoded images, checked against the header before anything is allocated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DecodeLimits {
    /// Maximum columns.
    pub max_width: u32,
    /// Maximum rows.
    pub max_height: u32,
    /// Maximum bytes of samples, as stored in the file or as returned, whichever is more (16-bit RGBA counts 8 bytes per
    /// pixel). A decoder's own working memory is additional: up to twice as much for a progressive JPEG.
    pub max_bytes: u64,
}

impl Default for DecodeLimits {
    /// At most 16384×16384 and 256 MiB of samples: 89 megapixels of RGB, over ten times DL3DV's original 4K captures.
    fn default() -> Self {
        Self { max_width: 16_384, max_height: 16_384, max_bytes: 256 << 20 }
    }
}

impl DecodeLimits {
    /// An error for an image that exceeds the limits.
    pub(crate) fn check(
        &self,
        format: ImageFormat,
        (width, height): (u32, u32),
        bytes_per_pixel: u64,
    ) -> Result<(), PixelError> {
        if let Some((what, limit, found)) = self.exceeded((width, height), bytes_per_pixel) {
            return Err(PixelError::OverLimit { format, width, height, what, limit, found });
        }
        Ok(())
    }

    /// The first limit that an image exceeds: what it limits, what is allowed and what was found.
    pub(crate) fn exceeded(
        &self,
        (width, height): (u32, u32),
        bytes_per_pixel: u64,
    ) -> Option<(&'static str, u64, u64)> {
        let bytes = (u64::from(width) * u64::from(height)).saturating_mul(bytes_per_pixel);
        let checks = [
            ("width", u64::from(self.max_width), u64::from(width)),
            ("height", u64::from(self.max_height), u64::from(height)),
            ("decoded bytes", self.max_bytes, bytes),
        ];
        checks.into_iter().find(|(_, limit, found)| found > limit)
    }
}

/// An empty vector with capacity for `width · height · each` values; an error instead of an abort if it does not fit into
/// memory.
pub(crate) fn reserved<T>(what: &'static str, width: u64, height: u64, each: u64) -> Result<Vec<T>, PixelError> {
    let mut values = Vec::new();
    match length(width, height, each).map(|length| values.try_reserve_exact(length)) {
        Some(Ok(())) => Ok(values),
        Some(Err(_)) | None => Err(PixelError::TooLarge { what, width, height }),
    }
}

/// [`reserved`], filled with zeros.
pub(crate) fn zeroed<T: Copy + Default>(
    what: &'static str,
    width: u64,
    height: u64,
    each: u64,
) -> Result<Vec<T>, PixelError> {
    let mut values = reserved(what, width, height, each)?;
    let length = length(width, height, each).ok_or(PixelError::TooLarge { what, width, height })?;
    values.resize(length, T::default());
    Ok(values)
}

fn length(width: u64, height: u64, each: u64) -> Option<usize> {
    usize::try_from(width.checked_mul(height)?.checked_mul(each)?).ok()
}
