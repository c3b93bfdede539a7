use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// Adaptive Token Expansion: what all blocks share (paper, "Adaptive Token Expansion").
///
/// A selected token becomes `children` tokens `f + Δf_m` with `[Δf_1, …] = W f`, all at the parent's anchor.
/// What goes on is the unselected tokens in order, then the children of the selected ones in order of parent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ExpansionConfig {
    /// Tokens that an expanded one becomes; `M` = 2 in the paper.
    pub children: usize,
    /// The row of the paper's ablation.
    pub selection: Selection,
    /// What becomes of a ratio's fraction of a token.
    pub ratio_rounding: RatioRounding,
}

/// How tokens are chosen; of equals, the one of lower index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum Selection {
    /// The highest predicted uncertainty: the paper's. The scores' input is detached, so that only the
    /// uncertainty loss trains them.
    Uncertainty {},
    /// The highest of as many random numbers, which depend on this seed, the call's seed, block and token index.
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

/// How many tokens a block expands; in TOML, `{ ratio = 0.5 }` or `{ threshold = 0.05 }`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlockExpansion {
    /// A share of them: `ρ`.
    Ratio(SelectionRatio),
    /// All whose uncertainty exceeds it: `τ`.
    Threshold(f64),
}

/// What becomes of a fraction of a token. The paper's table does not tell: all its products are whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RatioRounding {
    /// One more: Generative Densification, of the same laboratory (`point_decoder/autoencoder.py:525`).
    Ceil,
    /// None.
    Floor,
}

/// A share between 0 and 1 in millionths, so that `ρ · N` is exact: in floats, 0.55 of 100 is more than 55.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SelectionRatio {
    millionths: u32,
}

impl SelectionRatio {
    const WHOLE: u32 = 1_000_000;
    /// Of the first block that expands at high resolution (paper, supplement, "High-Resolution").
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

    /// How many of `tokens` it is.
    pub fn of(self, tokens: usize, rounding: RatioRounding) -> usize {
        let product = tokens as u128 * u128::from(self.millionths);
        let whole = u128::from(Self::WHOLE);
        let count = match rounding {
            RatioRounding::Ceil => product.div_ceil(whole),
            RatioRounding::Floor => product / whole,
        };
        usize::try_from(count).unwrap_or(tokens)
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
