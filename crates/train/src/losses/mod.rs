//! The paper's losses as functions of pictures: value and gradient, in closed form where there is one.
//!
//! A loss sees rendered pictures as plain numbers, and its gradient enters the graph at the splatter's output. So
//! every term can be checked for NaN before anything is propagated, and what a stop-gradient stops cannot leak: the
//! uncertainty's error map has no graph behind it.
//!
//! Pictures are view by view, row by row, red, green, blue. Sums run in one order, so that threads change no bit.

mod blur;
mod d_ssim;
mod learned;
mod mse;
mod perceptual;
mod uncertainty;

pub use d_ssim::{DSsim, d_ssim};
pub use learned::Learned;
pub use mse::mse;
pub use perceptual::Perceptual;
pub use uncertainty::uncertainty;

/// Views, rows and columns of a stack of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stack {
    /// Pictures.
    pub views: usize,
    /// Rows of each.
    pub height: usize,
    /// Columns of each.
    pub width: usize,
}

impl Stack {
    /// Pixels of one picture.
    pub const fn pixels(self) -> usize {
        self.height * self.width
    }

    /// Numbers in all, three a pixel.
    pub const fn samples(self) -> usize {
        self.views * self.pixels() * 3
    }
}

/// A loss and its derivative by every number of the rendered pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// Mean over all numbers.
    pub value: f64,
    /// As long as the pictures.
    pub gradient: Vec<f32>,
}

impl Loss {
    /// Adds `weight` times another loss of the same pictures.
    #[expect(clippy::cast_possible_truncation, reason = "weights are moderate numbers")]
    pub(crate) fn add(&mut self, other: &Self, weight: f64) {
        self.value += weight * other.value;
        let weight = weight as f32;
        self.gradient.iter_mut().zip(&other.gradient).for_each(|(sum, part)| *sum += weight * part);
    }
}
