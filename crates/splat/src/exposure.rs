use std::borrow::Cow;

use atsplat_numeric::Extremes as _;
use rayon::prelude::*;

use crate::{ImageGradients, LARGEST_CHANNEL, RenderOptions, Rendering, SplatError};

/// Exposure compensation: an affine map of composited colour, background included: `matrix · rgb + offset`.
///
/// 3DGS's exposure compensation multiplies a row vector from the left (`gaussian_renderer/__init__.py`), so that its
/// 3×4 array holds this matrix transposed; see [`Exposure::from_3dgs`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// One row per output channel; each entry at most [`LARGEST_CHANNEL`] in magnitude.
    pub matrix: [[f64; 3]; 3],
    /// Added to red, green and blue; at most [`LARGEST_CHANNEL`] in magnitude.
    pub offset: [f64; 3],
}

impl Exposure {
    /// Leaves colour unchanged.
    pub const IDENTITY: Self = Self { matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], offset: [0.0; 3] };

    /// From the 3×4 array that 3DGS trains: `out[j] = Σᵢ rgb[i] · array[i][j] + array[j][3]`.
    pub const fn from_3dgs([a, b, c]: [[f64; 4]; 3]) -> Self {
        let matrix = [[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]];
        Self { matrix, offset: [a[3], b[3], c[3]] }
    }

    /// The 3×4 array that [`Exposure::from_3dgs`] takes.
    pub const fn to_3dgs(&self) -> [[f64; 4]; 3] {
        let ([a, b, c], [red, green, blue]) = (self.matrix, self.offset);
        [[a[0], b[0], c[0], red], [a[1], b[1], c[1], green], [a[2], b[2], c[2], blue]]
    }

    /// Multiplies every channel by `gain`.
    pub const fn uniform(gain: f64) -> Self {
        Self { matrix: [[gain, 0.0, 0.0], [0.0, gain, 0.0], [0.0, 0.0, gain]], offset: [0.0; 3] }
    }

    /// The exposed colour.
    pub fn apply(&self, rgb: [f64; 3]) -> [f64; 3] {
        let mut seen = self.offset;
        for (sum, row) in seen.iter_mut().zip(self.matrix) {
            *sum += row.iter().zip(rgb).map(|(entry, channel)| entry * channel).sum::<f64>();
        }
        seen
    }

    /// Largest change of an output channel when every input channel changes by at most 1.
    pub fn gain(&self) -> f64 {
        let sums = self.matrix.iter().map(|row| row.iter().map(|entry| entry.abs()).sum::<f64>());
        sums.fold(0.0, f64::maximum_of)
    }

    /// Gradient of a loss with respect to this exposure, from the gradient of the exposed pixels and the pixels before
    /// exposure (a rendering with the same options and `exposure: None`).
    ///
    /// # Errors
    /// [`SplatError::Length`] if the two differ in length.
    pub fn gradient<T: Copy + Into<f64>>(composited: &[[T; 3]], d_rgb: &[[T; 3]]) -> Result<Self, SplatError> {
        if composited.len() != d_rgb.len() {
            return Err(SplatError::Length { field: "rgb gradient", expected: composited.len(), found: d_rgb.len() });
        }
        let mut sum = Self { matrix: [[0.0; 3]; 3], offset: [0.0; 3] };
        for (rgb, d_rgb) in composited.iter().zip(d_rgb) {
            for ((row, offset), d_channel) in sum.matrix.iter_mut().zip(&mut sum.offset).zip(d_rgb) {
                let d_channel: f64 = (*d_channel).into();
                *offset += d_channel;
                for (entry, channel) in row.iter_mut().zip(rgb) {
                    *entry += d_channel * (*channel).into();
                }
            }
        }
        Ok(sum)
    }

    /// Gradient of a loss with respect to a pixel before exposure, from that of the exposed pixel.
    pub fn composited_gradient<T: Into<f64>>(&self, d_exposed: [T; 3]) -> [f64; 3] {
        let [a, b, c] = self.matrix;
        let transposed = [[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]];
        Self { matrix: transposed, offset: [0.0; 3] }.apply(d_exposed.map(Into::into))
    }

    fn entries(&self) -> impl Iterator<Item = f64> {
        self.matrix.into_iter().flatten().chain(self.offset)
    }
}

/// Common to every backend: the check before anything else, exposure at the end of the forward pass and its gradient at
/// the start of the backward pass.
impl RenderOptions {
    /// # Errors
    /// As [`crate::RendererConstants::check`], and [`SplatError::Options`] for a background or exposure that is not
    /// finite or exceeds [`LARGEST_CHANNEL`].
    pub(crate) fn check(&self) -> Result<(), SplatError> {
        self.constants.check()?;
        let exposure = self.exposure.iter().flat_map(|exposure| exposure.entries().map(|entry| ("exposure", entry)));
        let mut numbers = self.background.into_iter().map(|channel| ("background", channel)).chain(exposure);
        match numbers.find(|(_, number)| !(number.abs() <= LARGEST_CHANNEL)) {
            Some((what, found)) => Err(SplatError::Options { what, found }),
            None => Ok(()),
        }
    }

    /// Applies the exposure to a composited image.
    pub(crate) fn expose<T>(&self, rendering: &mut Rendering<T>, number: impl Fn(f64) -> T + Copy + Sync)
    where
        T: Copy + Into<f64> + Send,
    {
        const CHUNK: usize = 1 << 14;
        if let Some(exposure) = &self.exposure {
            let pixels = rendering.rgb.par_iter_mut().with_min_len(CHUNK);
            pixels.for_each(|rgb| *rgb = exposure.apply(rgb.map(Into::into)).map(number));
        }
    }

    /// Gradients with respect to the composited image, from those of the exposed one.
    pub(crate) fn before_exposure<'a>(&self, images: &'a ImageGradients<f64>) -> Cow<'a, ImageGradients<f64>> {
        if self.exposure.is_none() {
            return Cow::Borrowed(images);
        }
        let rgb = images.rgb.iter().map(|d_rgb| self.composited_gradient(*d_rgb)).collect();
        Cow::Owned(ImageGradients { rgb, ..images.clone() })
    }

    /// As [`Self::before_exposure`] for one pixel.
    pub(crate) fn composited_gradient<T: Into<f64>>(&self, d_exposed: [T; 3]) -> [f64; 3] {
        let d_exposed = d_exposed.map(Into::into);
        self.exposure.map_or(d_exposed, |exposure| exposure.composited_gradient(d_exposed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    /// Computed with `np.matmul(rgb, e[:3, :3]) + e[:3, 3]`.
    #[test]
    fn converts_the_3dgs_array() {
        let array = [[1.1, 0.2, -0.1, 0.01], [0.05, 0.9, 0.3, -0.02], [0.0, -0.15, 1.2, 0.03]];
        let exposure = Exposure::from_3dgs(array);
        Tolerance::EXACT.assert(exposure.to_3dgs().into_iter().flatten(), array.into_iter().flatten(), "round trip");
        let seen = exposure.apply([0.5, 0.25, 0.75]);
        Tolerance::F64.assert(seen, [0.5725, 0.1925, 0.955], "exposed");
        Tolerance::F64.assert([exposure.gain()], [1.6], "row of blue");
        Tolerance::EXACT.assert(Exposure::uniform(2.0).apply([1.0, 0.5, 0.25]), [2.0, 1.0, 0.5], "twice as bright");
    }

    #[test]
    fn rejects_non_finite_options_by_name() {
        let dark = Exposure { offset: [0.0, f64::NAN, 0.0], ..Exposure::IDENTITY };
        let options = RenderOptions { exposure: Some(dark), ..RenderOptions::default() };
        assert!(matches!(options.check(), Err(SplatError::Options { what: "exposure", .. })));
        let options = RenderOptions { background: [0.0, 1e13, 0.0], ..RenderOptions::default() };
        assert!(matches!(options.check(), Err(SplatError::Options { what: "background", .. })));
    }
}
