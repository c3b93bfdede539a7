use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// Adaptive Token Expansion: settings shared by all blocks (paper, "Adaptive Token Expansion").
///
/// A selected token becomes `children` tokens `f + Δf_m` with `[Δf_1, …] = W f`, all at the parent's anchor.
/// The output is the unselected tokens in order, then the children of the selected ones in order of parent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ExpansionConfig {
    /// Children of an expanded token; `M` = 2 in the paper.
    pub children: usize,
    /// Selection, a row of the paper's ablation.
    pub selection: Selection,
    /// Rounding of a ratio's number of tokens.
    pub ratio_rounding: RatioRounding,
}

/// How tokens are selected; ties go to the lower index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum Selection {
    /// The highest predicted uncertainty: the paper's. The scores' input is detached, so that only the
    /// uncertainty loss trains them.
    Uncertainty {},
    /// The highest random numbers, which depend on this seed, the call's seed, block and token index.
    Random {
        /// Seed.
        seed: u64,
    },
    /// Farthest point sampling of anchors, from the first.
    FarthestPoint {},
    /// The highest score, trained by the rendering loss through a straight-through estimator (Bengio et al.
    /// 2013; Generative Densification): children are multiplied by `1 + s − stop(s)`, which is 1.
    StraightThrough {},
}

/// The predicted scores of a selection, and what trains them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scoring {
    /// There are none.
    None,
    /// Predicted from detached tokens: only the uncertainty loss trains them.
    Detached,
    /// Predicted from the tokens themselves, and multiplied into children by a straight-through estimator.
    StraightThrough,
}

impl Selection {
    /// The name in configurations.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uncertainty {} => "uncertainty",
            Self::Random { .. } => "random",
            Self::FarthestPoint {} => "farthest-point",
            Self::StraightThrough {} => "straight-through",
        }
    }

    /// Its predicted scores.
    pub const fn scoring(self) -> Scoring {
        match self {
            Self::Uncertainty {} => Scoring::Detached,
            Self::Random { .. } | Self::FarthestPoint {} => Scoring::None,
            Self::StraightThrough {} => Scoring::StraightThrough,
        }
    }

    /// Whether tokens are selected by a predicted score.
    pub const fn is_scored(self) -> bool {
        match self.scoring() {
            Scoring::None => false,
            Scoring::Detached | Scoring::StraightThrough => true,
        }
    }

    /// Whether it compares the positions of tokens, which designs without anchors do not have.
    pub const fn needs_anchors(self) -> bool {
        match self {
            Self::FarthestPoint {} => true,
            Self::Uncertainty {} | Self::Random { .. } | Self::StraightThrough {} => false,
        }
    }
}

/// How many tokens a block expands; in TOML, `{ ratio = 0.5 }` or `{ threshold = 0.05 }`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlockExpansion {
    /// A share of the tokens: `ρ`.
    Ratio(SelectionRatio),
    /// All tokens with an uncertainty above a threshold: `τ`.
    Threshold(f64),
}

/// Rounding of a number of tokens. The paper's table does not determine it: all its products are whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RatioRounding {
    /// Up: Generative Densification, of the same laboratory (`point_decoder/autoencoder.py:525`).
    Ceil,
    /// Down.
    Floor,
}

/// A share between 0 and 1 in millionths, so that `ρ · N` is exact: in floats, 0.55 of 100 is more than 55.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SelectionRatio {
    millionths: u32,
}

impl SelectionRatio {
    const WHOLE: u32 = 1_000_000;
    /// The ratio of the first expanding block at high resolution (paper, "High-Resolution Novel-View Synthesis").
    pub const FOUR_FIFTHS: Self = Self { millionths: 800_000 };

    /// The share nearest to `ratio`; `None` unless it is within 1e-9 of a number of millionths from 0 to 1.
    pub fn new(ratio: f64) -> Option<Self> {
        let scaled = ratio * f64::from(Self::WHOLE);
        let whole = scaled.round();
        let fits = (0.0..=f64::from(Self::WHOLE)).contains(&whole) && (scaled - whole).abs() < 1e-3;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number up to a million")]
        fits.then_some(Self { millionths: whole as u32 })
    }

    /// The share as a number from 0 to 1.
    pub fn value(self) -> f64 {
        f64::from(self.millionths) / f64::from(Self::WHOLE)
    }

    /// This share of `tokens`, as a number of tokens.
    #[expect(clippy::expect_used, reason = "a share of at most 1")]
    pub fn of(self, tokens: usize, rounding: RatioRounding) -> usize {
        let product = tokens as u128 * u128::from(self.millionths);
        let whole = u128::from(Self::WHOLE);
        let count = match rounding {
            RatioRounding::Ceil => product.div_ceil(whole),
            RatioRounding::Floor => product / whole,
        };
        usize::try_from(count).expect("at most as many as the tokens")
    }
}

impl Serialize for SelectionRatio {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(self.value())
    }
}

impl<'de> Deserialize<'de> for SelectionRatio {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let ratio = f64::deserialize(deserializer)?;
        Self::new(ratio).ok_or_else(|| {
            de::Error::custom(format!("{ratio}, expected a ratio from 0 to 1 with at most six decimals"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selections_say_their_name_their_scores_and_whether_they_need_anchors() {
        for (selection, name, scoring, needs_anchors) in [
            (Selection::Uncertainty {}, "uncertainty", Scoring::Detached, false),
            (Selection::Random { seed: 3 }, "random", Scoring::None, false),
            (Selection::FarthestPoint {}, "farthest-point", Scoring::None, true),
            (Selection::StraightThrough {}, "straight-through", Scoring::StraightThrough, false),
        ] {
            let kind = serde_json::to_value(selection).unwrap()["kind"].clone();
            assert_eq!((selection.name(), &kind), (name, &serde_json::json!(name)));
            assert_eq!((selection.scoring(), selection.needs_anchors()), (scoring, needs_anchors), "{name}");
            assert_eq!(selection.is_scored(), scoring != Scoring::None, "{name}");
        }
    }
}
