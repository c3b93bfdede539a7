use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The number of frames before and after a window that become targets: 1 to [`Margin::MAX`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "usize", into = "usize")]
pub struct Margin(usize);

/// A margin outside 1 to [`Margin::MAX`].
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("margin: expected 1 to {} frames, found {found}", Margin::MAX)]
pub struct InvalidMargin {
    /// What was given.
    pub found: String,
}

impl Margin {
    /// The largest margin: half a minute of video, far beyond what any paper uses.
    pub const MAX: usize = 1000;

    /// "10 frames before and after the input window" (ATSplat).
    pub const TEN: Self = Self(10);

    /// The number of frames.
    pub const fn get(self) -> usize {
        self.0
    }
}

impl Default for Margin {
    fn default() -> Self {
        Self::TEN
    }
}

impl TryFrom<usize> for Margin {
    type Error = InvalidMargin;

    fn try_from(frames: usize) -> Result<Self, InvalidMargin> {
        let allowed = (1..=Self::MAX).contains(&frames);
        if allowed { Ok(Self(frames)) } else { Err(InvalidMargin { found: frames.to_string() }) }
    }
}

impl From<Margin> for usize {
    fn from(margin: Margin) -> Self {
        margin.0
    }
}

impl FromStr for Margin {
    type Err = InvalidMargin;

    fn from_str(text: &str) -> Result<Self, InvalidMargin> {
        let frames = text.parse::<usize>().ok();
        frames.and_then(|frames| Self::try_from(frames).ok()).ok_or_else(|| InvalidMargin { found: text.to_owned() })
    }
}

impl fmt::Display for Margin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accepts_one_to_a_thousand_frames() {
        for (text, expected) in [("1", Some(1)), ("1000", Some(1000)), ("0", None), ("1001", None), ("-1", None)] {
            assert_eq!(text.parse::<Margin>().ok().map(Margin::get), expected, "{text}");
        }
        let error = "18446744073709551616".parse::<Margin>().unwrap_err().to_string();
        assert_eq!(error, "margin: expected 1 to 1000 frames, found 18446744073709551616");
        assert_eq!(serde_json::from_str::<Margin>("10").unwrap(), Margin::default());
        assert!(serde_json::from_str::<Margin>("0").is_err());
    }
}
