use crate::{ImageU8, PixelError};

/// Crops to the rectangle of `width × height` pixels whose first pixel is at `column`, `row`.
///
/// The centre crops of the field start at `(size − crop) / 2` rounded down (pixelSplat
/// `src/dataset/shims/crop_shim.py`).
///
/// # Errors
/// [`PixelError::Empty`] for a crop without pixels, [`PixelError::CropOutside`] if it is not inside the image.
pub fn crop(image: &ImageU8, column: u32, row: u32, width: u32, height: u32) -> Result<ImageU8, PixelError> {
    if width == 0 || height == 0 {
        return Err(PixelError::Empty { what: "crop", width, height });
    }
    let (image_width, image_height) = (image.width(), image.height());
    let fits = |start: u32, length: u32, limit: u32| start.checked_add(length).is_some_and(|end| end <= limit);
    if !fits(column, width, image_width) || !fits(row, height, image_height) {
        return Err(PixelError::CropOutside { column, row, width, height, image_width, image_height });
    }
    let (first, length) = (column as usize * 3, width as usize * 3);
    let rows = image.samples().chunks_exact(image_width as usize * 3).skip(row as usize).take(height as usize);
    let samples = rows.flat_map(|samples| &samples[first..first + length]).copied().collect();
    ImageU8::new(width, height, samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(width: u8, height: u8) -> ImageU8 {
        let samples = (0..height).flat_map(|row| (0..width).flat_map(move |column| [column, row, 7])).collect();
        ImageU8::new(width.into(), height.into(), samples).unwrap()
    }

    #[test]
    fn pixels_are_copied_from_their_position() {
        let cropped = crop(&numbered(9, 7), 2, 3, 4, 3).unwrap();
        assert_eq!((cropped.width(), cropped.height()), (4, 3));
        for (column, row) in (0..3u8).flat_map(|row| (0..4u8).map(move |column| (column, row))) {
            assert_eq!(cropped.pixel(column.into(), row.into()), Some([column + 2, row + 3, 7]));
        }
    }

    #[test]
    fn crops_compose() {
        let image = numbered(40, 30);
        let twice = crop(&crop(&image, 5, 6, 20, 15).unwrap(), 3, 2, 10, 9).unwrap();
        assert_eq!(twice, crop(&image, 8, 8, 10, 9).unwrap());
    }

    #[test]
    fn the_full_crop_is_a_copy_and_larger_ones_are_errors() {
        let image = numbered(4, 3);
        assert_eq!(crop(&image, 0, 0, 4, 3).unwrap(), image);
        for (column, row, width, height) in
            [(1, 0, 4, 3), (0, 1, 4, 3), (u32::MAX, 0, 2, 2), (0, u32::MAX, 2, u32::MAX)]
        {
            let outcome = crop(&image, column, row, width, height);
            assert!(matches!(outcome, Err(PixelError::CropOutside { .. })), "{outcome:?}");
        }
        assert!(matches!(crop(&image, 0, 0, 0, 3), Err(PixelError::Empty { .. })));
    }
}
