//! Spherical harmonics without the bands that no view shows.

use std::f64::consts::PI;

use atsplat_numeric::Extremes as _;
use rayon::prelude::*;

use crate::{Gaussians, LARGEST_CHANNEL, MAX_SH_DEGREE, sh_coefficients};

/// The coefficients that each Gaussian of a scene needs, stored without gaps: rendered instead of the Gaussians' own, which
/// take the same memory traffic whether or not they are used.
///
/// # The bound
/// The bands above a Gaussian's kept degree are a sum of harmonics with coefficients `c`. By the addition theorem
/// `Σₘ Yₗₘ² = (2l + 1) / 4π` and Cauchy–Schwarz, dropping them changes a channel of its colour in no direction by more than
/// `Σₗ ‖cₗ‖ √((2l + 1) / 4π)`. Clamping colours at 0 moves two of them no further apart. Along a ray, compositing weights
/// are at least 0 and sum to at most 1, so a pixel changes by no more than the Gaussian that changes most:
/// [`PackedHarmonics::bound`].
#[derive(Clone, Debug)]
pub struct PackedHarmonics {
    degree: u8,
    heads: Vec<Head>,
    /// Coefficients above degree 0, Gaussian by Gaussian.
    upper: Vec<[f32; 3]>,
    bound: f64,
    kept: [u64; BANDS],
}

/// A Gaussian's first coefficient, and where the others are.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Head {
    first: [f32; 3],
    /// Index of the next coefficient.
    start: u32,
    degree: u8,
}

const BANDS: usize = MAX_SH_DEGREE as usize + 1;
/// Gaussians per task.
const CHUNK: usize = 4096;

impl PartialEq for PackedHarmonics {
    fn eq(&self, other: &Self) -> bool {
        let numbers = |harmonics: &Self| (harmonics.degree, harmonics.bound, harmonics.kept);
        std::ptr::eq(self, other)
            || (numbers(self) == numbers(other) && self.heads == other.heads && self.upper == other.upper)
    }
}

impl PackedHarmonics {
    /// Keeps the fewest bands up to `max_degree` with which no colour changes by more than `tolerance`. Gaussians that are
    /// culled for their colour stay culled.
    ///
    /// `None` for more coefficients than 32 bits count.
    pub fn pack(gaussians: &Gaussians, max_degree: u8, tolerance: f64) -> Option<Self> {
        let parts = gaussians.parts();
        let stored = sh_coefficients(parts.sh_degree);
        let of_chunk = |sh: &[[f32; 3]]| {
            let mut packed = Self::with_capacity(CHUNK);
            for of_gaussian in sh.chunks_exact(stored) {
                packed.push(up_to_degree(of_gaussian, max_degree), tolerance);
            }
            packed
        };
        let chunks: Vec<Self> = parts.sh.par_chunks(CHUNK * stored).map(of_chunk).collect();
        let mut all = Self::with_capacity(gaussians.len());
        all.upper.reserve(chunks.iter().map(|chunk| chunk.upper.len()).sum());
        for chunk in &chunks {
            all.append(chunk)?;
        }
        Some(all)
    }

    /// Share of the bytes that packing would leave of the coefficients, estimated from every 61st Gaussian.
    pub fn packed_share(gaussians: &Gaussians, max_degree: u8, tolerance: f64) -> f64 {
        const STRIDE: usize = 61;
        let parts = gaussians.parts();
        let stored = sh_coefficients(parts.sh_degree);
        let sample = parts.sh.chunks_exact(stored).step_by(STRIDE);
        let (bytes, all) = sample.fold((0, 0), |(bytes, all), sh| {
            let (degree, _) = needed(up_to_degree(sh, max_degree), tolerance);
            let upper = (sh_coefficients(degree) - 1) * size_of::<[f32; 3]>();
            (bytes + size_of::<Head>() + upper, all + size_of_val(sh))
        });
        if all == 0 { 1.0 } else { bytes as f64 / all as f64 }
    }

    /// Largest change of any colour channel of any Gaussian, in any direction.
    pub const fn bound(&self) -> f64 {
        self.bound
    }

    /// Highest degree that any Gaussian keeps.
    pub const fn degree(&self) -> u8 {
        self.degree
    }

    /// Number of Gaussians by the degree that they keep.
    pub const fn kept(&self) -> [u64; MAX_SH_DEGREE as usize + 1] {
        self.kept
    }

    /// Number of Gaussians.
    pub const fn len(&self) -> usize {
        self.heads.len()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.heads.is_empty()
    }

    /// The first Gaussian of an evenly spaced sample whose kept coefficients are not these, bit for bit. All would take the memory
    /// traffic that packing saves.
    pub(crate) fn first_difference(&self, gaussians: &Gaussians) -> Option<usize> {
        const SAMPLE: usize = 64;
        let (parts, step) = (gaussians.parts(), self.len().div_ceil(SAMPLE).max(1));
        let mut stored = parts.sh.chunks_exact(sh_coefficients(parts.sh_degree)).enumerate().step_by(step);
        let bits = |rgb: &[f32; 3]| rgb.map(f32::to_bits);
        let differs = |position: usize, sh: &[[f32; 3]]| {
            self.coefficients(position).is_none_or(|(first, upper)| {
                let kept = std::iter::once(&first).chain(upper);
                sh.len() <= upper.len() || kept.zip(sh).any(|(kept, stored)| bits(kept) != bits(stored))
            })
        };
        stored.find(|(position, sh)| differs(*position, sh)).map(|(position, _)| position)
    }

    /// A Gaussian's first coefficient, and those above degree 0.
    #[inline(always)]
    pub(crate) fn coefficients(&self, position: usize) -> Option<([f32; 3], &[[f32; 3]])> {
        let head = self.heads.get(position)?;
        let start = head.start as usize;
        Some((head.first, self.upper.get(start..start + sh_coefficients(head.degree) - 1)?))
    }

    fn with_capacity(count: usize) -> Self {
        let (heads, upper) = (Vec::with_capacity(count), Vec::new());
        Self { degree: 0, heads, upper, bound: 0.0, kept: [0; BANDS] }
    }

    fn push(&mut self, sh: &[[f32; 3]], tolerance: f64) {
        let (degree, change) = needed(sh, tolerance);
        let (first, upper) = sh.split_first().unwrap_or((&[0.0; 3], &[]));
        #[expect(clippy::expect_used, reason = "a chunk has at most 4096 · 24 of them")]
        let start = u32::try_from(self.upper.len()).expect("few coefficients in a chunk");
        self.heads.push(Head { first: *first, start, degree });
        self.upper.extend(upper.iter().take(sh_coefficients(degree) - 1));
        self.kept[usize::from(degree) % BANDS] += 1;
        self.degree = self.degree.max(degree);
        self.bound = self.bound.maximum_of(change);
    }

    fn append(&mut self, chunk: &Self) -> Option<()> {
        let before = u32::try_from(self.upper.len()).ok()?;
        for head in &chunk.heads {
            self.heads.push(Head { start: head.start.checked_add(before)?, ..*head });
        }
        self.upper.extend(&chunk.upper);
        self.kept.iter_mut().zip(chunk.kept).for_each(|(sum, count)| *sum += count);
        self.degree = self.degree.max(chunk.degree);
        self.bound = self.bound.maximum_of(chunk.bound);
        Some(())
    }
}

/// A Gaussian's coefficients up to a degree: all of them, if it has none above.
pub(crate) fn up_to_degree(sh: &[[f32; 3]], degree: u8) -> &[[f32; 3]] {
    sh.split_at(sh.len().min(sh_coefficients(degree))).0
}

/// The lowest degree that changes no colour by more than the tolerance, and the bound on that change, which is finite.
fn needed(sh: &[[f32; 3]], tolerance: f64) -> (u8, f64) {
    let bounds = band_bounds(sh);
    let highest = sh.len().isqrt().saturating_sub(1);
    let is_invisible = |change: &f64| change.is_finite() && *change <= tolerance;
    let kept = bounds.iter().skip(1).take(highest).position(is_invisible).unwrap_or(highest);
    #[expect(clippy::expect_used, reason = "`kept` is a degree")]
    let change = bounds.get(kept + 1).expect("one bound for each degree, and 0 behind the last");
    #[expect(clippy::expect_used, reason = "`kept` is a degree")]
    let degree = u8::try_from(kept).expect("at most the degree that is stored");
    (degree, *change)
}

/// Upper bounds on the contribution of all bands from each degree on, see [`PackedHarmonics`]: entry 0 covers every band, so
/// `0.5 +` it bounds the colour itself. Infinite if the colour may be too large to be drawn, which depends on every band.
pub(crate) type BandBounds = [f64; BANDS + 1];

/// The bounds of one Gaussian.
pub(crate) fn band_bounds(sh: &[[f32; 3]]) -> BandBounds {
    // More than f32 rounding loses in a sum of 25 squares.
    const ROUNDING: f64 = 1.0 + 1e-5;
    let mut bounds = [0.0; BANDS + 1];
    let mut sum = 0.0;
    for (band, slot) in bounds.iter_mut().enumerate().take(BANDS).rev() {
        let Some(of_band) = sh.get(band * band..(band + 1) * (band + 1)) else { continue };
        let squares = of_band.iter().fold([0.0f32; 3], |[r, g, b], [x, y, z]| [r + x * x, g + y * y, b + z * z]);
        let largest = squares.into_iter().fold(0.0, f32::maximum_of);
        sum += ROUNDING * (f64::from(largest) * (2.0 * band as f64 + 1.0) / (4.0 * PI)).sqrt();
        *slot = sum;
    }
    if bounds.first().is_some_and(|all| !(*all < 0.5 * LARGEST_CHANNEL)) {
        // Where there are no bands, nothing can be left out.
        bounds.iter_mut().take(sh.len().isqrt()).for_each(|slot| *slot = f64::INFINITY);
    }
    bounds
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_that_are_not_stored_change_nothing() {
        let sh: Vec<[f32; 3]> = (0..9u8).map(|k| [f32::from(k), 0.5, -1.0]).collect();
        for (degree, count) in [(0, 1), (1, 4), (2, 9), (4, 9)] {
            assert_eq!(up_to_degree(&sh, degree), &sh[..count], "degree {degree}");
        }
    }
}
