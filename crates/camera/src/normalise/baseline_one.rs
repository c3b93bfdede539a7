use super::{Step, accepted};
use crate::{CameraError, WorldFromCamera};

pub(super) const NAME: &str = "baseline-one";

/// The distance between the first and the last context view becomes 1.
pub(super) fn step(
    first: &WorldFromCamera,
    last: &WorldFromCamera,
    minimum: f64,
    maximum: Option<f64>,
) -> Result<Step, CameraError> {
    let baseline = first.centre().distance(last.centre());
    Ok(Step::divided_by(accepted(NAME, baseline, minimum, maximum)?))
}
