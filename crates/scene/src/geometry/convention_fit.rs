use std::fmt;

use serde::Serialize;

use super::{Convention, ConventionScore};

/// An interpretation explains the images if its median is at most this many pixels …
const FIT_PX: f64 = 0.5;
/// … plus this fraction of the image's diagonal: pose errors in pixels grow with the resolution, the noise of feature
/// points does not.
const FIT_DIAGONAL: f64 = 1e-3;
/// Interpretations within this factor of the smallest median cannot be distinguished …
const RIVAL_FACTOR: f64 = 1.5;
/// … nor those within this many pixels more, the noise of feature points.
const NOISE_PX: f64 = 0.1;
/// An interpretation with a smaller fraction of points in front of both cameras cannot be right.
const IN_FRONT: f64 = 0.5;

/// Which interpretation of the declared cameras explains the images.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "verdict", rename_all = "kebab-case")]
pub enum ConventionFit {
    /// An interpretation explains the images: the declared one unless another is clearly better.
    Fits {
        /// The interpretation to use.
        convention: Convention,
        /// Other interpretations that these images do not rule out, best first.
        not_ruled_out: Vec<Convention>,
    },
    /// No interpretation explains the images: something else is wrong, or they do not show the same place.
    NothingFits {
        /// The interpretation with the smallest median among those with the points in front, if any.
        closest: Option<Convention>,
    },
    /// Too few matches were measured.
    TooFewMatches,
}

/// The interpretation that fits by the scores of [`super::score_conventions`].
///
/// An interpretation fits if its median is at most `0.5 px + 0.001 · diagonal` and at least half of the points are in
/// front of both cameras. Of those, the declared one is trusted unless its median exceeds 1.5 times that of the best by
/// more than 0.1 px, the noise of feature points; interpretations within that limit are listed as not ruled out.
pub fn fitting_convention(scores: &[ConventionScore], diagonal_px: f64, min_matches: usize) -> ConventionFit {
    let declared = scores.iter().find(|score| score.convention == Convention::Declared);
    if declared.is_none_or(|score| score.matches < min_matches) {
        return ConventionFit::TooFewMatches;
    }
    let mut possible: Vec<_> = scores.iter().filter(|score| score.in_front >= IN_FRONT).collect();
    possible.sort_by(|a, b| a.median_px.total_cmp(&b.median_px));
    let limit = FIT_PX + FIT_DIAGONAL * diagonal_px;
    let closest = possible.first().copied();
    let Some(best) = closest.filter(|score| score.median_px <= limit) else {
        return ConventionFit::NothingFits { closest: closest.map(|score| score.convention) };
    };
    let rivals = possible.iter().filter(|score| score.median_px <= limit && is_rival(score, best));
    let mut names: Vec<Convention> = rivals.map(|score| score.convention).collect();
    let trusted = names.iter().position(|name| *name == Convention::Declared).unwrap_or(0);
    let convention = names.remove(trusted);
    ConventionFit::Fits { convention, not_ruled_out: names }
}

fn is_rival(score: &ConventionScore, best: &ConventionScore) -> bool {
    score.median_px <= RIVAL_FACTOR * best.median_px + NOISE_PX
}

impl fmt::Display for ConventionFit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fits { convention, not_ruled_out } => {
                write!(f, "{}", convention.meaning())?;
                if !not_ruled_out.is_empty() {
                    let names: Vec<&str> = not_ruled_out.iter().map(|convention| convention.name()).collect();
                    write!(f, " (these images do not rule out: {})", names.join(", "))?;
                }
                Ok(())
            }
            Self::NothingFits { closest: Some(closest) } => {
                write!(f, "no interpretation explains the images; {closest} is closest")
            }
            Self::NothingFits { closest: None } => {
                f.write_str("no interpretation explains the images; none puts the points in front of the cameras")
            }
            Self::TooFewMatches => f.write_str("too few matches to judge"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(convention: Convention, median_px: f64, in_front: f64) -> ConventionScore {
        ConventionScore { convention, median_px, in_front, matches: 100 }
    }

    fn fits(convention: Convention, not_ruled_out: &[Convention]) -> ConventionFit {
        ConventionFit::Fits { convention, not_ruled_out: not_ruled_out.to_vec() }
    }

    #[test]
    fn the_declared_interpretation_is_preferred_when_in_doubt() {
        use Convention::{AxesFlipped, Declared, PoseInverted};
        let inverted = |px| score(PoseInverted, px, 1.0);
        let declared = |px| score(Declared, px, 1.0);
        assert_eq!(fitting_convention(&[declared(0.3), inverted(9.0)], 400.0, 50), fits(Declared, &[]));
        assert_eq!(fitting_convention(&[declared(0.3), inverted(0.25)], 400.0, 50), fits(Declared, &[PoseInverted]));
        assert_eq!(fitting_convention(&[declared(9.0), inverted(0.3)], 400.0, 50), fits(PoseInverted, &[]));
        let flipped = score(AxesFlipped, 0.4, 1.0);
        assert_eq!(
            fitting_convention(&[declared(0.8), inverted(0.3), flipped], 400.0, 50),
            fits(PoseInverted, &[AxesFlipped])
        );
    }

    #[test]
    fn differences_below_the_noise_of_feature_points_decide_nothing() {
        use Convention::{AxesFlipped, Declared, PoseInverted};
        let scores = |declared, inverted| [score(Declared, declared, 1.0), score(PoseInverted, inverted, 1.0)];
        assert_eq!(fitting_convention(&scores(0.04, 0.02), 400.0, 50), fits(Declared, &[PoseInverted]));
        assert_eq!(fitting_convention(&scores(0.12, 0.02), 400.0, 50), fits(Declared, &[PoseInverted]), "in the noise");
        assert_eq!(fitting_convention(&scores(0.14, 0.02), 400.0, 50), fits(PoseInverted, &[]), "above the noise");
        let [declared, inverted] = scores(0.3, 0.0);
        let flipped = score(AxesFlipped, 0.09, 1.0);
        let undecided = fits(PoseInverted, &[AxesFlipped]);
        assert_eq!(fitting_convention(&[declared, flipped, inverted], 400.0, 50), undecided);
    }

    #[test]
    fn points_behind_the_cameras_rule_out_an_interpretation() {
        let scores = [score(Convention::Declared, 0.2, 0.01), score(Convention::PoseInverted, 0.2, 0.99)];
        assert_eq!(fitting_convention(&scores, 400.0, 50), fits(Convention::PoseInverted, &[]));
        assert_eq!(fitting_convention(&scores[..1], 400.0, 50), ConventionFit::NothingFits { closest: None });
    }

    #[test]
    fn large_and_nan_medians_do_not_fit() {
        let nothing = ConventionFit::NothingFits { closest: Some(Convention::Declared) };
        assert_eq!(fitting_convention(&[score(Convention::Declared, 1.0, 1.0)], 400.0, 50), nothing);
        let larger_image = fitting_convention(&[score(Convention::Declared, 1.0, 1.0)], 2000.0, 50);
        assert_eq!(larger_image, fits(Convention::Declared, &[]));
        assert_eq!(fitting_convention(&[score(Convention::Declared, f64::NAN, 1.0)], 400.0, 50), nothing);
    }

    #[test]
    fn too_few_matches_fit_nothing() {
        assert_eq!(
            fitting_convention(&[score(Convention::Declared, 0.1, 1.0)], 400.0, 101),
            ConventionFit::TooFewMatches
        );
        assert_eq!(fitting_convention(&[], 400.0, 0), ConventionFit::TooFewMatches);
    }

    #[test]
    fn the_message_names_the_mistake() {
        let message = fits(Convention::PoseInverted, &[]).to_string();
        assert!(message.contains("inverted"), "{message}");
    }
}
