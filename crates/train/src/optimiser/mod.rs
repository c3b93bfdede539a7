//! `AdamW`, learning-rate schedule, gradient clipping and weight averaging, on plain arrays that a checkpoint stores exactly.

mod adam_w;
mod average;
mod schedule;

use rayon::prelude::*;

pub use adam_w::{AdamW, FlatMoments, Moments, Update};
pub use average::{average, warmed_up};
pub use schedule::Schedule;

/// Norm of all gradients as one vector, summed in f64, each alone and then all, in their order; NaN if one of them is NaN.
pub fn norm(gradients: &[Vec<f32>]) -> f64 {
    let square = |gradient: &Vec<f32>| gradient.iter().map(|g| f64::from(*g) * f64::from(*g)).sum::<f64>();
    let squares: Vec<f64> = gradients.par_iter().map(square).collect();
    squares.into_iter().sum::<f64>().sqrt()
}

/// Factor that clips gradients to a norm of at most `most`: PyTorch's `clip_grad_norm_`.
pub fn clip(norm: f64, most: f64) -> f64 {
    let scale = most / (norm + 1e-6);
    if scale < 1.0 { scale } else { 1.0 }
}
