//! Drops or repairs Gaussians that cannot be rendered.

use atsplat_numeric::Extremes as _;
use serde::Serialize;

use super::validate::{each_problem, squared_norm};
use super::{Field, GaussianParts, Gaussians, LOG_SCALE_LIMIT, Problem, Validation};

/// Replaces an infinite opacity logit: an opacity of exactly 1 in f32, or of 2.1e-9.
pub const LOGIT_OF_INFINITY: f32 = 20.0;

/// How Gaussians with a [`Problem`] are handled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cleaning {
    /// Used when reading a file: infinite logits become ±[`LOGIT_OF_INFINITY`], a Gaussian with a NaN is dropped,
    /// everything else stays as stored for the renderer to cull.
    Import,
    /// Infinite and out-of-range logits become ±[`LOGIT_OF_INFINITY`], zero quaternions the identity, quaternions whose
    /// norm overflows unit quaternions, log-scales below −[`LOG_SCALE_LIMIT`] that number; a Gaussian with any other problem is
    /// dropped. Renderers draw none with a log-scale above the limit; at the limit, it would cover every image.
    Repair,
    /// A Gaussian with any problem is dropped.
    Reject,
}

/// How a policy handles one Gaussian's problem.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Action {
    Keep,
    Repair,
    Drop,
}

impl Cleaning {
    /// What to do about a problem of a Gaussian; `is_too_large` if one of its log-scales is above the limit.
    fn action(self, field: Field, problem: Problem, is_too_large: bool) -> Action {
        let is_nan = problem == Problem::NotANumber;
        let repairs = match field {
            Field::OpacityLogits => !is_nan,
            Field::LogScales => !is_nan && !is_too_large,
            Field::Quaternions => matches!(problem, Problem::ZeroNorm | Problem::OutOfRange),
            Field::Means | Field::Sh | Field::Scalars | Field::Filter3d => false,
        };
        match self {
            Self::Import if is_nan => Action::Drop,
            Self::Import if (field, problem) == (Field::OpacityLogits, Problem::Infinite) => Action::Repair,
            Self::Import => Action::Keep,
            Self::Repair if repairs => Action::Repair,
            Self::Repair | Self::Reject => Action::Drop,
        }
    }
}

impl Gaussians {
    /// Applies a policy; returns the remaining Gaussians in order, and what was found before it was applied.
    pub fn cleaned(&self, policy: Cleaning) -> (Self, Validation) {
        self.clone().into_cleaned(policy)
    }

    /// [`Self::cleaned`] without a copy if nothing is dropped.
    pub fn into_cleaned(self, policy: Cleaning) -> (Self, Validation) {
        let mut validation = self.validate();
        if validation.is_clean() {
            return (self, validation);
        }
        let mut parts = self.into_parts();
        let mut kept = Vec::new();
        for position in 0..parts.means.len() {
            let mut repairs = Vec::new();
            let mut strictest = Action::Keep;
            let is_too_large =
                parts.log_scales.get(position).is_some_and(|scales| scales.iter().any(|log| *log > LOG_SCALE_LIMIT));
            each_problem(&parts, position, |field, problem| {
                let action = policy.action(field, problem, is_too_large);
                strictest = strictest.max(action);
                if action == Action::Repair {
                    repairs.push(field);
                }
            });
            match strictest {
                Action::Keep => kept.push(position),
                Action::Drop => {
                    validation.rejected += 1;
                    validation.dropped.push(position);
                }
                Action::Repair => {
                    kept.push(position);
                    validation.repaired += 1;
                    for field in repairs {
                        repair(&mut parts, position, field);
                    }
                }
            }
        }
        let all = Self(parts);
        (if validation.rejected == 0 { all } else { all.picked(&kept) }, validation)
    }
}

/// Repairs one field of one Gaussian.
fn repair(parts: &mut GaussianParts, position: usize, field: Field) {
    match field {
        Field::OpacityLogits => {
            if let Some(logit) = parts.opacity_logits.get_mut(position) {
                *logit = LOGIT_OF_INFINITY.copysign(*logit);
            }
        }
        Field::LogScales => {
            for scale in parts.log_scales.get_mut(position).into_iter().flatten() {
                *scale = scale.maximum_of(-LOG_SCALE_LIMIT);
            }
        }
        Field::Quaternions => {
            if let Some(quaternion) = parts.quaternions.get_mut(position) {
                *quaternion = unit(quaternion);
            }
        }
        Field::Means | Field::Sh | Field::Scalars | Field::Filter3d => {}
    }
}

#[expect(clippy::cast_possible_truncation, reason = "parts of a unit quaternion are rounded to f32")]
fn unit(quaternion: &[f32; 4]) -> [f32; 4] {
    let norm = squared_norm(quaternion);
    if norm == 0.0 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    quaternion.map(|part| (f64::from(part) / norm.sqrt()) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One valid Gaussian, then one with each of five problems.
    fn six() -> Gaussians {
        let mut means = vec![[0.0; 3]; 6];
        means[1] = [0.0, f32::NAN, 0.0];
        let mut quaternions = vec![[1.0, 0.0, 0.0, 0.0]; 6];
        quaternions[2] = [0.0; 4];
        let mut log_scales = vec![[-1.0; 3]; 6];
        log_scales[3] = [LOG_SCALE_LIMIT, f32::NEG_INFINITY, -100.0];
        let mut opacity_logits = vec![0.5; 6];
        opacity_logits[4] = f32::NEG_INFINITY;
        let mut sh = vec![[0.25; 3]; 6];
        sh[5] = [0.0, 0.0, f32::INFINITY];
        let parts = GaussianParts { means, quaternions, log_scales, opacity_logits, sh, ..GaussianParts::default() };
        Gaussians::new(parts).unwrap()
    }

    #[test]
    fn counts_problems_by_field_with_the_first_index() {
        let validation = six().validate();
        let found: Vec<_> = validation.findings.iter().map(|f| (f.field, f.problem, f.count, f.first)).collect();
        assert_eq!(
            found,
            [
                (Field::Means, Problem::NotANumber, 1, 1),
                (Field::Quaternions, Problem::ZeroNorm, 1, 2),
                (Field::LogScales, Problem::Infinite, 1, 3),
                (Field::OpacityLogits, Problem::Infinite, 1, 4),
                (Field::Sh, Problem::Infinite, 1, 5),
            ]
        );
        assert_eq!((validation.total, validation.invalid, validation.rejected), (6, 5, 0));
    }

    #[test]
    fn each_policy_keeps_repairs_and_drops_as_documented() {
        let outcome = |policy| {
            let (left, validation) = six().cleaned(policy);
            assert_eq!(left.len() + validation.rejected, 6);
            (left, validation.rejected, validation.repaired)
        };
        let (left, rejected, repaired) = outcome(Cleaning::Reject);
        assert_eq!((rejected, repaired), (5, 0));
        assert_eq!(left, six().select(&[0]).unwrap());

        let (left, rejected, repaired) = outcome(Cleaning::Import);
        assert_eq!((rejected, repaired), (1, 1));
        assert_eq!(left.parts().opacity_logits, [0.5, 0.5, 0.5, -20.0, 0.5]);
        assert_eq!(left.parts().quaternions[1..2], [[0.0; 4]]);

        let (left, rejected, repaired) = outcome(Cleaning::Repair);
        assert_eq!((rejected, repaired), (2, 3), "the NaN and the infinite colour");
        assert_eq!(left.parts().quaternions[1..2], [[1.0, 0.0, 0.0, 0.0]]);
        assert_eq!(left.parts().log_scales[2..3], [[LOG_SCALE_LIMIT, -LOG_SCALE_LIMIT, -LOG_SCALE_LIMIT]]);
        assert!(left.validate().is_clean());
    }

    #[test]
    fn broken_gaussians_are_counted_by_what_became_of_them() {
        let mut parts = six().select(&[0; 4]).unwrap().into_parts();
        let warning = |parts: &GaussianParts| {
            Gaussians::new(parts.clone()).unwrap().into_cleaned(Cleaning::Repair).1.warning("initial Gaussians")
        };
        assert_eq!(warning(&parts), None);
        (parts.means[1][0], parts.opacity_logits[2], parts.opacity_logits[3]) = (f32::NAN, 99.0, -99.0);
        let expected = "3 of 4 initial Gaussians are broken, of which 1 are removed and 2 repaired: means not a number in 1, first \
                        1; opacity logits out of range in 2, first 2";
        assert_eq!(warning(&parts).as_deref(), Some(expected));
    }

    /// Renderers do not draw them.
    #[test]
    fn scales_that_are_too_large_are_not_repaired() {
        let mut parts = six().select(&[0; 4]).unwrap().into_parts();
        parts.log_scales =
            vec![[-3.0; 3], [0.0, f32::INFINITY, 0.0], [f32::NEG_INFINITY, 44.0, 0.0], [-44.0, 0.0, 0.0]];
        let (left, validation) = Gaussians::new(parts).unwrap().cleaned(Cleaning::Repair);
        assert_eq!((validation.rejected, validation.repaired, validation.dropped), (2, 1, vec![1, 2]));
        assert_eq!(left.parts().log_scales, [[-3.0; 3], [-LOG_SCALE_LIMIT, 0.0, 0.0]]);
    }

    #[test]
    fn nan_outranks_infinity_and_overflowing_quaternions_are_normalised() {
        let mut parts = six().select(&[0, 0]).unwrap().into_parts();
        parts.log_scales[0] = [f32::INFINITY, f32::NAN, 0.0];
        parts.quaternions[1] = [0.0, 0.0, -3e38, 0.0];
        let odd = Gaussians::new(parts).unwrap();
        let validation = odd.validate();
        assert_eq!(validation.count(Field::LogScales, Problem::NotANumber), 1);
        assert_eq!(validation.count(Field::LogScales, Problem::Infinite), 0);
        assert_eq!(validation.count(Field::Quaternions, Problem::OutOfRange), 1);
        let (left, _) = odd.cleaned(Cleaning::Repair);
        assert_eq!(left.parts().quaternions, [[0.0, 0.0, -1.0, 0.0]]);
    }

    /// SPZ would clamp them to colours that can be seen. 1e12 is the largest channel that is drawn.
    #[test]
    fn coefficients_and_scalars_that_no_renderer_draws_are_problems() {
        let mut parts = six().select(&[0; 4]).unwrap().into_parts();
        parts.sh = vec![[0.25, 1e12, -1e12], [0.0, 3e38, 0.0], [-1.1e12, 0.0, f32::NAN], [0.5; 3]];
        parts.scalars = Some(vec![1e12, 0.0, 0.0, -1e13]);
        let large = Gaussians::new(parts).unwrap();
        let validation = large.validate();
        assert_eq!(validation.count(Field::Sh, Problem::OutOfRange), 1);
        assert_eq!(validation.count(Field::Sh, Problem::NotANumber), 1);
        assert_eq!(validation.count(Field::Scalars, Problem::OutOfRange), 1);
        assert_eq!(large.cleaned(Cleaning::Import).0, large.select(&[0, 1, 3]).unwrap());
        for policy in [Cleaning::Repair, Cleaning::Reject] {
            assert_eq!(large.cleaned(policy).0, large.select(&[0]).unwrap(), "{policy:?}");
        }
    }

    /// Renderers accept every quaternion but zero, so a tiny one is neither a problem nor replaced.
    #[test]
    fn tiny_quaternions_are_valid() {
        let mut parts = six().select(&[0, 0]).unwrap().into_parts();
        parts.quaternions = vec![[9e-7, 0.0, 0.0, -1e-7], [0.0, 1e-45, 0.0, 0.0]];
        let short = Gaussians::new(parts).unwrap();
        assert!(short.validate().is_clean());
        assert_eq!(short.cleaned(Cleaning::Repair).0, short);
        assert_eq!(short.cleaned(Cleaning::Reject).0, short);
    }
}
