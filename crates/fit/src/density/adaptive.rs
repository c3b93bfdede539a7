use atsplat_numeric::{Extremes as _, logit, narrowed, sigmoid};
use atsplat_splat::GaussianParts;
use glam::{DQuat, DVec3};

use super::{Changes, DensityControl, DensityError, StepContext, ViewGradients};
use crate::random::{Purpose, normals};
use crate::{OptimisedGaussians, Schedule, StopReason};

/// Smallest opacity that is kept.
const MIN_OPACITY: f64 = 0.005;
/// Opacity to which a reset lowers all Gaussians above it.
const RESET_OPACITY: f64 = 0.01;
/// Largest scale of a Gaussian that is cloned rather than split, in extents of the scene.
const SPLIT_SCALE: f64 = 0.01;
/// Largest scale that is kept after the first reset, in extents of the scene.
const LARGEST_SCALE: f64 = 0.1;
/// Children of a split are smaller by this factor: 0.8 times their number.
const SHRINKING: f64 = 1.6;

/// 3DGS' adaptive density control (graphdeco-inria/gaussian-splatting `scene/gaussian_model.py`, `densify_and_prune`):
/// Gaussians whose projected means have large gradients are cloned if they are small and split if they are large; faint
/// ones are pruned, and so are large ones after the first reset of opacities.
///
/// It follows the optimiser's update, as in gsplat; the published code densifies before it, and so skips that update. Like
/// the code behind the published figures, it does not prune by the size on the screen.
#[derive(Clone, Debug)]
pub struct Adaptive {
    /// Mean norm of the gradient, in units of half the image's width and height, from which Gaussians are densified.
    threshold: f64,
    sums: Vec<f32>,
    counts: Vec<f32>,
    /// The step of the last reset. A checkpoint does not store it: the schedule of a fixed number of steps keeps resets apart.
    last_reset: Option<u64>,
}

impl Default for Adaptive {
    /// Threshold 2e-4.
    fn default() -> Self {
        Self { threshold: 2e-4, sums: Vec::new(), counts: Vec::new(), last_reset: None }
    }
}

impl Adaptive {
    /// gsplat's `absgrad`: sums of absolute gradients decide on clones and on splits, with the threshold of 8e-4 that gsplat
    /// advises (`gsplat/strategy/default.py`). The code of `AbsGS` (TY424/AbsGS) uses them for splits alone, from 4e-4, and
    /// clones by ordinary gradients.
    pub fn absolute() -> Self {
        Self { threshold: 8e-4, ..Self::default() }
    }

    /// Clones, splits and prunes.
    fn densify(&mut self, scene: &mut OptimisedGaussians, context: &StepContext) -> Result<Changes, DensityError> {
        let count = scene.len();
        self.sums.resize(count, 0.0);
        self.counts.resize(count, 0.0);
        let (mut clones, mut parents, mut kept) = (Vec::new(), Vec::new(), Vec::new());
        let largest =
            |scales: &[f32; 3]| f64::from(scales.iter().fold(f32::MIN, |most, log| most.maximum_of(*log))).exp();
        let means = self.sums.iter().zip(&self.counts).zip(&scene.parts.log_scales).enumerate();
        for (position, ((sum, seen), scales)) in means {
            let dense = *seen > 0.0 && f64::from(*sum) / f64::from(*seen) >= self.threshold;
            let small = largest(scales) <= SPLIT_SCALE * context.extent;
            match (dense, small) {
                (true, true) => clones.push(position),
                (true, false) => parents.push(position),
                _ => {}
            }
            if !dense || small {
                kept.push(position);
            }
        }
        let prune_large = context.step > context.schedule.reset_every;
        #[expect(clippy::expect_used, reason = "positions are those of Gaussians")]
        let keeps = |parts: &GaussianParts, position: usize| {
            let of_gaussian = parts.opacity_logits.get(position).zip(parts.log_scales.get(position));
            let (logit, scales) = of_gaussian.expect("a Gaussian at the position");
            sigmoid(*logit) >= MIN_OPACITY && (largest(scales) <= LARGEST_SCALE * context.extent || !prune_large)
        };
        let mut new = scene.copies(&clones)?;
        append(&mut new, children(&scene.copies(&parents)?, context));
        let added: Vec<usize> = (0..new.means.len()).filter(|position| keeps(&new, *position)).collect();
        let before = kept.len() + new.means.len();
        kept.retain(|position| keeps(&scene.parts, *position));
        let wanted = kept.len() + added.len();
        if wanted > context.limit {
            return Err(DensityError::Stop(StopReason::TooManyGaussians { wanted, limit: context.limit }));
        }
        if wanted == 0 {
            return Err(DensityError::Stop(StopReason::NoGaussians));
        }
        let new = crate::optimised_gaussians::gaussians_of(new).select(&added)?.into_parts();
        scene.replace(&kept, new)?;
        self.sums = vec![0.0; wanted];
        self.counts = vec![0.0; wanted];
        Ok(Changes { cloned: clones.len(), split: parents.len(), pruned: before - wanted, ..Changes::default() })
    }
}

impl DensityControl for Adaptive {
    fn observe(&mut self, view: &ViewGradients<'_>) {
        self.sums.resize(view.count, 0.0);
        self.counts.resize(view.count, 0.0);
        for position in view.drawn.iter().map(|position| *position as usize) {
            if let (Some([x, y]), Some(sum), Some(count)) =
                (view.means_2d.get(position), self.sums.get_mut(position), self.counts.get_mut(position))
            {
                let [x, y] = [f64::from(*x) * 0.5 * view.size[0], f64::from(*y) * 0.5 * view.size[1]];
                *sum += narrowed((x * x + y * y).sqrt());
                *count += 1.0;
            }
        }
    }

    fn after_step(&mut self, scene: &mut OptimisedGaussians, context: &StepContext) -> Result<Changes, DensityError> {
        let schedule = &context.schedule;
        if context.step >= schedule.density_until {
            return Ok(Changes::default());
        }
        let mut changes = Changes::default();
        if schedule.changes_density(context.step, schedule.density_until) {
            changes = self.densify(scene, context)?;
        }
        // A new plan has other multiples, of which the next may follow at once.
        let has_risen =
            self.last_reset.is_none_or(|last| context.step.saturating_sub(last) >= Schedule::SHORTEST_RESET);
        if has_risen && schedule.resets_opacities(context.step, context.white) {
            reset(scene);
            self.last_reset = Some(context.step);
            changes.reset = true;
        }
        Ok(changes)
    }

    fn state(&self) -> Vec<(&'static str, Vec<f32>)> {
        vec![("gradient-sums", self.sums.clone()), ("gradient-counts", self.counts.clone())]
    }

    fn restore_state(&mut self, state: Vec<Vec<f32>>) {
        #[expect(clippy::expect_used, reason = "as the trait requires")]
        let [sums, counts] = state.try_into().expect("what `state` names");
        (self.sums, self.counts) = (sums, counts);
    }
}

/// Two children for each parent: drawn from the parent's distribution, smaller by [`SHRINKING`]; first the first child
/// of every parent, then the second.
fn children(parents: &GaussianParts, context: &StepContext) -> GaussianParts {
    let mut random = context.stream(Purpose::Split);
    let mut both = GaussianParts { sh_degree: parents.sh_degree, ..GaussianParts::default() };
    for _ in 0..2 {
        let mut child = parents.clone();
        for ((mean, quaternion), scales) in child.means.iter_mut().zip(&child.quaternions).zip(&mut child.log_scales) {
            let [w, x, y, z] = quaternion.map(f64::from);
            let deviations = DVec3::from_array(scales.map(|log| f64::from(log).exp()));
            let offset =
                DQuat::from_xyzw(x, y, z, w).normalize() * (deviations * DVec3::from_array(normals(&mut random)));
            *mean = (DVec3::from_array(mean.map(f64::from)) + offset).to_array().map(narrowed);
            *scales = scales.map(|log| narrowed(f64::from(log) - SHRINKING.ln()));
        }
        append(&mut both, child);
    }
    both
}

/// Lowers every opacity, as drawn, to at most [`RESET_OPACITY`]. With a 3D filter the drawn opacity is the stored one times a
/// coefficient, which is divided out again (autonomousvision/mip-splatting `reset_opacity`).
fn reset(scene: &mut OptimisedGaussians) {
    let filters = scene.parts.filter_3d.as_ref();
    #[expect(clippy::expect_used, reason = "the arrays of Gaussians have equal lengths")]
    let filter_of = |position: usize| {
        filters.map_or(0.0, |filters| f64::from(*filters.get(position).expect("one filter per Gaussian")))
    };
    let scales = scene.parts.log_scales.iter().enumerate();
    let coefficients: Vec<f64> = scales
        .map(|(position, scales)| {
            let filter = filter_of(position);
            let share = |log: &f32| {
                let variance = (2.0 * f64::from(*log)).exp();
                if filter > 0.0 { variance / (variance + filter * filter) } else { 1.0 }
            };
            scales.iter().map(share).product::<f64>().sqrt()
        })
        .collect();
    for (value, coefficient) in scene.parts.opacity_logits.iter_mut().zip(coefficients) {
        let opacity = sigmoid(*value);
        if opacity * coefficient > RESET_OPACITY {
            *value = logit(RESET_OPACITY / coefficient);
        }
    }
    scene.first_moments.opacity_logits.fill(0.0);
    scene.second_moments.opacity_logits.fill(0.0);
}

/// Appends Gaussians of the same degree. All have filters, or none has.
fn append(to: &mut GaussianParts, from: GaussianParts) {
    debug_assert!(
        to.means.is_empty() || from.means.is_empty() || to.filter_3d.is_some() == from.filter_3d.is_some(),
        "filters of all Gaussians or of none"
    );
    to.means.extend(from.means);
    to.quaternions.extend(from.quaternions);
    to.log_scales.extend(from.log_scales);
    to.opacity_logits.extend(from.opacity_logits);
    to.sh.extend(from.sh);
    if let Some(filters) = from.filter_3d {
        to.filter_3d.get_or_insert_default().extend(filters);
    }
}
