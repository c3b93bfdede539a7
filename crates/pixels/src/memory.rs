use crate::PixelError;

/// Room for `width · height · each` values; an error instead of an abort where there is none.
pub(crate) fn reserved<T>(what: &'static str, width: u64, height: u64, each: u64) -> Result<Vec<T>, PixelError> {
    let mut values = Vec::new();
    match length(width, height, each).map(|length| values.try_reserve_exact(length)) {
        Some(Ok(())) => Ok(values),
        Some(Err(_)) | None => Err(PixelError::TooLarge { what, width, height }),
    }
}

/// As [`reserved`], filled with zeroes.
pub(crate) fn zeroed<T: Copy + Default>(
    what: &'static str,
    width: u64,
    height: u64,
    each: u64,
) -> Result<Vec<T>, PixelError> {
    let mut values = reserved(what, width, height, each)?;
    values.resize(length(width, height, each).unwrap_or_default(), T::default());
    Ok(values)
}

fn length(width: u64, height: u64, each: u64) -> Option<usize> {
    usize::try_from(width.checked_mul(height)?.checked_mul(each)?).ok()
}
