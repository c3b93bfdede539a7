use atsplat_numeric::narrowed;
use atsplat_splat::{Gradients, sh_coefficients};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::optimised_gaussians::OptimisedGaussians;

/// Adam (Kingma and Ba 2015) with the parameters of 3DGS: β = 0.9 and 0.999, ε = 1e-15.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Learning rate of the means in scene units.
    pub means: f64,
    /// Learning rate of the constant coefficients of the spherical harmonics; the others have a twentieth.
    pub colours: f64,
    /// Learning rate of the logits of opacities.
    pub opacities: f64,
    /// Learning rate of the logarithms of scales.
    pub scales: f64,
    /// Learning rate of the quaternions.
    pub rotations: f64,
    /// Highest degree with gradients; coefficients beyond it stay as they are.
    pub sh_degree: u8,
    /// Steps so far, this one included; at least 1. It counts from the start of the run for all Gaussians, as in the
    /// published code, where density control keeps the optimiser's counter.
    pub step: u64,
}

pub(crate) const BETAS: [f64; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-15;
const COLOUR_RATIO: f64 = 20.0;

/// Values per task.
const CHUNK: usize = 1 << 11;

impl Adam {
    /// Moves every parameter against its gradient.
    pub fn update(&self, scene: &mut OptimisedGaussians, gradients: &Gradients<f32>) {
        let OptimisedGaussians { parts, first_moments: first, second_moments: second } = scene;
        self.flat(
            self.means,
            parts.means.as_flattened_mut(),
            gradients.means.as_flattened(),
            first.means.as_flattened_mut(),
            second.means.as_flattened_mut(),
        );
        self.flat(
            self.rotations,
            parts.quaternions.as_flattened_mut(),
            gradients.quaternions.as_flattened(),
            first.quaternions.as_flattened_mut(),
            second.quaternions.as_flattened_mut(),
        );
        self.flat(
            self.scales,
            parts.log_scales.as_flattened_mut(),
            gradients.log_scales.as_flattened(),
            first.log_scales.as_flattened_mut(),
            second.log_scales.as_flattened_mut(),
        );
        self.flat(
            self.opacities,
            &mut parts.opacity_logits,
            &gradients.opacity_logits,
            &mut first.opacity_logits,
            &mut second.opacity_logits,
        );
        // The constant coefficient of each Gaussian, then the others. Unused ones have neither gradients nor moments; if
        // there are none, all Gaussians of a chunk are one row.
        let stored = 3 * sh_coefficients(parts.sh_degree);
        let used = 3 * sh_coefficients(self.sh_degree.min(parts.sh_degree));
        let chunk = (CHUNK / stored).max(1) * stored;
        let (row, length) = if used == stored { (chunk, chunk) } else { (stored, used) };
        let rate = |at| if at % stored < 3 { self.colours } else { self.colours / COLOUR_RATIO };
        let rates: Vec<f64> = (0..length).map(rate).collect();
        self.rows(
            (chunk, row),
            &rates,
            parts.sh.as_flattened_mut(),
            gradients.sh.as_flattened(),
            first.sh.as_flattened_mut(),
            second.sh.as_flattened_mut(),
        );
    }

    /// Updates parameters that share a learning rate.
    fn flat(&self, rate: f64, values: &mut [f32], gradients: &[f32], first: &mut [f32], second: &mut [f32]) {
        self.rows((CHUNK, CHUNK), &[rate; CHUNK], values, gradients, first, second);
    }

    /// Updates parameters in tasks of `chunk` values, row by row with the learning rates of a row.
    fn rows(
        &self,
        (chunk, row): (usize, usize),
        rates: &[f64],
        values: &mut [f32],
        gradients: &[f32],
        first: &mut [f32],
        second: &mut [f32],
    ) {
        let [bias, root] = bias_corrections(self.step);
        let rates: Vec<f32> = rates.iter().map(|rate| narrowed(rate / bias)).collect();
        let (rates, over_root) = (rates.as_slice(), narrowed(root.sqrt().recip()));
        let moments = first.par_chunks_mut(chunk).zip(second.par_chunks_mut(chunk));
        let chunks = values.par_chunks_mut(chunk).zip(gradients.par_chunks(chunk)).zip(moments);
        chunks.for_each(|((values, gradients), (first, second))| {
            Arch::new().dispatch(Rows { row, rates, over_root, values, gradients, first, second });
        });
    }
}

/// What the means of gradients and of their squares are divided by after so many steps, because both begin at zero.
pub(crate) fn bias_corrections(step: u64) -> [f64; 2] {
    let power = i32::try_from(step).unwrap_or(i32::MAX);
    BETAS.map(|beta| 1.0 - beta.powi(power))
}

/// The update of one task.
struct Rows<'a> {
    row: usize,
    /// Learning rates over the first bias correction.
    rates: &'a [f32],
    /// One over the root of the second bias correction.
    over_root: f32,
    values: &'a mut [f32],
    gradients: &'a [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
}

impl WithSimd for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        const KEPT: [f32; 2] = [narrowed(BETAS[0]), narrowed(BETAS[1])];
        const NEW: [f32; 2] = [1.0 - KEPT[0], 1.0 - KEPT[1]];
        let Self { row, rates, over_root, values, gradients, first, second } = self;
        let moments = first.chunks_mut(row).zip(second.chunks_mut(row));
        for ((values, gradients), (first, second)) in values.chunks_mut(row).zip(gradients.chunks(row)).zip(moments) {
            let each = values.iter_mut().zip(gradients).zip(first.iter_mut().zip(second));
            for (((value, gradient), (m, v)), rate) in each.zip(rates) {
                *m = KEPT[0] * *m + NEW[0] * gradient;
                *v = KEPT[1] * *v + NEW[1] * gradient * gradient;
                *value -= rate * *m / (v.sqrt() * over_root + EPSILON);
            }
        }
    }
}
