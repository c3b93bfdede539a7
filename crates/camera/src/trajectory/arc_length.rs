use atsplat_numeric::GAUSS_LEGENDRE;

use super::{Segment, shares};
use crate::CameraError;
use crate::error::finite;

/// Tolerance of a piece's length, relative to its segment's.
const TOLERANCE: f64 = 1e-10;
/// Maximum depth of subdivision: a piece of 2⁻²⁰ of a segment is short enough for any shape.
const MAX_SPLITS: u32 = 20;
const BISECTIONS: u32 = 60;

/// A part of one segment, `u` from `start` to `end`, that starts at the distance `before` along the path.
struct Piece<'a> {
    segment: &'a Segment,
    start: f64,
    end: f64,
    before: f64,
    length: f64,
}

/// Length of the path of centres; not finite if that of a segment is not.
pub(super) fn total(segments: &[Segment]) -> f64 {
    pieces(segments).last().map_or(0.0, |piece| piece.before + piece.length)
}

/// `count` times from first to last at equal distances along the path; `None` if its length is 0. `end` is the last time: its
/// segment's start plus duration would be rounded.
///
/// # Errors
/// [`CameraError::NonFinite`] for a length that is not finite.
pub(super) fn even_times(segments: &[Segment], end: f64, count: usize) -> Result<Option<Vec<f64>>, CameraError> {
    let pieces = pieces(segments);
    let Some(last) = pieces.last() else { return Ok(None) };
    let total = finite("length of the path", last.before + last.length)?;
    if total <= 0.0 {
        return Ok(None);
    }
    let time = |share: f64| {
        if share >= 1.0 {
            return end;
        }
        let distance = share * total;
        let index = pieces.partition_point(|piece| piece.before + piece.length < distance);
        let piece = pieces.get(index).unwrap_or(last);
        piece.segment.start + piece.segment.duration * piece.position(distance - piece.before)
    };
    Ok(Some(shares(count).map(time).collect()))
}

impl Piece<'_> {
    /// The `u` at the distance `distance` from the start of the piece, by bisection.
    fn position(&self, distance: f64) -> f64 {
        let (mut low, mut high) = (self.start, self.end);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if length(self.segment, self.start, middle) < distance {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}

fn pieces(segments: &[Segment]) -> Vec<Piece<'_>> {
    let mut pieces = Vec::new();
    for segment in segments {
        let slack = TOLERANCE * length(segment, 0.0, 1.0);
        split(segment, 0.0, 1.0, slack, MAX_SPLITS, &mut pieces);
    }
    let mut distance = 0.0;
    for piece in &mut pieces {
        piece.before = distance;
        distance += piece.length;
    }
    pieces
}

/// Halves a piece until its length agrees with that of its halves, or is not finite. Many halvings are needed only where the centre
/// stops and reverses; elsewhere the speed is smooth.
fn split<'a>(segment: &'a Segment, start: f64, end: f64, slack: f64, splits_left: u32, pieces: &mut Vec<Piece<'a>>) {
    let middle = 0.5 * (start + end);
    let whole = length(segment, start, end);
    let halves = length(segment, start, middle) + length(segment, middle, end);
    if splits_left == 0 || !whole.is_finite() || (whole - halves).abs() <= slack {
        pieces.push(Piece { segment, start, end, before: 0.0, length: whole });
    } else {
        split(segment, start, middle, slack, splits_left - 1, pieces);
        split(segment, middle, end, slack, splits_left - 1, pieces);
    }
}

fn length(segment: &Segment, start: f64, end: f64) -> f64 {
    let (middle, half) = (0.5 * (start + end), 0.5 * (end - start));
    GAUSS_LEGENDRE.iter().map(|(x, weight)| weight * segment.speed(middle + half * x)).sum::<f64>() * half
}
