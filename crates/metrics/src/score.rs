use serde::Serialize;
use thiserror::Error;

use crate::MetricError;
use crate::learned::WeightsAbsent;

/// The result of a metric on a pair.
#[derive(Clone, Debug, PartialEq)]
pub enum Score {
    /// A finite number.
    Value(f64),
    /// The pictures are identical and the number is infinite.
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
    /// The pictures are unsuitable for the metric.
    #[error("not computed: {0}")]
    Pictures(#[from] MetricError),
}

impl Score {
    /// The number; `None` if it is infinite or was not computed.
    pub const fn value(&self) -> Option<f64> {
        match self {
            Self::Value(value) => Some(*value),
            Self::Identical | Self::NotComputed(_) => None,
        }
    }

    /// The number, with `cap` for identical pictures.
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
