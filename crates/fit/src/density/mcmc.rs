use atsplat_numeric::{logit, narrowed, sigmoid};
use atsplat_splat::{GaussianParts, Gradients};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::{Changes, DensityControl, DensityError, StepContext};
use crate::optimised_gaussians::set;
use crate::random::{Purpose, normals, skip_normals, stream, weighted};
use crate::{OptimisedGaussians, StopReason};

/// Opacity up to which a Gaussian is dead; also the lowest that relocation gives.
const DEAD: f64 = 0.005;
/// Growth at each change of density, up to the limit.
const GROWTH: f64 = 1.05;
/// Weights of the mean opacity and of the mean scale in the loss.
const REGULARISERS: [f64; 2] = [0.01, 0.01];
/// Scale of the noise in units of the means' learning rate.
const NOISE: f64 = 5e5;
/// Share of the noise below which it is left out: opacities above 0.28, whose means it would not move by a rounding error.
const MIN_SHARE: f64 = 1e-12;
/// Most Gaussians in one place that the correction of opacity and scale is made for: gsplat's `n_max`
/// (`gsplat/strategy/mcmc.py`). The published code stops at 50 (ubc-vision/3dgs-mcmc `utils/reloc_utils.py`).
const MAX_COPIES: usize = 51;
/// Gaussians per task and per stream of random numbers.
const BLOCK: usize = 1024;

/// 3DGS as Markov chain Monte Carlo (Kheradmand et al. 2024; ubc-vision/3dgs-mcmc): dead Gaussians are relocated to live
/// ones, drawn by opacity, and the number grows by a twentieth at a time up to the limit. Opacities and scales are
/// corrected so that the image hardly changes. Means receive noise in proportion to their covariance, unless they are
/// opaque; small opacities and scales are rewarded.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mcmc;

/// Gradients of consecutive values, and the values.
type Block<'a, T> = (&'a mut [T], &'a [T]);

impl DensityControl for Mcmc {
    fn regularise(&self, scene: &OptimisedGaussians, gradients: &mut Gradients<f32>) -> f64 {
        let count = scene.len() as f64;
        let [opacity_weight, scale_weight] = [REGULARISERS[0] / count, REGULARISERS[1] / (3.0 * count)];
        let opacities =
            gradients.opacity_logits.par_chunks_mut(BLOCK).zip(scene.parts.opacity_logits.par_chunks(BLOCK));
        let scales = gradients.log_scales.par_chunks_mut(BLOCK).zip(scene.parts.log_scales.par_chunks(BLOCK));
        let block = |((gradients, logits), (by_scale, scales)): (Block<'_, f32>, Block<'_, [f32; 3]>)| {
            let mut sum = 0.0;
            for (gradient, logit) in gradients.iter_mut().zip(logits) {
                let opacity = sigmoid(*logit);
                *gradient += narrowed(opacity_weight * opacity * (1.0 - opacity));
                sum += opacity_weight * opacity;
            }
            for (gradient, log) in by_scale.as_flattened_mut().iter_mut().zip(scales.as_flattened()) {
                let scale = scale_weight * f64::from(*log).exp();
                *gradient += narrowed(scale);
                sum += scale;
            }
            sum
        };
        let sums: Vec<f64> = opacities.zip(scales).map(block).collect();
        sums.into_iter().sum()
    }

    fn after_step(&mut self, scene: &mut OptimisedGaussians, context: &StepContext) -> Result<Changes, DensityError> {
        let schedule = &context.schedule;
        let mut changes = Changes::default();
        if schedule.changes_density(context.step, schedule.relocation_until) {
            changes.relocated = relocate(scene, context)?;
            changes.added = grow(scene, context)?;
        }
        add_noise(&mut scene.parts, context);
        Ok(changes)
    }
}

/// Opacity of each of `copies` equal Gaussians that replace one, and the factor on its scales, so that the image hardly
/// changes: equation 9 of the paper (`diff-gaussian-rasterization/cuda_rasterizer/utils.cu`, `compute_relocation`).
pub fn relocated(opacity: f64, copies: usize) -> (f64, f64) {
    let copies = copies.clamp(1, MAX_COPIES);
    let new = 1.0 - (1.0 - opacity).powf(1.0 / copies as f64);
    let mut denominator = 0.0;
    for row in 0..copies {
        let (mut binomial, mut power) = (1.0, new);
        for k in 0..=row {
            denominator += binomial * power / ((k + 1) as f64).sqrt();
            binomial *= (row - k) as f64 / (k + 1) as f64;
            power *= -new;
        }
    }
    (new, opacity / denominator)
}

/// Moves dead Gaussians to live ones; returns their number.
fn relocate(scene: &mut OptimisedGaussians, context: &StepContext) -> Result<usize, DensityError> {
    let opacities: Vec<f64> = scene.opacities().collect();
    let dead = opacities.iter().enumerate().filter(|(_, opacity)| is_dead(**opacity));
    let dead: Vec<usize> = dead.map(|(position, _)| position).collect();
    let weights = opacities.iter().map(|opacity| if is_dead(*opacity) { 0.0 } else { *opacity });
    let sources = weighted(&mut context.stream(Purpose::Relocation), weights, dead.len());
    if sources.len() < dead.len() {
        return Err(DensityError::Stop(StopReason::NoGaussians));
    }
    share(scene, &sources);
    let copies = scene.copies(&sources)?;
    let coefficients = atsplat_splat::sh_coefficients(copies.sh_degree);
    for (from, &to) in dead.iter().enumerate() {
        let parts = &mut scene.parts;
        copy(&copies.means, from, &mut parts.means, to);
        copy(&copies.quaternions, from, &mut parts.quaternions, to);
        copy(&copies.log_scales, from, &mut parts.log_scales, to);
        copy(&copies.opacity_logits, from, &mut parts.opacity_logits, to);
        if let (Some(source), Some(filters)) = (&copies.filter_3d, &mut parts.filter_3d) {
            copy(source, from, filters, to);
        }
        for at in 0..coefficients {
            copy(&copies.sh, from * coefficients + at, &mut parts.sh, to * coefficients + at);
        }
    }
    // As in the published code, the moments of the sources are forgotten; those of the moved Gaussians stay.
    scene.reset_moments(&sources);
    Ok(dead.len())
}

/// NaN counts as dead.
fn is_dead(opacity: f64) -> bool {
    opacity.is_nan() || opacity <= DEAD
}

/// Number of Gaussians after a change of density.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a moderate positive number")]
pub(super) fn grown(count: usize, limit: usize) -> usize {
    ((GROWTH * count as f64) as usize).min(limit)
}

/// Adds Gaussians next to others, drawn by opacity; returns their number.
fn grow(scene: &mut OptimisedGaussians, context: &StepContext) -> Result<usize, DensityError> {
    let count = scene.len();
    let added = grown(count, context.limit).saturating_sub(count);
    let opacities: Vec<f64> = scene.opacities().collect();
    let sources = weighted(&mut context.stream(Purpose::Growth), opacities, added);
    share(scene, &sources);
    let new = scene.copies(&sources)?;
    scene.reset_moments(&sources);
    let kept: Vec<usize> = (0..count).collect();
    scene.replace(&kept, new)?;
    Ok(sources.len())
}

/// Corrects opacity and scales of Gaussians that will be in one place with copies of themselves, one for each time that they
/// are listed.
#[expect(clippy::expect_used, reason = "sources are positions of Gaussians")]
fn share(scene: &mut OptimisedGaussians, sources: &[usize]) {
    let mut copies = std::collections::BTreeMap::new();
    for source in sources {
        *copies.entry(*source).or_insert(1usize) += 1;
    }
    let parts = &mut scene.parts;
    for (source, copies) in copies {
        let of_source = parts.opacity_logits.get_mut(source).zip(parts.log_scales.get_mut(source));
        let (value, scales) = of_source.expect("a Gaussian at the position");
        let (opacity, factor) = relocated(sigmoid(*value), copies);
        *value = logit(opacity.clamp(DEAD, 1.0 - f64::from(f32::EPSILON)));
        *scales = scales.map(|log| narrowed(f64::from(log) + factor.ln()));
    }
}

#[expect(clippy::expect_used, reason = "there is a copy for each place")]
fn copy<T: Copy>(from: &[T], at: usize, into: &mut [T], to: usize) {
    set(into, to, *from.get(at).expect("a copied Gaussian"));
}

/// Adds `Σ · noise` to the means, more the fainter the Gaussian.
fn add_noise(parts: &mut GaussianParts, context: &StepContext) {
    let seed = context.stream(Purpose::Noise).next_u64();
    let scale = NOISE * context.means_rate;
    let shapes = parts.quaternions.par_chunks(BLOCK).zip(parts.log_scales.par_chunks(BLOCK));
    let blocks = parts.means.par_chunks_mut(BLOCK).zip(shapes.zip(parts.opacity_logits.par_chunks(BLOCK)));
    blocks.enumerate().for_each(|(block, (means, ((quaternions, scales), logits)))| {
        let mut random = stream(seed, Purpose::Noise, block as u64);
        for ((mean, (quaternion, scales)), logit) in means.iter_mut().zip(quaternions.iter().zip(scales)).zip(logits) {
            let share = faintness(sigmoid(*logit));
            if share < MIN_SHARE {
                skip_normals(&mut random);
                continue;
            }
            let noise = DVec3::from_array(normals(&mut random)) * (scale * share);
            let [w, x, y, z] = quaternion.map(f64::from);
            let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
            let variances = DVec3::from_array(scales.map(|log| (2.0 * f64::from(log)).exp()));
            let offset = rotation * (variances * (rotation.transpose() * noise));
            *mean = (DVec3::from_array(mean.map(f64::from)) + offset).to_array().map(narrowed);
        }
    });
}

/// A step from 1 for transparent Gaussians to 0, at an opacity of 0.005.
fn faintness(opacity: f64) -> f64 {
    1.0 / (1.0 + (-100.0 * ((1.0 - opacity) - 0.995)).exp())
}
