use atsplat_numeric::Extremes as _;
use rayon::prelude::*;

use crate::packed_harmonics::{self, BandBounds};
use crate::{Gaussians, sh_coefficients};

/// Bounds over all Gaussians on the contribution of all bands from each degree on; infinite if a colour may be too large
/// to be drawn, which depends on every band. Independent of the number of threads.
pub(super) fn band_bounds(gaussians: &Gaussians, degree: u8) -> BandBounds {
    const CHUNK: usize = 4096;
    let parts = gaussians.parts();
    let stored = sh_coefficients(parts.sh_degree);
    let of_chunk = |chunk: &[[f32; 3]]| {
        chunk
            .chunks_exact(stored)
            .map(|sh| packed_harmonics::band_bounds(packed_harmonics::up_to_degree(sh, degree)))
            .fold(BandBounds::default(), larger)
    };
    let chunks: Vec<BandBounds> = parts.sh.par_chunks(CHUNK * stored).map(of_chunk).collect();
    chunks.into_iter().fold(BandBounds::default(), larger)
}

fn larger(mut most: BandBounds, other: BandBounds) -> BandBounds {
    for (most, other) in most.iter_mut().zip(other) {
        *most = most.maximum_of(other);
    }
    most
}

/// A bound on the colour of any Gaussian in any direction, of harmonics up to a degree that all have.
pub(super) fn of_colour(gaussians: &Gaussians, degree: u8) -> f64 {
    let [all, ..] = band_bounds(gaussians, degree);
    0.5 + all
}
