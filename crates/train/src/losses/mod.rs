//! The paper's losses as functions of images: value and gradient, in closed form where one exists.
//!
//! A loss takes rendered images as plain values, and its gradient enters the graph at the renderer's output. So every term
//! is checked for NaN before anything is propagated, and a stop-gradient cannot leak: the error map of the uncertainty loss
//! has no graph behind it. On graphics adapters the losses are part of the graph instead ([`graph`]), and images stay there.
//!
//! Images are view by view, row by row, red, green, blue. The order of sums is fixed, so that results do not depend on the
//! number of threads.

mod d_ssim;
mod distance;
pub mod graph;
mod lpips;
mod mse;
mod perceptual;
mod uncertainty;

pub use d_ssim::{DSsim, d_ssim};
pub use distance::log_distance;
pub use lpips::LpipsLoss;
pub use mse::mse;
pub use perceptual::Perceptual;
pub use uncertainty::uncertainty;

/// Dimensions of a stack of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stack {
    /// Number of images.
    pub views: usize,
    /// Rows of each image.
    pub height: usize,
    /// Columns of each image.
    pub width: usize,
}

impl Stack {
    /// Pixels of one image.
    pub const fn pixels(self) -> usize {
        self.height * self.width
    }

    /// Number of values: three per pixel.
    pub const fn samples(self) -> usize {
        self.views * self.pixels() * 3
    }
}

/// A loss and its gradient with respect to the rendered images.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// Mean over all values.
    pub value: f64,
    /// One number per value of the images.
    pub gradient: Vec<f32>,
}

impl Loss {
    /// Adds `weight` times another loss of the same images.
    #[expect(clippy::cast_possible_truncation, reason = "weights are moderate numbers")]
    pub(crate) fn add(&mut self, other: &Self, weight: f64) {
        self.value += weight * other.value;
        let weight = weight as f32;
        self.gradient.iter_mut().zip(&other.gradient).for_each(|(sum, part)| *sum += weight * part);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 2 + ¼·8 and (1, −2) + ¼·(4, 12).
    #[test]
    fn value_and_gradient_are_added_with_the_same_weight() {
        let mut sum = Loss { value: 2.0, gradient: vec![1.0, -2.0] };
        sum.add(&Loss { value: 8.0, gradient: vec![4.0, 12.0] }, 0.25);
        assert_eq!(sum, Loss { value: 4.0, gradient: vec![2.0, 1.0] });
    }
}
