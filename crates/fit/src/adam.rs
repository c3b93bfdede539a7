use atsplat_splat::{Gradients, sh_coefficients};
use rayon::prelude::*;

use crate::scene::{Scene, narrowed};

/// Adam (Kingma and Ba 2015) with the parameters of 3DGS: β = 0.9 and 0.999, ε = 1e-15.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Rate of the means in scene units.
    pub means: f64,
    /// Rate of the constant coefficients of the spherical harmonics; the others have a twentieth.
    pub colours: f64,
    /// Rate of the logits of opacities.
    pub opacities: f64,
    /// Rate of the logarithms of scales.
    pub scales: f64,
    /// Rate of the quaternions.
    pub rotations: f64,
    /// Highest degree with gradients; coefficients beyond it stay as they are.
    pub sh_degree: u8,
    /// Steps so far, this one included; at least 1. It counts from the start of the run for all Gaussians, as in the
    /// published code, where density control keeps the optimiser's counter.
    pub step: u64,
}

const BETAS: [f64; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-15;
const COLOUR_RATIO: f64 = 20.0;

/// Values per task.
const CHUNK: usize = 1 << 13;

impl Adam {
    /// Moves every parameter against its gradient.
    pub fn update(&self, scene: &mut Scene, gradients: &Gradients<f32>) {
        let Scene { parts, first, second } = scene;
        let stored = sh_coefficients(parts.sh_degree);
        let used = sh_coefficients(self.sh_degree.min(parts.sh_degree));
        self.flat(self.means).update(
            parts.means.as_flattened_mut(),
            gradients.means.as_flattened(),
            first.means.as_flattened_mut(),
            second.means.as_flattened_mut(),
        );
        self.flat(self.rotations).update(
            parts.quaternions.as_flattened_mut(),
            gradients.quaternions.as_flattened(),
            first.quaternions.as_flattened_mut(),
            second.quaternions.as_flattened_mut(),
        );
        self.flat(self.scales).update(
            parts.log_scales.as_flattened_mut(),
            gradients.log_scales.as_flattened(),
            first.log_scales.as_flattened_mut(),
            second.log_scales.as_flattened_mut(),
        );
        self.flat(self.opacities).update(
            &mut parts.opacity_logits,
            &gradients.opacity_logits,
            &mut first.opacity_logits,
            &mut second.opacity_logits,
        );
        self.colours((stored, used), &mut parts.sh, &gradients.sh, (&mut first.sh, &mut second.sh));
    }

    fn flat(&self, rate: f64) -> Update {
        let power = i32::try_from(self.step).unwrap_or(i32::MAX);
        let [first, second] = BETAS.map(|beta| 1.0 - beta.powi(power));
        Update { rate: narrowed(rate / first), root: narrowed(second.sqrt()) }
    }

    /// Spherical harmonics, Gaussian by Gaussian: the constant coefficient, then the others up to the degree in use.
    fn colours(
        &self,
        (stored, used): (usize, usize),
        values: &mut [[f32; 3]],
        gradients: &[[f32; 3]],
        (first, second): (&mut [[f32; 3]], &mut [[f32; 3]]),
    ) {
        let (constant, others) = (self.flat(self.colours), self.flat(self.colours / COLOUR_RATIO));
        let length = (CHUNK / 3 / stored).max(1) * stored;
        let moments = first.par_chunks_mut(length).zip(second.par_chunks_mut(length));
        let chunks = values.par_chunks_mut(length).zip(gradients.par_chunks(length)).zip(moments);
        chunks.for_each(|((values, gradients), (first, second))| {
            let moments = first.chunks_exact_mut(stored).zip(second.chunks_exact_mut(stored));
            let each = values.chunks_exact_mut(stored).zip(gradients.chunks_exact(stored)).zip(moments);
            for ((values, gradients), (first, second)) in each {
                for (at, ((value, gradient), (m, v))) in
                    values.iter_mut().zip(gradients).zip(first.iter_mut().zip(second)).take(used).enumerate()
                {
                    let update = if at == 0 { &constant } else { &others };
                    update.run(value, gradient, m, v);
                }
            }
        });
    }
}

/// The update of parameters that share a rate.
#[derive(Clone, Copy)]
struct Update {
    /// Rate over the first bias correction.
    rate: f32,
    /// Root of the second bias correction.
    root: f32,
}

impl Update {
    fn update(self, values: &mut [f32], gradients: &[f32], first: &mut [f32], second: &mut [f32]) {
        let moments = first.par_chunks_mut(CHUNK).zip(second.par_chunks_mut(CHUNK));
        let chunks = values.par_chunks_mut(CHUNK).zip(gradients.par_chunks(CHUNK)).zip(moments);
        chunks.for_each(|((values, gradients), (first, second))| self.run(values, gradients, first, second));
    }

    #[inline(always)]
    fn run(self, values: &mut [f32], gradients: &[f32], first: &mut [f32], second: &mut [f32]) {
        let [b1, b2] = BETAS.map(narrowed);
        for ((value, gradient), (m, v)) in values.iter_mut().zip(gradients).zip(first.iter_mut().zip(second)) {
            *m = b1 * *m + (1.0 - b1) * gradient;
            *v = b2 * *v + (1.0 - b2) * gradient * gradient;
            *value -= self.rate * *m / (v.sqrt() / self.root + EPSILON);
        }
    }
}
