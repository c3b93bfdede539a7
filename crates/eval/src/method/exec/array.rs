//! The images of an answer that are one array.

use std::path::Path;

use atsplat_pixels::Image;
use atsplat_pixels::npy::{self, NpyImages};

use crate::method::range::{check_bytes, check_range};

/// The images of a `.npy` file with the shape T×H×W×3: floats in [0, 1] with overshoots or bytes, of which not all may be 0 and 1
/// unless all are 0.
///
/// # Errors
/// What was expected and what was found, with the file's name.
pub(super) fn read_images(path: &Path, shape: [usize; 4]) -> Result<Vec<Image>, String> {
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let bytes = atsplat_files::read(path).map_err(|error| format!("{name}: {error}"))?;
    images(&bytes, shape).map_err(|error| format!("{name}: {error}"))
}

fn images(bytes: &[u8], shape: [usize; 4]) -> Result<Vec<Image>, String> {
    let NpyImages { images, bytes } = npy::read(bytes, shape).map_err(|error| error.to_string())?;
    bytes.map_or(Ok(()), check_bytes)?;
    for (at, image) in images.iter().enumerate() {
        check_range(image).map_err(|error| format!("image {at}: {error}"))?;
    }
    Ok(images)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An array of two images of one row and two columns.
    fn file(descr: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (2, 1, 2, 3), }}\n");
        let length = u16::try_from(header.len()).unwrap().to_le_bytes();
        [&b"\x93NUMPY\x01\x00"[..], &length, header.as_bytes(), data].concat()
    }

    #[test]
    fn floats_in_another_range_are_rejected() {
        let of = |sample: fn(f32) -> f32| {
            let values = (0..12u8).map(|at| if at < 6 { 0.0 } else { sample(f32::from(at) / 16.0) });
            let data: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
            images(&file("<f4", &data), [2, 1, 2, 3])
        };
        assert_eq!(of(|x| x * 1.5).unwrap().len(), 2);
        let levels = of(|x| x * 255.0).unwrap_err();
        assert!(levels.starts_with("image 1: ") && levels.contains("seems to be 0…255"), "{levels}");
        assert!(of(|x| -x - 1.0).unwrap_err().contains("expected samples in [0, 1], found -1.69…-1.38"));
    }

    #[test]
    fn floats_that_were_cast_to_bytes_are_rejected_and_black_stays() {
        let of = |bytes: [u8; 12]| images(&file("|u1", &bytes), [2, 1, 2, 3]);
        let mut bytes = [0; 12];
        assert!(of(bytes).unwrap().iter().flat_map(Image::samples).all(|sample| sample.to_bits() == 0), "black");
        bytes[7] = 1;
        let expected = "expected uint8 from 0 to 255, found only 0 and 1, as floats that were cast: multiply them by 255 before, or \
                        give floats in [0, 1]";
        assert_eq!(of(bytes), Err(expected.to_owned()));
        assert_eq!(of([1; 12]), Err(expected.to_owned()));
        bytes[0] = 2;
        assert!(of(bytes).is_ok(), "dark");
    }
}
