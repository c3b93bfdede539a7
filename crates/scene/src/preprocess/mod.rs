//! The papers' preprocessing: pictures and intrinsics changed together, by named steps.
//!
//! A [`Preprocessing`] is a list of steps, as a protocol preset writes it. [`Preprocessing::plan`] turns it
//! into a [`Plan`] for one picture size: pure geometry that can be checked, printed and applied to cameras
//! before any picture is decoded.
//!
//! ```
//! use atsplat_camera::{ImageSize, NormalizedIntrinsics};
//! use atsplat_scene::preprocess::{Preprocessing, RescaleAndCrop, Step};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let re10k = Preprocessing::of([Step::from(RescaleAndCrop::new(256, 256))]);
//! let plan = re10k.plan(ImageSize { width: 640, height: 360 })?;
//! let k = plan.intrinsics(&NormalizedIntrinsics::new(0.5, 0.9, 0.5, 0.5)?)?;
//! assert_eq!(k.fx, 0.5 * (455.0 / 256.0));
//! # Ok(())
//! # }
//! ```

mod centre_crop;
mod error;
mod patch_crop;
mod plan;
mod resampling;
mod rescale_and_crop;
mod resize;
mod square_crop;

use std::fmt;

use atsplat_camera::{ImageSize, PrincipalPointRule};
use serde::{Deserialize, Serialize};

pub use centre_crop::CentreCrop;
pub use error::PreprocessError;
pub use patch_crop::PatchCrop;
pub use plan::{Operation, Plan};
pub use resampling::Resampling;
pub use rescale_and_crop::RescaleAndCrop;
pub use resize::Resize;
pub use square_crop::SquareCrop;

/// What happens to every picture and its intrinsics between the file and the method.
///
/// ```toml
/// expected-size = { width = 480, height = 270 }
/// principal-point = "frozen"
/// steps = [{ step = "rescale-and-crop", height = 256, width = 256 }, { step = "patch-crop", multiple = 64 }]
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Preprocessing {
    /// The only size that a picture file may have; any, if absent. The papers' loaders drop scenes of other
    /// shapes in silence (`skip_bad_shape`, depthsplat `src/dataset/dataset_dl3dv.py:211-279`); here it is
    /// [`PreprocessError::UnexpectedSize`], for the caller to count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_size: Option<ImageSize>,
    /// What crops do to the principal point; frozen, as the papers have it, unless stated.
    #[serde(default)]
    pub principal_point: PrincipalPointRule,
    /// Steps in order; none leaves pictures as they are.
    #[serde(default)]
    pub steps: Vec<Step>,
}

/// One step of a [`Preprocessing`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(tag = "step", rename_all = "kebab-case")]
pub enum Step {
    /// Scale until the target just fits inside, then crop the centre.
    RescaleAndCrop(RescaleAndCrop),
    /// Crop the centre to multiples of a patch size.
    PatchCrop(PatchCrop),
    /// Crop the centre to a size.
    CentreCrop(CentreCrop),
    /// Crop the largest centred square.
    SquareCrop(SquareCrop),
    /// Scale both sides, whatever that does to the aspect ratio.
    Resize(Resize),
}

impl Preprocessing {
    /// These steps, for pictures of any size, with the principal point frozen as the papers have it.
    pub fn of(steps: impl IntoIterator<Item = Step>) -> Self {
        Self { steps: steps.into_iter().collect(), ..Self::default() }
    }

    /// What the steps do to a picture of `source` size, in pixels. Resampling to the size that a picture
    /// already has and crops of all of it are left out: both are copies.
    ///
    /// # Errors
    /// [`PreprocessError::UnexpectedSize`] where `source` is not [`Self::expected_size`]; other
    /// [`PreprocessError`]s where a step does not fit its picture.
    pub fn plan(&self, source: ImageSize) -> Result<Plan, PreprocessError> {
        if let Some(expected) = self.expected_size
            && expected != source
        {
            return Err(PreprocessError::UnexpectedSize { expected, found: source });
        }
        let mut plan = Plan::untouched(source, self.principal_point)?;
        for step in &self.steps {
            match step {
                Step::RescaleAndCrop(step) => step.extend(&mut plan)?,
                Step::PatchCrop(step) => step.extend(&mut plan)?,
                Step::CentreCrop(step) => step.extend(&mut plan)?,
                Step::SquareCrop(step) => step.extend(&mut plan)?,
                Step::Resize(step) => step.extend(&mut plan)?,
            }
        }
        Ok(plan)
    }
}

impl fmt::Display for Preprocessing {
    /// One line with every parameter: equal lines mean equal preprocessing.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(size) = self.expected_size {
            write!(f, "only {size}: ")?;
        }
        if self.steps.is_empty() {
            write!(f, "as it is")?;
        }
        for (position, step) in self.steps.iter().enumerate() {
            let separator = if position == 0 { "" } else { ", then " };
            match step {
                Step::RescaleAndCrop(step) => write!(f, "{separator}{step}")?,
                Step::PatchCrop(step) => write!(f, "{separator}{step}")?,
                Step::CentreCrop(step) => write!(f, "{separator}{step}")?,
                Step::SquareCrop(step) => write!(f, "{separator}{step}")?,
                Step::Resize(step) => write!(f, "{separator}{step}")?,
            }
        }
        let rule = match self.principal_point {
            PrincipalPointRule::Frozen => "frozen",
            PrincipalPointRule::Corrected => "corrected",
        };
        write!(f, "; principal point {rule}")
    }
}

macro_rules! step_from {
    ($($step:ident),*) => {$(
        impl From<$step> for Step {
            fn from(step: $step) -> Self {
                Self::$step(step)
            }
        }
    )*};
}

step_from!(RescaleAndCrop, PatchCrop, CentreCrop, SquareCrop, Resize);

#[cfg(test)]
mod tests;
