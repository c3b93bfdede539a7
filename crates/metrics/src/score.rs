use serde::Serialize;
use thiserror::Error;

use crate::MetricError;
use crate::learned::WeightsAbsent;

/// PSNR in dB that identical images count as in averages, where papers average the infinity. A convention of this toolkit,
/// equal to a root mean square error of 1e-5, far below the step of 8 bits.
pub const DECIBEL_CAP: f64 = 100.0;

/// The result of a metric on a pair.
#[derive(Clone, Debug, PartialEq)]
pub enum Score {
    /// A finite number.
    Value(f64),
    /// The images are identical and the number is infinite.
    Identical,
    /// No number could be computed.
    NotComputed(NotComputed),
}

/// Why there is no number.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum NotComputed {
    /// A learned metric's weights were not found.
    #[error("not computed: {0}")]
    WeightsAbsent(WeightsAbsent),
    /// The images are unsuitable for the metric.
    #[error("not computed: {0}")]
    Images(#[from] MetricError),
}

impl Score {
    /// The number; `None` if it is infinite or was not computed.
    pub const fn value(&self) -> Option<f64> {
        match self {
            Self::Value(value) => Some(*value),
            Self::Identical | Self::NotComputed(_) => None,
        }
    }

    /// The number, with `cap` for identical images.
    pub const fn capped(&self, cap: f64) -> Option<f64> {
        match self {
            Self::Value(value) => Some(*value),
            Self::Identical => Some(cap),
            Self::NotComputed(_) => None,
        }
    }
}

impl From<Result<f64, MetricError>> for Score {
    fn from(outcome: Result<f64, MetricError>) -> Self {
        match outcome {
            Ok(value) => Self::Value(value),
            Err(error) => Self::NotComputed(error.into()),
        }
    }
}

/// Serialises to a number, `"identical"`, or an object with the reason.
impl Serialize for Score {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap;
        match self {
            Self::Value(value) => serializer.serialize_f64(*value),
            Self::Identical => serializer.serialize_str("identical"),
            Self::NotComputed(reason) => {
                let mut map = serializer.serialize_map(Some(1))?;
                map.serialize_entry("not-computed", &reason.to_string())?;
                map.end()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn identical_images_count_as_the_cap_and_missing_scores_do_not() {
        let missing = Score::NotComputed(MetricError::Empty { size: [0, 0] }.into());
        let capped = [Score::Value(20.0), Score::Identical, missing].map(|score| score.capped(DECIBEL_CAP));
        Tolerance::EXACT.assert(capped.into_iter().flatten(), [20.0, 100.0], "in a mean");
    }
}
