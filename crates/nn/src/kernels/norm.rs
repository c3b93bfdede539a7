use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::columns::{self, BLOCK};
use super::simd;
use crate::NormKind;

/// Elements of a row that are normalised together.
///
/// A row begins with `parts · heads` segments of `length` elements; those of part p share row p of `gamma` and `beta`. The
/// following elements are not changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Segments {
    pub(crate) kind: NormKind,
    pub(crate) epsilon: f64,
    /// Elements in a row.
    pub(crate) width: usize,
    pub(crate) parts: usize,
    pub(crate) heads: usize,
    pub(crate) length: usize,
}

impl Segments {
    /// Number of elements of `gamma`.
    pub(crate) const fn parameters(&self) -> usize {
        self.parts * self.length
    }
}

/// The gradients of `x`, of `gamma`, and of `beta` if there is one.
pub(crate) type Gradients = (Vec<f32>, Vec<f32>, Option<Vec<f32>>);

/// Normalises rows.
pub(crate) fn forward(x: &[f32], gamma: &[f32], beta: Option<&[f32]>, segments: Segments) -> Vec<f32> {
    let mut out = x.to_vec();
    if segments.parameters() > 0 {
        out.par_chunks_mut(segments.width * BLOCK).for_each(|rows| {
            simd::run(Forward { rows, gamma, beta, segments });
        });
    }
    out
}

/// The backward pass of [`forward`] at `x`.
pub(crate) fn backward(x: &[f32], gamma: &[f32], has_beta: bool, grad: &[f32], segments: Segments) -> Gradients {
    let parameters = segments.parameters();
    let mut out = grad.to_vec();
    if parameters == 0 {
        return (out, Vec::new(), has_beta.then(Vec::new));
    }
    let summed = if has_beta { 2 * parameters } else { parameters };
    let chunk = segments.width * BLOCK;
    let blocks = out.par_chunks_mut(chunk).zip(x.par_chunks(chunk)).map(|(grad, x)| {
        let mut sums = vec![0.0; summed];
        simd::run(Backward { grad, x, gamma, sums: &mut sums, segments });
        sums
    });
    let mut by_gamma = columns::in_order(blocks.collect(), summed);
    let by_beta = has_beta.then(|| by_gamma.split_off(parameters));
    (out, by_gamma, by_beta)
}

struct Forward<'a> {
    rows: &'a mut [f32],
    gamma: &'a [f32],
    beta: Option<&'a [f32]>,
    segments: Segments,
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { rows, gamma, beta, segments } = self;
        let Segments { parts, heads, length, .. } = segments;
        for row in rows.chunks_exact_mut(segments.width) {
            let each = row.chunks_exact_mut(length).take(parts * heads).enumerate();
            for (index, segment) in each {
                let part = index / heads * length..(index / heads + 1) * length;
                let Moments { mean, scale } = Moments::of(simd, segment, &segments);
                let (mean, scale) = (simd.splat_f32s(mean), simd.splat_f32s(scale));
                let shifted = {
                    #[inline(always)]
                    |x, [gamma, beta]: [S::f32s; 2]| {
                        simd.mul_add_e_f32s(simd.mul_f32s(simd.sub_f32s(x, mean), scale), gamma, beta)
                    }
                };
                let scaled = {
                    #[inline(always)]
                    |x, [gamma]: [S::f32s; 1]| simd.mul_f32s(simd.mul_f32s(simd.sub_f32s(x, mean), scale), gamma)
                };
                let gamma = &gamma[part.clone()];
                match beta {
                    Some(beta) => simd::map(simd, segment, [gamma, &beta[part]], shifted),
                    None => simd::map(simd, segment, [gamma], scaled),
                }
            }
        }
    }
}

struct Backward<'a> {
    /// The gradient of the output, replaced by that of the input.
    grad: &'a mut [f32],
    x: &'a [f32],
    gamma: &'a [f32],
    /// Sums over rows for `gamma`, then for `beta` if there is one.
    sums: &'a mut [f32],
    segments: Segments,
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { grad, x, gamma, sums, segments } = self;
        let Segments { parts, heads, length, width, .. } = segments;
        let (by_gamma, by_beta) = sums.split_at_mut(segments.parameters());
        let mut standard = vec![0.0; length];
        let mut scaled = vec![0.0; length];
        for (grad, x) in grad.chunks_exact_mut(width).zip(x.chunks_exact(width)) {
            let each = grad.chunks_exact_mut(length).zip(x.chunks_exact(length)).take(parts * heads).enumerate();
            for (index, (grad, x)) in each {
                let part = index / heads * length..(index / heads + 1) * length;
                let Moments { mean, scale } = Moments::of(simd, x, &segments);
                let (mean, scale) = (simd.splat_f32s(mean), simd.splat_f32s(scale));
                let standardise = {
                    #[inline(always)]
                    |_, [x]: [S::f32s; 1]| simd.mul_f32s(simd.sub_f32s(x, mean), scale)
                };
                let product = {
                    #[inline(always)]
                    |_, [a, b]: [S::f32s; 2]| simd.mul_f32s(a, b)
                };
                let add_product = {
                    #[inline(always)]
                    |sum, [a, b]: [S::f32s; 2]| simd.mul_add_e_f32s(a, b, sum)
                };
                let add = {
                    #[inline(always)]
                    |sum, [a]: [S::f32s; 1]| simd.add_f32s(sum, a)
                };
                simd::map(simd, &mut standard, [x], standardise);
                simd::map(simd, &mut scaled, [grad, &gamma[part.clone()]], product);
                simd::map(simd, &mut by_gamma[part.clone()], [grad, &standard], add_product);
                if !by_beta.is_empty() {
                    simd::map(simd, &mut by_beta[part], [grad], add);
                }

                let products = {
                    #[inline(always)]
                    |[a, b]: [S::f32s; 2]| simd.mul_f32s(a, b)
                };
                let along = simd::sum(simd, [&scaled, &standard], products, |[a, b]| a * b);
                let along = simd.splat_f32s(along / length as f32);
                let level = match segments.kind {
                    NormKind::Layer => total(simd, &scaled) / length as f32,
                    NormKind::Rms => 0.0,
                };
                let level = simd.splat_f32s(level);
                let project = {
                    #[inline(always)]
                    |_, [scaled, standard]: [S::f32s; 2]| {
                        let across = simd.sub_f32s(simd.sub_f32s(scaled, level), simd.mul_f32s(standard, along));
                        simd.mul_f32s(across, scale)
                    }
                };
                simd::map(simd, grad, [&scaled, &standard], project);
            }
        }
    }
}

/// What is subtracted from a segment, and the factor of the result.
struct Moments {
    mean: f32,
    scale: f32,
}

impl Moments {
    #[inline(always)]
    fn of<S: Simd>(simd: S, x: &[f32], segments: &Segments) -> Self {
        let count = x.len() as f32;
        let mean = match segments.kind {
            NormKind::Layer => total(simd, x) / count,
            NormKind::Rms => 0.0,
        };
        let means = simd.splat_f32s(mean);
        let square = {
            #[inline(always)]
            |[x]: [S::f32s; 1]| {
                let off = simd.sub_f32s(x, means);
                simd.mul_f32s(off, off)
            }
        };
        let variance = simd::sum(simd, [x], square, |[x]| (x - mean) * (x - mean)) / count;
        #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
        let epsilon = segments.epsilon as f32;
        Self { mean, scale: 1.0 / (variance + epsilon).sqrt() }
    }
}

#[inline(always)]
fn total<S: Simd>(simd: S, x: &[f32]) -> f32 {
    let same = {
        #[inline(always)]
        |[x]: [S::f32s; 1]| x
    };
    simd::sum(simd, [x], same, |[x]| x)
}
