use atsplat_numeric::Extremes as _;
use rayon::prelude::*;

use crate::{Gaussians, LARGEST_CHANNEL, MAX_SH_DEGREE, sh_coefficients};

const BANDS: usize = MAX_SH_DEGREE as usize + 1;

/// Upper bounds, over all Gaussians, channels and directions, of the contribution of all SH bands from each degree on:
/// entry 0 covers every band, so `0.5 +` it bounds the colour itself.
pub(super) type Above = [f64; BANDS + 1];

/// Gaussians per task.
const CHUNK: usize = 4096;

/// Bounds over all Gaussians, or over as many as it takes until `enough`; independent of the number of threads.
///
/// By the addition theorem, `|Σₘ cₘ Yₗₘ| ≤ ‖c‖ √((2l + 1) / 4π)` in every direction.
pub(super) fn above(gaussians: &Gaussians, degree: u8, enough: impl Fn(&Above) -> bool) -> Above {
    let parts = gaussians.parts();
    let (stored, used) = (sh_coefficients(parts.sh_degree), sh_coefficients(degree));
    let mut largest = [0.0; BANDS + 1];
    let mut rest = parts.sh.as_slice();
    let mut chunks = 1;
    // Growing steps: stopping early costs little, and never stopping costs few joins.
    while !rest.is_empty() && !enough(&largest) {
        let (now, after) = rest.split_at_checked(chunks * CHUNK * stored).unwrap_or((rest, &[]));
        let of_chunk = |chunk: &[[f32; 3]]| {
            let each = chunk.chunks_exact(stored).map(|own| of_one(own.get(..used).unwrap_or(own)));
            each.fold([0.0; BANDS + 1], larger)
        };
        largest = now.par_chunks(CHUNK * stored).map(of_chunk).collect::<Vec<_>>().into_iter().fold(largest, larger);
        (rest, chunks) = (after, chunks * 2);
    }
    largest
}

/// Whether every coefficient above degree 0 is zero, as in files padded to a higher degree. Tests the bits, which is
/// many times faster than computing a bound.
pub(super) fn is_flat(gaussians: &Gaussians, degree: u8) -> bool {
    let parts = gaussians.parts();
    let (stored, used) = (sh_coefficients(parts.sh_degree), sh_coefficients(degree));
    let bits = |own: &[[f32; 3]]| {
        let upper = own[1..used].as_flattened();
        upper.iter().fold(0, |bits, value| bits | value.abs().to_bits())
    };
    parts.sh.par_chunks(CHUNK * stored).all(|chunk| chunk.chunks_exact(stored).all(|own| bits(own) == 0))
}

fn of_one(coefficients: &[[f32; 3]]) -> Above {
    // More than f32 rounding loses in a sum of 25 squares.
    const ROUNDING: f64 = 1.0 + 1e-5;
    let mut above = [0.0; BANDS + 1];
    let mut sum = 0.0;
    for (band, slot) in above.iter_mut().enumerate().take(BANDS).rev() {
        let Some(own) = coefficients.get(band * band..) else { continue };
        let squares =
            own.iter().take(2 * band + 1).fold([0.0f32; 3], |[r, g, b], [x, y, z]| [r + x * x, g + y * y, b + z * z]);
        let largest = squares.into_iter().fold(0.0, f32::maximum_of);
        sum += ROUNDING * (f64::from(largest) * (2.0 * band as f64 + 1.0) * 0.25 * std::f64::consts::FRAC_1_PI).sqrt();
        *slot = sum;
    }
    // Whether a colour is too large to be drawn depends on every band.
    if above.first().is_some_and(|all| !(*all < 0.5 * LARGEST_CHANNEL)) {
        above.iter_mut().take(BANDS).for_each(|slot| *slot = f64::INFINITY);
    }
    above
}

fn larger(mut most: Above, other: Above) -> Above {
    for (most, other) in most.iter_mut().zip(other) {
        *most = most.maximum_of(other);
    }
    most
}

/// The SH degree that is evaluated.
pub(super) fn degree(gaussians: &Gaussians, max_sh_degree: u8) -> u8 {
    gaussians.sh_degree().min(max_sh_degree)
}

/// A bound on the colour of any Gaussian in any direction.
pub(super) fn of_colour(gaussians: &Gaussians, max_sh_degree: u8) -> f64 {
    let [all, ..] = above(gaussians, degree(gaussians, max_sh_degree), |_| false);
    0.5 + all
}
