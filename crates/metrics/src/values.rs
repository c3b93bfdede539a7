use std::borrow::Cow;

use atsplat_pixels::{Image, Rounding};
use serde::{Deserialize, Serialize};

/// Conversion of both images' samples before they are compared; part of a metric's convention.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Values {
    /// None: a render's samples may be outside [0, 1].
    AsRendered,
    /// Clipped to [0, 1].
    Clipped,
    /// Clipped, rounded to 8 bits and converted back (`v / 255` in f32).
    EightBit(Rounding),
}

impl Values {
    /// The converted image.
    #[expect(clippy::expect_used, reason = "the number of samples does not change")]
    pub(crate) fn image(self, image: &Image) -> Image {
        let samples = self.converted(image.samples()).into_owned();
        Image::new(image.width(), image.height(), samples).expect("as many samples as the original")
    }

    /// The converted samples.
    pub(crate) fn converted(self, samples: &[f32]) -> Cow<'_, [f32]> {
        let clip = |sample: &f32| sample.clamp(0.0, 1.0);
        match self {
            Self::AsRendered => Cow::Borrowed(samples),
            Self::Clipped => samples.iter().map(clip).collect(),
            Self::EightBit(Rounding::Truncate) => {
                samples.iter().map(|sample| (clip(sample) * 255.0).floor() / 255.0).collect()
            }
            Self::EightBit(Rounding::Nearest) => {
                samples.iter().map(|sample| (clip(sample) * 255.0 + 0.5).floor() / 255.0).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn eight_bit_values_equal_a_round_trip_through_bytes() {
        let samples: Vec<f32> = (-300i16..3000).map(|i| f32::from(i) / 2500.0).collect();
        let image = Image::new(1100, 1, samples.clone()).unwrap();
        for rounding in [Rounding::Truncate, Rounding::Nearest] {
            let read = Image::from_u8(&image.to_u8(rounding).unwrap());
            let found = Values::EightBit(rounding).converted(&samples);
            let [found, expected] = [&*found, read.samples()].map(|v| v.iter().copied().map(f64::from));
            Tolerance::EXACT.assert(found, expected, "8 bits");
        }
    }

    #[test]
    fn clipping_keeps_values_inside_the_range() {
        let clipped = Values::Clipped.converted(&[-0.5, 0.25, 1.5]).iter().copied().map(f64::from).collect::<Vec<_>>();
        Tolerance::EXACT.assert(clipped, [0.0, 0.25, 1.0], "clipped");
        assert!(matches!(Values::AsRendered.converted(&[2.0]), Cow::Borrowed([..])));
    }
}
