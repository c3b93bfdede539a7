//! Takes out or mends what cannot be rendered.

use serde::Serialize;

use super::validate::{each_problem, squared_norm};
use super::{Field, GaussianParts, Gaussians, LOG_SCALE_LIMIT, Problem, Validation};

/// What an infinite opacity logit becomes: exactly opacity 1 in f32, or 2.1e-9.
pub const LOGIT_OF_INFINITY: f32 = 20.0;

/// What becomes of Gaussians that have a [`Problem`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cleaning {
    /// What reading a file does: infinite logits become ±[`LOGIT_OF_INFINITY`], a Gaussian with a NaN is left
    /// out, everything else stays as stored for the renderer to cull.
    Import,
    /// Infinite and out-of-range logits become ±[`LOGIT_OF_INFINITY`], zero quaternions the identity, overlong
    /// ones unit quaternions, log-scales are clamped to ±[`LOG_SCALE_LIMIT`]; what has any other problem is
    /// left out.
    Repair,
    /// A Gaussian with any problem is left out.
    Reject,
}

/// What a policy does with one Gaussian's problem.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Verdict {
    Keep,
    Mend,
    Drop,
}

impl Cleaning {
    fn verdict(self, field: Field, problem: Problem) -> Verdict {
        let is_nan = problem == Problem::NotANumber;
        let mends = match field {
            Field::OpacityLogits | Field::LogScales => !is_nan,
            Field::Quaternions => matches!(problem, Problem::ZeroNorm | Problem::OutOfRange),
            Field::Means | Field::Sh | Field::Scalars | Field::Filter3d => false,
        };
        match self {
            Self::Import if is_nan => Verdict::Drop,
            Self::Import if (field, problem) == (Field::OpacityLogits, Problem::Infinite) => Verdict::Mend,
            Self::Import => Verdict::Keep,
            Self::Repair if mends => Verdict::Mend,
            Self::Repair | Self::Reject => Verdict::Drop,
        }
    }
}

impl Gaussians {
    /// The Gaussians that a policy leaves, in their order, with what was found before it was applied.
    pub fn cleaned(&self, policy: Cleaning) -> (Self, Validation) {
        self.clone().into_cleaned(policy)
    }

    /// [`Self::cleaned`] without a copy where nothing is left out.
    pub(crate) fn into_cleaned(self, policy: Cleaning) -> (Self, Validation) {
        let mut validation = self.validate();
        if validation.is_clean() {
            return (self, validation);
        }
        let mut parts = self.into_parts();
        let mut kept = Vec::new();
        for position in 0..parts.means.len() {
            let mut mends = Vec::new();
            let mut worst = Verdict::Keep;
            each_problem(&parts, position, |field, problem| {
                let verdict = policy.verdict(field, problem);
                worst = worst.max(verdict);
                if verdict == Verdict::Mend {
                    mends.push(field);
                }
            });
            match worst {
                Verdict::Keep => kept.push(position),
                Verdict::Drop => validation.rejected += 1,
                Verdict::Mend => {
                    kept.push(position);
                    validation.repaired += 1;
                    for field in mends {
                        mend(&mut parts, position, field);
                    }
                }
            }
        }
        let all = Self(parts);
        let left = if validation.rejected == 0 { all } else { all.picked(&kept) };
        (left, validation)
    }
}

/// Makes one field of one Gaussian usable.
fn mend(parts: &mut GaussianParts, position: usize, field: Field) {
    match field {
        Field::OpacityLogits => {
            if let Some(logit) = parts.opacity_logits.get_mut(position) {
                *logit = LOGIT_OF_INFINITY.copysign(*logit);
            }
        }
        Field::LogScales => {
            for scale in parts.log_scales.get_mut(position).into_iter().flatten() {
                *scale = scale.clamp(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT);
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

    /// Six Gaussians: a good one, then one with each of five problems.
    fn six() -> Gaussians {
        let mut means = vec![[0.0; 3]; 6];
        means[1] = [0.0, f32::NAN, 0.0];
        let mut quaternions = vec![[1.0, 0.0, 0.0, 0.0]; 6];
        quaternions[2] = [0.0; 4];
        let mut log_scales = vec![[-1.0; 3]; 6];
        log_scales[3] = [100.0, f32::NEG_INFINITY, 0.0];
        let mut opacity_logits = vec![0.5; 6];
        opacity_logits[4] = f32::NEG_INFINITY;
        let mut sh = vec![[0.25; 3]; 6];
        sh[5] = [0.0, 0.0, f32::INFINITY];
        let parts = GaussianParts { means, quaternions, log_scales, opacity_logits, sh, ..GaussianParts::default() };
        Gaussians::new(parts).unwrap()
    }

    #[test]
    fn counted_by_field_with_the_first_position() {
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
    fn each_policy_leaves_what_it_says() {
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
        assert_eq!(left.parts().log_scales[2..3], [[LOG_SCALE_LIMIT, -LOG_SCALE_LIMIT, 0.0]]);
        assert!(left.validate().is_clean());
    }

    #[test]
    fn nan_outranks_infinity_and_overlong_quaternions_are_normalised() {
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

    /// Renderers draw every quaternion but zero, so that none is a problem or turned into another.
    #[test]
    fn short_quaternions_have_a_direction() {
        let mut parts = six().select(&[0, 0]).unwrap().into_parts();
        parts.quaternions = vec![[9e-7, 0.0, 0.0, -1e-7], [0.0, 1e-45, 0.0, 0.0]];
        let short = Gaussians::new(parts).unwrap();
        assert!(short.validate().is_clean());
        assert_eq!(short.cleaned(Cleaning::Repair).0, short);
        assert_eq!(short.cleaned(Cleaning::Reject).0, short);
    }
}
