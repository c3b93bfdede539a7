use atsplat_numeric::Extremes;

use super::{Step, accepted};
use crate::{CameraError, WorldFromCamera};

pub(super) const NAME: &str = "max-pairwise";

/// The largest distance between two context views becomes 1.
pub(super) fn step(context: &[WorldFromCamera], minimum: f64, maximum: Option<f64>) -> Result<Step, CameraError> {
    let pairs = context.iter().enumerate().flat_map(|(i, a)| context[i + 1..].iter().map(move |b| (a, b)));
    let largest = pairs.fold(0.0f64, |largest, (a, b)| largest.maximum_of(a.centre().distance(b.centre())));
    Ok(Step::divided_by(accepted(NAME, largest, minimum, maximum)?))
}
