#[cfg(target_arch = "x86_64")]
mod avx2;
mod coefficients;
mod passes;

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::limits::zeroed;
use crate::{ImageU8, PixelError};
use coefficients::Coefficients;
use passes::Level;

/// The resampling kernel of [`resize`], as in Pillow `src/libImaging/Resample.c`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// `sinc(x) · sinc(x/3)` within three pixels, as used by pixelSplat and its descendants (pixelSplat
    /// `src/dataset/shims/crop_shim.py`).
    Lanczos,
    /// A triangle of one pixel on either side, widened by the scale when shrinking (antialiased, unlike OpenCV's bilinear).
    Bilinear,
    /// The mean over the source area of each target pixel.
    Box,
}

/// Resamples to `width × height`, bit for bit like Pillow's `Image.resize((width, height), filter)` of an RGB image.
///
/// Weights are computed in f64, quantised to 22 fractional bits, and applied in a horizontal pass that rounds to 8 bits,
/// then in a vertical one; a pass that does not change the size is skipped, so the same size is a copy. Enlarging uses
/// the kernel at its own width (Pillow `src/libImaging/Resample.c`, `precompute_coeffs`).
///
/// The reference is Pillow up to 12.2, which produced the field's numbers. Pillow 12.3 and 13.0 run the vertical pass
/// first for some images that shrink more in height than in width (Pillow #9524, #9549) and round differently there;
/// for the sizes of the published protocols all versions agree.
///
/// # Errors
/// [`PixelError::Empty`] if either size is zero, [`PixelError::TooLarge`] if the result does not fit into memory.
pub fn resize(image: &ImageU8, width: u32, height: u32, filter: Filter) -> Result<ImageU8, PixelError> {
    resize_at(Level::fastest(), image, width, height, filter)
}

fn resize_at(level: Level, image: &ImageU8, width: u32, height: u32, filter: Filter) -> Result<ImageU8, PixelError> {
    for (what, width, height) in [("resize from", image.width, image.height), ("resize to", width, height)] {
        if width == 0 || height == 0 {
            return Err(PixelError::Empty { what, width, height });
        }
    }
    let mut resized = Cow::Borrowed(image);
    if width != image.width {
        let columns = Coefficients::new(image.width, width, filter)?;
        let mut samples = zeroed("resized image", width.into(), image.height.into(), 3)?;
        passes::horizontal(level, &image.samples, image.width as usize * 3, &columns, &mut samples);
        resized = Cow::Owned(ImageU8 { width, height: image.height, samples });
    }
    if height != image.height {
        let rows = Coefficients::new(image.height, height, filter)?;
        let mut samples = zeroed("resized image", width.into(), height.into(), 3)?;
        passes::vertical(level, &resized.samples, width as usize * 3, &rows, &mut samples);
        resized = Cow::Owned(ImageU8 { width, height, samples });
    }
    Ok(resized.into_owned())
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::SplitMix64;
    use proptest::prelude::*;

    use super::*;

    const FILTERS: [Filter; 3] = [Filter::Lanczos, Filter::Bilinear, Filter::Box];

    fn image() -> impl Strategy<Value = ImageU8> {
        (1..90u32, 1..90u32, any::<u64>(), any::<bool>()).prop_map(|(width, height, seed, extreme)| {
            let mut random = SplitMix64::new(seed);
            let mut next = || {
                let byte = random.next_u64().to_be_bytes()[0];
                if extreme { (byte >> 7) * 255 } else { byte }
            };
            ImageU8 { width, height, samples: (0..width * height * 3).map(|_| next()).collect() }
        })
    }

    proptest! {
        #[test]
        fn all_levels_give_the_same_bits(
            image in image(), width in 1..120u32, height in 1..120u32, filter in prop::sample::select(&FILTERS[..]),
        ) {
            let portable = resize_at(Level::Portable, &image, width, height, filter).unwrap();
            for level in Level::available() {
                prop_assert_eq!(&resize_at(level, &image, width, height, filter).unwrap(), &portable, "{:?}", level);
            }
        }

        #[test]
        fn a_constant_image_stays_constant(
            colour in any::<[u8; 3]>(), size in (1..70u32, 1..70u32), target in (1..90u32, 1..90u32),
            filter in prop::sample::select(&FILTERS[..]),
        ) {
            let samples = colour.repeat((size.0 * size.1) as usize);
            let image = ImageU8 { width: size.0, height: size.1, samples };
            let resized = resize(&image, target.0, target.1, filter).unwrap();
            prop_assert!(resized.samples.as_chunks::<3>().0.iter().all(|pixel| *pixel == colour));
        }

        #[test]
        fn resizing_commutes_with_mirroring(image in image(), filter in prop::sample::select(&[Filter::Lanczos, Filter::Bilinear][..])) {
            // With powers of two the kernel's sampling positions are exact, so left and right agree.
            let (width, height) = (image.width * 2, image.height);
            let there = resize(&mirrored(&image), width, height, filter).unwrap();
            prop_assert_eq!(there, mirrored(&resize(&image, width, height, filter).unwrap()));
        }
    }

    fn mirrored(image: &ImageU8) -> ImageU8 {
        let rows = image.samples.chunks_exact(image.width as usize * 3);
        let samples = rows.flat_map(|row| row.as_chunks::<3>().0.iter().rev().flatten().copied()).collect();
        ImageU8 { samples, ..*image }
    }

    #[test]
    fn the_same_size_is_a_copy_and_an_empty_size_an_error() {
        let image = ImageU8 { width: 2, height: 1, samples: vec![1, 2, 3, 250, 251, 252] };
        for filter in FILTERS {
            assert_eq!(resize(&image, 2, 1, filter).unwrap(), image);
            assert!(matches!(resize(&image, 0, 1, filter), Err(PixelError::Empty { what: "resize to", .. })));
        }
        let nothing = ImageU8 { width: 0, height: 4, samples: vec![] };
        assert!(matches!(resize(&nothing, 2, 2, Filter::Box), Err(PixelError::Empty { what: "resize from", .. })));
    }

    #[test]
    fn a_target_that_exceeds_memory_is_an_error() {
        let image = ImageU8 { width: 1, height: 1, samples: vec![1, 2, 3] };
        let outcome = resize(&image, u32::MAX, u32::MAX, Filter::Box);
        assert!(matches!(outcome, Err(PixelError::TooLarge { .. })), "{outcome:?}");
    }
}
