use std::borrow::Cow;

use atsplat_pixels::Image;

use crate::{MetricError, NonFinite, Values};

/// A render and its ground truth: of equal, non-zero size and finite.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    render: &'a Image,
    truth: &'a Image,
}

impl<'a> Pair<'a> {
    /// Pairs two images.
    ///
    /// # Errors
    /// [`MetricError::SizeMismatch`], [`MetricError::Empty`], [`MetricError::NonFinite`] with the count.
    pub fn new(render: &'a Image, truth: &'a Image) -> Result<Self, MetricError> {
        let (expected, found) = ([render.width(), render.height()], [truth.width(), truth.height()]);
        if found != expected {
            return Err(MetricError::SizeMismatch { expected, found });
        }
        if expected.contains(&0) {
            return Err(MetricError::Empty { size: expected });
        }
        let non_finite = NonFinite::count(render.samples(), truth.samples(), render.width() as usize);
        if non_finite.total() > 0 { Err(MetricError::NonFinite(non_finite)) } else { Ok(Self { render, truth }) }
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

    /// Whether all samples are equal, before any clipping or rounding.
    pub fn is_identical(&self) -> bool {
        self.render.samples() == self.truth.samples()
    }

    /// The samples of both images.
    pub(crate) fn rows(&self, values: Values) -> [Cow<'a, [f32]>; 2] {
        [values.converted(self.render.samples()), values.converted(self.truth.samples())]
    }
}
