use super::{At, Changes, Density, DensityError};
use crate::Scene;

/// No density control: the Gaussians of the start are refined.
#[derive(Clone, Copy, Debug)]
pub struct Fixed;

impl Density for Fixed {
    fn after_step(&mut self, _scene: &mut Scene, _at: &At) -> Result<Changes, DensityError> {
        Ok(Changes::default())
    }
}
