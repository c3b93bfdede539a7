//! The range of the samples in images of other programs.

use atsplat_numeric::Extremes as _;
use atsplat_pixels::Image;

/// Samples below the first or above the second are far outside [0, 1]: renderers that do not clamp overshoot by less.
const FAR: [f32; 2] = [-0.5, 2.0];
/// One sample in this many may be far outside: a highlight of a renderer that does not clamp is legitimate.
const ONE_IN: usize = 100;
/// As the Python package says it (`_arrays.py`).
const CAST: &str = "expected uint8 from 0 to 255, found only 0 and 1, as floats that were cast: multiply them by 255 before, or give \
                    floats in [0, 1]";
/// The largest sample of an image in 0…255, with some overshoot.
const BYTES: f32 = 256.0;
/// Samples below this are clearly negative. Renderers that do not clamp have some of them, at edges and in the dark; in −1…1 and
/// in −0.5…0.5 they are what is darker than 0.45 or 0.4, in most images more than one sample in this many.
const NEGATIVE: f32 = -0.1;
const NEGATIVE_ONE_IN: usize = 10;
/// The largest size of a sample of an image in −1…1, with some overshoot.
const SIGNED: f32 = 1.25;
/// The same of an image in −0.5…0.5.
const CENTRED: f32 = 0.625;

/// Rejects an image in another range than [0, 1]. Samples that are NaN or infinite are left to the comparison.
///
/// # Errors
/// The samples' range, and the range that they seem to be meant in.
pub fn check_range(image: &Image) -> Result<(), String> {
    let [least, most] = FAR;
    let finite = || image.samples().iter().copied().filter(|sample| sample.is_finite());
    let is_more = |count: usize, one_in: usize| count * one_in > image.samples().len();
    let is_far = is_more(finite().filter(|sample| !(least..=most).contains(sample)).count(), ONE_IN);
    let is_negative = is_more(finite().filter(|sample| *sample < NEGATIVE).count(), NEGATIVE_ONE_IN);
    if !is_far && !is_negative {
        return Ok(());
    }
    let smallest = finite().fold(f32::INFINITY, f32::minimum_of);
    let largest = finite().fold(f32::NEG_INFINITY, f32::maximum_of);
    let seems = if is_negative && smallest >= -CENTRED && largest <= CENTRED {
        ", which seems to be −0.5…0.5: add 0.5"
    } else if is_far && smallest >= least && largest <= BYTES {
        ", which seems to be 0…255: divide by 255"
    } else if smallest >= -SIGNED && largest <= SIGNED {
        ", which seems to be −1…1: take (sample + 1) / 2"
    } else {
        ""
    };
    Err(format!("expected samples in [0, 1], found {smallest:.2}…{largest:.2}{seems}"))
}

/// Rejects bytes that are 0 and 1 alone. Of images that are meant, only black ones are bytes like these.
///
/// # Errors
/// That they are probably floats that were cast.
pub(super) fn check_bytes(samples: &[u8]) -> Result<(), String> {
    if samples.iter().max() == Some(&1) { Err(CAST.to_owned()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(sample: impl Fn(usize) -> f32) -> Result<(), String> {
        check_range(&Image::new(20, 10, (0..600).map(sample).collect()).unwrap())
    }

    /// A ramp from 0 to 1.
    fn ramp(at: usize) -> f32 {
        at as f32 / 599.0
    }

    #[test]
    fn an_image_in_another_range_is_rejected_with_a_guess() {
        let refused = |sample: fn(f32) -> f32| check(|at| sample(ramp(at))).unwrap_err();
        assert_eq!(
            refused(|x| 255.0 * x),
            "expected samples in [0, 1], found 0.00…255.00, which seems to be 0…255: divide by 255"
        );
        assert_eq!(
            refused(|x| 2.0 * x - 1.0),
            "expected samples in [0, 1], found -1.00…1.00, which seems to be −1…1: take (sample + 1) / 2"
        );
        assert_eq!(
            refused(|x| x - 0.5),
            "expected samples in [0, 1], found -0.50…0.50, which seems to be −0.5…0.5: add 0.5"
        );
        let bright = "expected samples in [0, 1], found -0.40…1.00, which seems to be −1…1: take (sample + 1) / 2";
        assert_eq!(refused(|x| 1.4 * x - 0.4), bright, "no sample is darker than 0.3");
        assert_eq!(refused(|x| x - 2.0), "expected samples in [0, 1], found -2.00…-1.00");
        assert_eq!(refused(|x| 65535.0 * x), "expected samples in [0, 1], found 0.00…65535.00");
    }

    #[test]
    fn overshoots_and_single_highlights_stay() {
        assert_eq!(check(ramp), Ok(()));
        assert_eq!(check(|at| 2.3 * ramp(at) - 0.3), Ok(()), "−0.3 to 2");
        assert_eq!(check(|at| 0.6 * ramp(at) - 0.1), Ok(()), "black, with noise");
        assert_eq!(check(|at| ramp(at) - 0.18), Ok(()), "one sample in twelve is below −0.1");
        assert!(check(|at| ramp(at) - 0.22).is_err(), "one in eight");
        let with = |count: usize, value: f32| check(move |at| if at < count { value } else { ramp(at) });
        assert_eq!(with(6, 40.0), Ok(()), "one sample in a hundred");
        assert!(with(7, 40.0).is_err() && with(7, -0.6).is_err());
        assert_eq!(with(600, f32::NAN), Ok(()));
        assert_eq!(with(300, f32::INFINITY), Ok(()));
    }
}
