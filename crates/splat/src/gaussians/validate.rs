//! Counts Gaussians that cannot be rendered.
//!
//! All of these occur in published files: `logit(1) = +∞` (DepthSplat's exporter; those of pixelSplat and NoPoSplat write
//! opacities in place of logits), 889,536 zero quaternions in one scene (playcanvas/splat-transform #288), NaN positions
//! (playcanvas/supersplat #360).

use std::fmt;

use atsplat_numeric::{Extremes as _, narrowed};
use serde::Serialize;

use super::{GaussianParts, Gaussians, sh_coefficients};
use crate::LARGEST_CHANNEL;

/// Largest magnitude of a log-scale `s` whose variance `exp(2 s)` is a normal f32.
pub const LOG_SCALE_LIMIT: f32 = 43.5;
/// Largest magnitude of an opacity logit: in f32, the exponential of 88 is finite, and that of 89 is not.
pub const LOGIT_LIMIT: f32 = 88.0;

/// A per-Gaussian field of [`GaussianParts`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Field {
    /// Centres.
    Means,
    /// Rotations.
    Quaternions,
    /// Log-scales.
    LogScales,
    /// Opacity logits.
    OpacityLogits,
    /// Spherical harmonics.
    Sh,
    /// The additional scalar.
    Scalars,
    /// Mip-Splatting's filter.
    Filter3d,
}

/// A problem in a field of one Gaussian; only the first that applies is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Problem {
    /// A NaN.
    NotANumber,
    /// An infinity.
    Infinite,
    /// A zero quaternion; any other can be normalised in f64, as renderers do.
    ZeroNorm,
    /// A log-scale beyond ±[`LOG_SCALE_LIMIT`], a logit beyond ±[`LOGIT_LIMIT`], a quaternion whose squared norm
    /// overflows f32, a coefficient of spherical harmonics or a scalar beyond ±[`LARGEST_CHANNEL`], a negative filter.
    OutOfRange,
}

/// Number of Gaussians with one problem in one field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The field.
    pub field: Field,
    /// The problem.
    pub problem: Problem,
    /// Number of Gaussians with it.
    pub count: usize,
    /// Index of the first of them.
    pub first: usize,
}

/// Result of validating and cleaning Gaussians.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Validation {
    /// Gaussians examined.
    pub total: usize,
    /// Gaussians with any problem.
    pub invalid: usize,
    /// Gaussians dropped.
    pub rejected: usize,
    /// Gaussians repaired and kept.
    pub repaired: usize,
    /// Non-zero counts, sorted by field, then problem.
    pub findings: Vec<Finding>,
    /// Positions of the dropped Gaussians, in order.
    #[serde(skip)]
    pub dropped: Vec<usize>,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let field = match self.field {
            Field::Means => "means",
            Field::Quaternions => "quaternions",
            Field::LogScales => "log-scales",
            Field::OpacityLogits => "opacity logits",
            Field::Sh => "spherical harmonics",
            Field::Scalars => "scalars",
            Field::Filter3d => "filters",
        };
        let problem = match self.problem {
            Problem::NotANumber => "not a number",
            Problem::Infinite => "infinite",
            Problem::ZeroNorm => "zero",
            Problem::OutOfRange => "out of range",
        };
        write!(f, "{field} {problem} in {}, first {}", self.count, self.first)
    }
}

impl Validation {
    /// Whether no problem was found.
    pub const fn is_clean(&self) -> bool {
        self.invalid == 0
    }

    /// What was wrong with `what`, such as initial Gaussians, and what cleaning did with them; `None` if no problem was found.
    pub fn warning(&self, what: &str) -> Option<String> {
        let Self { total, invalid, rejected, repaired, findings, .. } = self;
        let kinds: Vec<String> = findings.iter().map(ToString::to_string).collect();
        (!self.is_clean()).then(|| {
            format!(
                "{invalid} of {total} {what} are broken, of which {rejected} are removed and {repaired} repaired: {}",
                kinds.join("; ")
            )
        })
    }

    /// Number of Gaussians with this problem in this field.
    pub fn count(&self, field: Field, problem: Problem) -> usize {
        self.findings.iter().find(|finding| (finding.field, finding.problem) == (field, problem)).map_or(0, |f| f.count)
    }

    /// The position, before Gaussians were dropped, of one that was kept.
    pub(crate) fn position_before(&self, kept: usize) -> usize {
        self.dropped.iter().fold(kept, |position, dropped| position + usize::from(*dropped <= position))
    }

    fn record(&mut self, field: Field, problem: Problem, position: usize) {
        match self.findings.iter_mut().find(|finding| (finding.field, finding.problem) == (field, problem)) {
            Some(finding) => finding.count += 1,
            None => self.findings.push(Finding { field, problem, count: 1, first: position }),
        }
    }
}

impl Gaussians {
    /// Number of Gaussians whose centre is so far from the origin that f32 moves it by more than an eighth of their largest
    /// standard deviation. Positions of georeferenced captures are an example.
    pub fn coarsely_placed(&self) -> usize {
        let is_coarse = |(mean, log_scales): (&[f32; 3], &[f32; 3])| {
            let step = mean.iter().fold(0.0, |most: f32, value| most.maximum_of(value.abs().next_up() - value.abs()));
            let largest = log_scales.iter().copied().fold(f32::NEG_INFINITY, f32::maximum_of).exp();
            0.5 * step > 0.125 * largest
        };
        self.parts().means.iter().zip(&self.parts().log_scales).filter(|of_one| is_coarse(*of_one)).count()
    }

    /// Counts the problems by field and kind.
    pub fn validate(&self) -> Validation {
        let mut validation = Validation { total: self.len(), ..Validation::default() };
        for position in 0..self.len() {
            let mut clean = true;
            each_problem(self.parts(), position, |field, problem| {
                validation.record(field, problem, position);
                clean = false;
            });
            validation.invalid += usize::from(!clean);
        }
        validation.findings.sort_unstable_by_key(|finding| (finding.field, finding.problem));
        validation
    }
}

/// Calls `found` for each field of one Gaussian that has a problem.
pub(super) fn each_problem(parts: &GaussianParts, position: usize, mut found: impl FnMut(Field, Problem)) {
    let coefficients = sh_coefficients(parts.sh_degree);
    let sh = parts.sh.get(position * coefficients..(position + 1) * coefficients);
    let sh = sh.unwrap_or_else(|| unreachable!("every Gaussian has all the coefficients of its degree"));
    let optional = |values: &Option<Vec<f32>>| values.as_ref().and_then(|values| values.get(position).copied());
    let beyond = |limit: f32| move |value: &f32| value.abs() > limit;
    let fields = [
        (Field::Means, parts.means.get(position).and_then(|mean| non_finite(mean))),
        (Field::Quaternions, parts.quaternions.get(position).and_then(quaternion_problem)),
        (Field::LogScales, parts.log_scales.get(position).and_then(|s| problem(s, beyond(LOG_SCALE_LIMIT)))),
        (Field::OpacityLogits, parts.opacity_logits.get(position).and_then(|o| problem(&[*o], beyond(LOGIT_LIMIT)))),
        (Field::Sh, channels_problem(sh.as_flattened())),
        (Field::Scalars, optional(&parts.scalars).and_then(|value| channels_problem(&[value]))),
        (Field::Filter3d, optional(&parts.filter_3d).and_then(|value| problem(&[value], |filter| *filter < 0.0))),
    ];
    for (field, problem) in fields {
        if let Some(problem) = problem {
            found(field, problem);
        }
    }
}

fn non_finite(values: &[f32]) -> Option<Problem> {
    // x · 0 is 0 only for finite x, so one branch accepts a valid row.
    if values.iter().fold(0.0, |sum, value| sum + value * 0.0) == 0.0 {
        return None;
    }
    let nan = values.iter().any(|value| value.is_nan());
    Some(if nan { Problem::NotANumber } else { Problem::Infinite })
}

/// Of what is composited. Coefficients this large are no colours; with most of them, renderers cull the Gaussian.
fn channels_problem(values: &[f32]) -> Option<Problem> {
    const LARGEST: f32 = narrowed(LARGEST_CHANNEL);
    // Without a branch for each value.
    let is_beyond = values.iter().fold(false, |any, value| any | (value.abs() > LARGEST));
    non_finite(values).or(is_beyond.then_some(Problem::OutOfRange))
}

fn problem(values: &[f32], is_out_of_range: impl FnMut(&f32) -> bool) -> Option<Problem> {
    non_finite(values).or_else(|| values.iter().any(is_out_of_range).then_some(Problem::OutOfRange))
}

fn quaternion_problem(quaternion: &[f32; 4]) -> Option<Problem> {
    let norm = squared_norm(quaternion);
    let norm_problem =
        if norm == 0.0 { Some(Problem::ZeroNorm) } else { (norm > f64::from(f32::MAX)).then_some(Problem::OutOfRange) };
    non_finite(quaternion).or(norm_problem)
}

pub(super) fn squared_norm(quaternion: &[f32; 4]) -> f64 {
    quaternion.iter().map(|part| f64::from(*part) * f64::from(*part)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centres_far_from_the_origin_are_coarse_for_small_gaussians_only() {
        // Between 2²² and 2²³ f32 has steps of a half: centres move by up to a quarter.
        let placed = |mean: [f32; 3], deviations: [f32; 3]| {
            let parts = GaussianParts {
                means: vec![mean, [0.0; 3]],
                quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 2],
                log_scales: vec![deviations.map(f32::ln); 2],
                opacity_logits: vec![0.0; 2],
                sh: vec![[0.0; 3]; 2],
                ..GaussianParts::default()
            };
            Gaussians::new(parts).unwrap().coarsely_placed()
        };
        assert_eq!(placed([1.0, -5.4e6, 2.0], [0.1, 1.9, 0.1]), 1);
        assert_eq!(placed([1.0, -5.4e6, 2.0], [0.1, 0.1, 2.1]), 0);
        assert_eq!(placed([3.0, 1.0, 2.0], [1e-5, 1e-5, 1e-5]), 0);
    }
}
