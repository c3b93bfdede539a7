use std::borrow::Cow;

use atsplat_pixels::Image;

use crate::{Mask, MetricError, NonFinite, Values};

/// A render and its ground truth: of equal, non-zero size and finite wherever they are compared.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    render: &'a Image,
    truth: &'a Image,
    mask: Option<&'a Mask>,
}

impl<'a> Pair<'a> {
    /// Pairs all pixels of both pictures.
    ///
    /// # Errors
    /// [`MetricError::SizeMismatch`], [`MetricError::Empty`], [`MetricError::NonFinite`] with the count.
    pub fn new(render: &'a Image, truth: &'a Image) -> Result<Self, MetricError> {
        Self { render, truth, mask: None }.checked()
    }

    /// Pairs the pixels in a mask. Samples outside it may have any value, including NaN.
    ///
    /// # Errors
    /// As [`Pair::new`] for the pixels in the mask, and [`MetricError::EmptyMask`].
    pub fn masked(render: &'a Image, truth: &'a Image, mask: &'a Mask) -> Result<Self, MetricError> {
        Self { render, truth, mask: Some(mask) }.checked()
    }

    fn checked(self) -> Result<Self, MetricError> {
        let (expected, truth) = (self.size(), [self.truth.width(), self.truth.height()]);
        let found = self.mask.map_or(expected, Mask::size);
        for (what, found) in [("truth", truth), ("mask", found)] {
            if found != expected {
                return Err(MetricError::SizeMismatch { what, expected, found });
            }
        }
        if expected.contains(&0) {
            return Err(MetricError::Empty { size: expected });
        }
        if self.mask.is_some_and(|mask| mask.count() == 0) {
            return Err(MetricError::EmptyMask { expected: "at least one pixel" });
        }
        let included = |pixel: usize| self.mask.is_none_or(|mask| mask.included().get(pixel) == Some(&true));
        let width = self.render.width() as usize;
        let non_finite = NonFinite::count(self.render.samples(), self.truth.samples(), width, included);
        if non_finite.total() > 0 { Err(MetricError::NonFinite(non_finite)) } else { Ok(self) }
    }

    /// Width and height.
    pub const fn size(&self) -> [u32; 2] {
        [self.render.width(), self.render.height()]
    }

    /// The render.
    pub const fn render(&self) -> &'a Image {
        self.render
    }

    /// The ground truth.
    pub const fn truth(&self) -> &'a Image {
        self.truth
    }

    /// The mask, if any.
    pub const fn mask(&self) -> Option<&'a Mask> {
        self.mask
    }

    /// Whether all compared samples are equal, before any clipping or rounding.
    pub fn is_identical(&self) -> bool {
        let [render, truth] = self.compared(Values::AsRendered);
        render == truth
    }

    /// All samples of both pictures, regardless of the mask.
    pub(crate) fn rows(&self, values: Values) -> [Cow<'a, [f32]>; 2] {
        [values.of(self.render.samples()), values.of(self.truth.samples())]
    }

    /// The compared samples of both pictures, contiguous: a crop and a mask of its rectangle give the same.
    pub(crate) fn compared(&self, values: Values) -> [Cow<'a, [f32]>; 2] {
        let Some(mask) = self.mask else { return self.rows(values) };
        [self.render, self.truth].map(|picture| {
            let pixels = picture.samples().as_chunks::<3>().0.iter().zip(mask.included());
            let inside: Vec<f32> = pixels.filter(|(_, included)| **included).flat_map(|(pixel, _)| *pixel).collect();
            Cow::Owned(values.of(&inside).into_owned())
        })
    }
}
