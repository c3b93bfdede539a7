//! Similarities row by row. Images stay interleaved: the neighbour to the right is three samples further.

#![expect(clippy::inline_always, reason = "what is not inlined into the dispatched function loses its instructions")]

use std::borrow::Cow;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::filter::{self, Constants, MOMENTS};
use super::{Border, Covariance, Ssim, Window, gaussian, uniform};

/// Rows of windows per task; does not affect results.
const BAND: usize = 32;
const CHANNELS: usize = 3;

/// Calls `finish` for every row of windows, with three similarities per window.
pub(super) fn rows<T: Send>(
    images: &[Cow<'_, [f32]>; 2],
    size: [u32; 2],
    convention: Ssim,
    finish: impl Fn(&[f64]) -> T + Sync,
) -> Vec<T> {
    rows_at(Arch::new(), images, size, convention, finish)
}

/// [`rows`] with a given instruction set.
pub(super) fn rows_at<T: Send>(
    arch: Arch,
    images: &[Cow<'_, [f32]>; 2],
    size: [u32; 2],
    convention: Ssim,
    finish: impl Fn(&[f64]) -> T + Sync,
) -> Vec<T> {
    let [width, height] = size.map(|side| side as usize);
    let radius = convention.window.radius() as usize;
    let padding = if convention.border == Border::Inside { 0 } else { radius };
    let constants = Constants {
        c1: 0.01 * 0.01,
        c2: 0.03 * 0.03,
        covariance: match convention.covariance {
            Covariance::Sample => f64::from(convention.window.pixels()) / f64::from(convention.window.pixels() - 1),
            Covariance::Population => 1.0,
        },
    };
    let [x, y] = [&*images[0], &*images[1]];
    let shape = Shape { width, height, padding, radius, border: convention.border };
    let bands: Vec<usize> = (0..shape.rows()).step_by(BAND).collect();
    let results = bands.into_par_iter().map(|first| {
        let last = shape.rows().min(first + BAND);
        match convention.window {
            Window::Gaussian11 => {
                arch.dispatch(Band { x, y, shape, taps: &gaussian(), constants, first, last, finish: &finish })
            }
            Window::Uniform7 => {
                arch.dispatch(Band { x, y, shape, taps: &uniform(), constants, first, last, finish: &finish })
            }
        }
    });
    results.collect::<Vec<Vec<T>>>().into_iter().flatten().collect()
}

#[derive(Clone, Copy, Debug)]
struct Shape {
    width: usize,
    height: usize,
    padding: usize,
    radius: usize,
    border: Border,
}

impl Shape {
    /// Rows of windows.
    const fn rows(&self) -> usize {
        self.height + 2 * self.padding - 2 * self.radius
    }

    /// Samples of a padded row of the images.
    const fn padded(&self) -> usize {
        (self.width + 2 * self.padding) * CHANNELS
    }
}

struct Band<'a, F, const TAPS: usize> {
    x: &'a [f32],
    y: &'a [f32],
    shape: Shape,
    taps: &'a [f64; TAPS],
    constants: Constants,
    first: usize,
    last: usize,
    finish: &'a F,
}

impl<T, F: Fn(&[f64]) -> T, const TAPS: usize> WithSimd for Band<'_, F, TAPS> {
    type Output = Vec<T>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<T> {
        let Self { shape, taps, .. } = self;
        let padded = shape.padded();
        let windows = padded - 2 * shape.radius * CHANNELS;
        // Ring buffer of the last rows' terms of each sum: row `r` of the padded image is at `r` modulo the number of taps.
        let mut terms = vec![0.0; MOMENTS * TAPS * padded];
        let mut columns = vec![0.0; padded];
        let mut sums = vec![0.0; MOMENTS * windows];
        let mut similarities = vec![0.0; windows];
        let mut results = Vec::with_capacity(self.last - self.first);
        for row in self.first..self.first + TAPS - 1 {
            self.read(simd, row, &mut terms);
        }
        for row in self.first..self.last {
            self.read(simd, row + TAPS - 1, &mut terms);
            for (terms, sums) in terms.chunks_exact(TAPS * padded).zip(sums.chunks_exact_mut(windows)) {
                let mut rows: [&[f64]; TAPS] = [&[]; TAPS];
                for (tap, slot) in rows.iter_mut().enumerate() {
                    *slot = &terms[(row + tap) % TAPS * padded..][..padded];
                }
                filter::weighted_sum(simd, taps, rows, &mut columns);
                for (tap, slot) in rows.iter_mut().enumerate() {
                    *slot = &columns[tap * CHANNELS..][..windows];
                }
                filter::weighted_sum(simd, taps, rows, sums);
            }
            let parts = std::array::from_fn(|moment| &sums[moment * windows..][..windows]);
            filter::similarity(simd, parts, self.constants, &mut similarities);
            results.push((self.finish)(&similarities));
        }
        results
    }
}

impl<F, const TAPS: usize> Band<'_, F, TAPS> {
    /// Computes the terms of a row of the padded image.
    #[inline(always)]
    #[expect(clippy::expect_used, reason = "the buffer has a ring for each moment")]
    fn read<S: Simd>(&self, simd: S, row: usize, terms: &mut [f64]) {
        let Shape { width, height, padding, .. } = self.shape;
        let padded = self.shape.padded();
        let mut rings = terms.chunks_exact_mut(TAPS * padded);
        let mut slots = [(); MOMENTS].map(|()| {
            let ring = rings.next().expect("a ring for each moment");
            &mut ring[row % TAPS * padded..][..padded]
        });
        let inside = row >= padding && row < padding + height;
        if self.shape.border == Border::Zeros && !inside {
            for slot in slots {
                slot.fill(0.0);
            }
            return;
        }
        let row = mirrored(row, padding, height) * width * CHANNELS;
        let samples = row..row + width * CHANNELS;
        let inner = padding * CHANNELS..(padding + width) * CHANNELS;
        let parts = slots.each_mut().map(|slot| &mut slot[inner.clone()]);
        filter::moments(simd, &self.x[samples.clone()], &self.y[samples], parts);
        if self.shape.border == Border::Reflected {
            for column in (0..padding).chain(padding + width..2 * padding + width) {
                let from = (padding + mirrored(column, padding, width)) * CHANNELS;
                for slot in &mut slots {
                    slot.copy_within(from..from + CHANNELS, column * CHANNELS);
                }
            }
        }
    }
}

/// The pixel at a position of a padded side, mirrored at the outermost pixels.
const fn mirrored(position: usize, padding: usize, side: usize) -> usize {
    let from_edge = position.abs_diff(padding);
    if position < padding || from_edge < side { from_edge } else { 2 * (side - 1) - from_edge }
}
