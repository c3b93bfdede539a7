use std::f64::consts::PI;

use super::Filter;
use crate::PixelError;
use crate::limits::reserved;

/// Fractional bits of a weight: 32 minus 8 for the sample and 2 for negative lobes.
pub(super) const PRECISION_BITS: u32 = 22;

/// Maximum weights of one pass: Pillow's own limit, a table of f64 in 2 GiB.
const LARGEST_TABLE: usize = (i32::MAX / 8).cast_unsigned() as usize;

/// For each target position, the range of source positions and their fixed-point weights.
pub(super) struct Coefficients {
    windows: Vec<Window>,
    weights: Vec<i32>,
    stride: usize,
}

#[derive(Clone, Copy)]
struct Window {
    start: usize,
    length: usize,
}

impl Coefficients {
    /// Pillow's `precompute_coeffs` and `normalize_coeffs_8bpc` over the whole source.
    pub(super) fn new(source: u32, target: u32, filter: Filter) -> Result<Self, PixelError> {
        let scale = f64::from(source) / f64::from(target);
        let filter_scale = if scale < 1.0 { 1.0 } else { scale };
        let support = radius(filter) * filter_scale;
        let stride = whole(support.ceil()) * 2 + 1;
        if target as usize > LARGEST_TABLE / stride {
            return Err(PixelError::TooLarge { what: "table of weights", width: target.into(), height: stride as u64 });
        }
        let mut weights = reserved("table of weights", target.into(), stride as u64, 1)?;
        let mut windows = Vec::with_capacity(target as usize);
        let mut window_weights = vec![0.0; stride];
        for position in 0..target {
            let centre = (f64::from(position) + 0.5) * scale;
            let start = whole(centre - support + 0.5);
            let end = whole(centre + support + 0.5).min(source as usize);
            let window = &mut window_weights[..end.saturating_sub(start)];
            let mut sum = 0.0;
            for (weight, offset) in window.iter_mut().zip(start..) {
                *weight = weight_at(filter, (offset as f64 - centre + 0.5) * (1.0 / filter_scale));
                sum += *weight;
            }
            for weight in window.iter_mut().filter(|_| sum != 0.0) {
                *weight /= sum;
            }
            windows.push(Window { start, length: window.len() });
            weights.extend(window.iter().map(|&weight| quantised(weight)));
            weights.resize(windows.len() * stride, 0);
        }
        Ok(Self { windows, weights, stride })
    }

    /// Number of target positions.
    pub(super) fn len(&self) -> usize {
        self.windows.len()
    }

    /// First source position and weights for each target position, in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, &[i32])> {
        let rows = self.weights.chunks_exact(self.stride);
        self.windows.iter().zip(rows).map(|(window, row)| (window.start, &row[..window.length]))
    }
}

/// Half the filter's width in source pixels, when not shrinking.
const fn radius(filter: Filter) -> f64 {
    match filter {
        Filter::Lanczos => 3.0,
        Filter::Bilinear => 1.0,
        Filter::Box => 0.5,
    }
}

fn weight_at(filter: Filter, x: f64) -> f64 {
    match filter {
        Filter::Lanczos if (-3.0..3.0).contains(&x) => sinc(x) * sinc(x / 3.0),
        Filter::Bilinear if x.abs() < 1.0 => 1.0 - x.abs(),
        Filter::Box if x > -0.5 && x <= 0.5 => 1.0,
        _ => 0.0,
    }
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 {
        return 1.0;
    }
    let x = x * PI;
    x.sin() / x
}

/// Rounds half away from zero, as in C with ±0.5 and a truncating cast.
#[expect(clippy::cast_possible_truncation, reason = "a normalised weight is of order one")]
fn quantised(weight: f64) -> i32 {
    let scaled = weight * f64::from(1 << PRECISION_BITS);
    (if weight < 0.0 { scaled - 0.5 } else { scaled + 0.5 }) as i32
}

/// The integer part of a number; 0 if it is negative.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturation is intended")]
fn whole(value: f64) -> usize {
    value as usize
}
