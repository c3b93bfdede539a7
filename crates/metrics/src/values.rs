use std::borrow::Cow;

use atsplat_pixels::{Image, Rounding};
use serde::{Deserialize, Serialize};

/// What is done to the samples of both pictures before they are compared; a part of the convention.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Values {
    /// Nothing: a render's floats may leave [0, 1].
    AsRendered,
    /// Clipped to [0, 1].
    Clipped,
    /// Clipped, written to 8 bits and read again (`v / 255` in f32).
    EightBit(Rounding),
}

impl Values {
    /// The picture as it is compared.
    pub(crate) fn picture(self, picture: &Image) -> Image {
        let samples = self.of(picture.samples()).into_owned();
        // As many samples as before, so that there is nothing to refuse.
        Image::new(picture.width(), picture.height(), samples).unwrap_or_else(|_| picture.clone())
    }

    /// The samples as they are compared.
    pub(crate) fn of(self, samples: &[f32]) -> Cow<'_, [f32]> {
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
    fn eight_bits_are_those_of_a_written_and_read_picture() {
        let samples: Vec<f32> = (-300i16..3000).map(|i| f32::from(i) / 2500.0).collect();
        let picture = Image::new(1100, 1, samples.clone()).unwrap();
        for rounding in [Rounding::Truncate, Rounding::Nearest] {
            let read = Image::from_u8(&picture.to_u8(rounding).unwrap());
            let found = Values::EightBit(rounding).of(&samples);
            let [found, expected] = [&*found, read.samples()].map(|v| v.iter().copied().map(f64::from));
            Tolerance::EXACT.assert(found, expected, "8 bits");
        }
    }

    #[test]
    fn clipping_leaves_the_inside_alone() {
        let clipped = Values::Clipped.of(&[-0.5, 0.25, 1.5]).iter().copied().map(f64::from).collect::<Vec<_>>();
        Tolerance::EXACT.assert(clipped, [0.0, 0.25, 1.0], "clipped");
        assert!(matches!(Values::AsRendered.of(&[2.0]), Cow::Borrowed([..])));
    }
}
