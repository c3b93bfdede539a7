//! Image gradients, scaled so that f32 sums over pixels neither overflow nor vanish.

use std::borrow::Cow;

use rayon::prelude::*;

use super::to_f32;
use crate::{ImageGradients, RenderOptions};

/// Gradients of the composited image, divided by a power of two.
///
/// The f32 sums multiply them by colours, depths and squared distances, and must neither overflow nor vanish. Scaling
/// by a power of two is exact except for overflow and underflow; it is undone in f64.
pub(crate) struct Scaled<'a> {
    pub(crate) images: Cow<'a, ImageGradients<f32>>,
    /// Factor by which sums have to be multiplied.
    pub(crate) unit: f64,
}

impl<'a> Scaled<'a> {
    /// `largest` is the largest magnitude of the gradients, which are finite.
    pub(crate) fn of(images: &'a ImageGradients<f32>, largest: f64, options: &RenderOptions) -> Self {
        // Magnitudes that need no scaling: sums reach up to 1e29 times as much, and 1e-20 of that is still significant.
        const FITTING: std::ops::RangeInclusive<f64> = 1e-15..=1e6;
        if options.exposure.is_none() && (largest == 0.0 || FITTING.contains(&largest)) {
            return Self { images: Cow::Borrowed(images), unit: 1.0 };
        }
        let exposed = |d_rgb: &[f32; 3]| options.composited_gradient(*d_rgb);
        let most = |d_rgb: &[f32; 3]| exposed(d_rgb).into_iter().map(f64::abs).fold(0.0, larger);
        let of_rgb = images.rgb.par_iter().map(most).reduce(|| 0.0, larger);
        let unit = power_of_two(larger(of_rgb, largest));
        let per = unit.recip();
        let image = |image: &Option<Vec<f32>>| {
            image.as_ref().map(|image| image.iter().map(|value| to_f32(f64::from(*value) * per)).collect())
        };
        let images = ImageGradients {
            rgb: images.rgb.par_iter().map(|d_rgb| exposed(d_rgb).map(|value| to_f32(value * per))).collect(),
            alpha: image(&images.alpha),
            depth: image(&images.depth),
            scalar: image(&images.scalar),
        };
        Self { images: Cow::Owned(images), unit }
    }

    /// Bytes of the scaled copy.
    pub(super) fn bytes(images: &ImageGradients<f32>) -> u64 {
        let length = |image: &Option<Vec<f32>>| image.as_ref().map_or(0, Vec::len);
        let values = 3 * images.rgb.len() + length(&images.alpha) + length(&images.depth) + length(&images.scalar);
        4 * values as u64
    }
}

const fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// The largest power of two not above a positive normal number; 1 for 0.
fn power_of_two(value: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff << 52;
    if value > 0.0 { f64::from_bits(value.to_bits() & EXPONENT) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scaled_copy_takes_the_bytes_that_are_reserved_for_it() {
        let images = ImageGradients {
            rgb: vec![[1e9; 3]; 5],
            alpha: Some(vec![2.0; 5]),
            depth: None,
            scalar: Some(vec![3.0; 5]),
        };
        let scaled = Scaled::of(&images, 1e9, &RenderOptions::default());
        assert!(matches!(scaled.images, Cow::Owned(_)));
        let copy = &*scaled.images;
        let planes = [&copy.alpha, &copy.depth, &copy.scalar].into_iter().flatten();
        let bytes = size_of_val(copy.rgb.as_slice()) + planes.map(|plane| size_of_val(plane.as_slice())).sum::<usize>();
        assert_eq!((Scaled::bytes(&images), bytes), (100, 100));
    }
}
