//! EXR files of f32 samples.
pub(crate) fn size(_bytes: &[u8]) -> Result<(u32, u32), crate::PixelError> {
    Err(crate::PixelError::HoldsFloats)
}
