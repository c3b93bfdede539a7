//! Which row of a trajectory an image belongs to, by the number in its name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::{Frame, SceneError};

/// The naming scheme of a clip's images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Naming {
    /// `<timestamp>.jpg`, as written by `real_estate_10k_tools` (`src/convert.py:69-73`).
    Timestamp,
    /// Row `i` is image `first + i`.
    Numbered { first: i64 },
}

impl Naming {
    /// The naming scheme that finds more of the images in `folder`, whose names without extension are `stems` by their numbers;
    /// timestamps in case of a tie.
    ///
    /// # Errors
    /// [`SceneError::Unrecognized`] if the images fit the rows from several first numbers: with the wrong one, every pose would get
    /// another row's image.
    pub(super) fn of(frames: &[Frame], folder: &Path, stems: &BTreeMap<i64, &str>) -> Result<Self, SceneError> {
        let (Some((least, _)), Some((most, _))) = (stems.first_key_value(), stems.last_key_value()) else {
            return Ok(Self::Timestamp);
        };
        let rows = i64::try_from(frames.len()).unwrap_or(i64::MAX);
        let has = |number: i64| stems.contains_key(&number);
        let by_time = frames.iter().filter(|frame| frame.timestamp_micros.is_some_and(has)).count();
        let firsts = first_numbers(stems, (*least, *most), rows);
        let by_number = firsts.iter().map(|first| stems.range(*first..rows.saturating_add(*first)).count()).max();
        match firsts.as_slice() {
            _ if by_time >= by_number.unwrap_or_default() => Ok(Self::Timestamp),
            [first] => Ok(Self::Numbered { first: *first }),
            several => {
                let readings: Vec<String> = several.iter().map(|first| format!("from {first}")).collect();
                let expected =
                    "images named by timestamp, or numbered so that the number of the first row's image is certain";
                let readings = readings.join(" or ");
                let found = format!("images {least} to {most} for {rows} rows, which may be numbered {readings}");
                Err(SceneError::unrecognized(folder, expected, found))
            }
        }
    }

    /// The number in the name of a row's image.
    pub(super) fn number(self, row: usize, frame: &Frame) -> Option<i64> {
        match self {
            Self::Timestamp => frame.timestamp_micros,
            Self::Numbered { first } => i64::try_from(row).ok().map(|row| row.saturating_add(first)),
        }
    }

    /// The name, without extension, that a missing image would have.
    pub(super) fn expected_stem(self, row: usize, frame: &Frame) -> String {
        match self {
            Self::Timestamp => frame.name.clone(),
            Self::Numbered { first } => format!("{:05}", first.saturating_add_unsigned(row as u64)),
        }
    }
}

/// The numbers that the image of the first row may have, if images are numbered by row.
///
/// As many images as rows, without a gap, are those of the rows, whatever the least number is. With gaps, images are numbered from
/// 0 or 1: which, an image 0 and an image `rows` tell, if only one of them exists. Images that leave this range are numbered from 1
/// or from another number. If rows lack images and most images are beyond the rows, they are numbered by something else, such as the
/// frames of a video: 0, 30, 60.
fn first_numbers(numbers: &BTreeMap<i64, &str>, (least, most): (i64, i64), rows: i64) -> Vec<i64> {
    let whole = first_of_whole_series(numbers, rows);
    if !whole.is_empty() {
        return whole.into_iter().collect();
    }
    let in_range = numbers.range(..=rows).count();
    let is_longer = most.saturating_sub(least) >= rows;
    let has_gaps = i64::try_from(in_range).is_ok_and(|count| count < rows);
    // An image 0 or 1 is the first row's in any case.
    let telling = if least > 1 { in_range } else { in_range.saturating_sub(1) };
    if is_longer && has_gaps && telling <= numbers.len().saturating_sub(in_range) {
        return Vec::new();
    }
    if least > 1 && most > rows {
        if is_longer {
            return vec![1];
        }
        let mut firsts: Vec<i64> = (in_range > 0).then_some(1).into_iter().collect();
        firsts.extend([most.saturating_sub(rows).saturating_add(1), least]);
        firsts.dedup();
        return firsts;
    }
    match (numbers.contains_key(&0), numbers.contains_key(&rows)) {
        (true, false) => vec![0],
        (false, true) => vec![1],
        _ => vec![0, 1],
    }
}

/// The least number of every series of as many images as rows without a gap: of all images, or of those with one text before the
/// number, next to others such as `cover-1`.
fn first_of_whole_series(numbers: &BTreeMap<i64, &str>, rows: i64) -> BTreeSet<i64> {
    let mut by_prefix: BTreeMap<&str, Vec<i64>> = BTreeMap::new();
    for (number, stem) in numbers {
        by_prefix.entry(stem.trim_end_matches(|c: char| c.is_ascii_digit())).or_default().push(*number);
    }
    let all: Vec<i64> = numbers.keys().copied().collect();
    let first_if_whole = |series: &Vec<i64>| {
        let (first, last) = (series.first()?, series.last()?);
        let is_as_long = i64::try_from(series.len()).is_ok_and(|length| length == rows);
        (is_as_long && last.saturating_sub(*first) == rows.saturating_sub(1)).then_some(*first)
    };
    let several = by_prefix.values().filter(|series| series.len() > 1);
    std::iter::once(&all).chain(several).filter_map(first_if_whole).collect()
}
