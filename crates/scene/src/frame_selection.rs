use std::collections::BTreeSet;
use std::str::FromStr;

use atsplat_files::InvalidText;
use thiserror::Error;

/// Frames of a scene by their positions, in the order given: `0,29,100..200:10`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameSelection(Vec<Part>);

/// A selection that a scene does not have.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum InvalidSelection {
    /// A position past the last frame.
    #[error("expected positions below {count}, the number of frames, found {position}")]
    Outside {
        /// The position.
        position: usize,
        /// Number of frames.
        count: usize,
    },
    /// A frame is selected twice.
    #[error("position {0} is selected twice")]
    Twice(usize),
}

/// Every `step`-th position from `first`, up to but not including `end`; `None` is the end of the scene.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Part {
    first: usize,
    end: Option<usize>,
    step: usize,
    is_range: bool,
}

impl FromStr for FrameSelection {
    type Err = InvalidText;

    fn from_str(text: &str) -> Result<Self, InvalidText> {
        text.split(',').map(|part| Part::parse(part.trim())).collect::<Result<_, _>>().map(Self)
    }
}

impl Part {
    fn parse(text: &str) -> Result<Self, InvalidText> {
        let number = |text: &str| -> Result<usize, InvalidText> {
            text.parse().map_err(|_not_whole| InvalidText::new("a position such as 7, 3..9 or 3..9:2", text))
        };
        let Some((first, rest)) = text.split_once("..") else {
            let first = number(text)?;
            return Ok(Self { first, end: Some(first.saturating_add(1)), step: 1, is_range: false });
        };
        let (end, step) = rest.split_once(':').map_or((rest, 1), |(end, step)| (end, number(step).unwrap_or(0)));
        if step == 0 {
            return Err(InvalidText::new("a step of at least 1 after the colon", text));
        }
        let first = if first.is_empty() { 0 } else { number(first)? };
        let end = if end.is_empty() { None } else { Some(number(end)?) };
        if end.is_some_and(|end| end <= first) {
            return Err(InvalidText::new("a range whose end is after its start", text));
        }
        Ok(Self { first, end, step, is_range: true })
    }
}

impl FrameSelection {
    /// The selected positions of a scene with `count` frames.
    ///
    /// # Errors
    /// [`InvalidSelection`] for a position that the scene does not have, and for one that is selected twice.
    pub fn of(&self, count: usize) -> Result<Vec<usize>, InvalidSelection> {
        self.of_available(count, |_| true)
    }

    /// As [`Self::of`], but ranges leave out positions that are not available. Those that are given one by one are selected in any
    /// case.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_available(
        &self,
        count: usize,
        is_available: impl Fn(usize) -> bool,
    ) -> Result<Vec<usize>, InvalidSelection> {
        let mut picked = Vec::new();
        let mut seen = BTreeSet::new();
        for part in &self.0 {
            let end = part.end.unwrap_or(count);
            if part.first >= count || end > count {
                let position = if part.first >= count { part.first } else { end - 1 };
                return Err(InvalidSelection::Outside { position, count });
            }
            for position in (part.first..end).step_by(part.step) {
                if !seen.insert(position) {
                    return Err(InvalidSelection::Twice(position));
                }
                if !part.is_range || is_available(position) {
                    picked.push(position);
                }
            }
        }
        Ok(picked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str, count: usize) -> Result<Vec<usize>, InvalidSelection> {
        text.parse::<FrameSelection>().unwrap().of(count)
    }

    #[test]
    fn selects_positions_and_ranges_in_order() {
        assert_eq!(of("7,0, 3", 8).unwrap(), [7, 0, 3]);
        assert_eq!(of("2..5,9", 10).unwrap(), [2, 3, 4, 9]);
        assert_eq!(of("..:4", 10).unwrap(), [0, 4, 8]);
        assert_eq!(of("6..", 9).unwrap(), [6, 7, 8]);
        assert_eq!(of("1..9:3", 9).unwrap(), [1, 4, 7]);
    }

    /// Steps count every position.
    #[test]
    fn ranges_leave_out_what_is_not_available_and_single_positions_do_not() {
        let of = |text: &str| text.parse::<FrameSelection>().unwrap().of_available(8, |at| at != 2 && at != 7).unwrap();
        assert_eq!(of(".."), [0, 1, 3, 4, 5, 6]);
        assert_eq!(of("1..8:3"), [1, 4]);
        assert_eq!(of("2,3..5"), [2, 3, 4]);
        assert!(of("2..3").is_empty());
    }

    #[test]
    fn rejects_malformed_and_out_of_range_selections() {
        for broken in ["", "a", "1,,2", "3..3", "5..2", "1..4:0", "1..4:x", "-1", "1..2..3", "99999999999999999999"] {
            assert!(broken.parse::<FrameSelection>().is_err(), "{broken:?}");
        }
        for outside in ["8", "3..9", "8..", "1..4,3"] {
            assert!(of(outside, 8).is_err(), "{outside:?}");
        }
    }
}
