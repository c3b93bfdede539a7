//! The papers' preprocessing, applied to images and intrinsics together.
//!
//! A [`Preprocessing`] is a list of named steps, as written in a protocol preset. [`Preprocessing::plan`] converts it to
//! a [`Plan`] for one image size: pure geometry that can be checked, printed and applied to cameras before any image
//! is decoded.
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
pub use rescale_and_crop::RescaleAndCrop;
pub use resize::{Resampling, Resize};
pub use square_crop::SquareCrop;

/// The steps applied to every image and its intrinsics between the file and the method.
///
/// ```toml
/// expected-size = { width = 480, height = 270 }
/// principal-point = "frozen"
/// steps = [{ step = "rescale-and-crop", height = 256, width = 256 }, { step = "patch-crop", multiple = 64 }]
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Preprocessing {
    /// The required size of image files; any, if absent. The papers' loaders silently drop scenes of other shapes
    /// (`skip_bad_shape`, depthsplat `src/dataset/dataset_dl3dv.py:211-279`); here they are
    /// [`PreprocessError::UnexpectedSize`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_size: Option<ImageSize>,
    /// How crops treat the principal point; by default frozen, as in the papers.
    #[serde(default)]
    pub principal_point: PrincipalPointRule,
    /// Steps in order; without any, images are unchanged.
    #[serde(default)]
    pub steps: Vec<Step>,
}

/// One step of a [`Preprocessing`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(tag = "step", rename_all = "kebab-case")]
pub enum Step {
    /// Scale to the smallest size that covers the target, then crop the centre.
    RescaleAndCrop(RescaleAndCrop),
    /// Crop the centre to multiples of a patch size.
    PatchCrop(PatchCrop),
    /// Crop the centre to a size.
    CentreCrop(CentreCrop),
    /// Crop to the largest centred square.
    SquareCrop(SquareCrop),
    /// Scale to a size without keeping the aspect ratio.
    Resize(Resize),
}

impl Preprocessing {
    /// These steps for images of any size, with the principal point frozen as in the papers.
    pub fn of(steps: impl IntoIterator<Item = Step>) -> Self {
        Self { steps: steps.into_iter().collect(), ..Self::default() }
    }

    /// The operations on an image of size `source`, in pixels, without those that would be copies: resampling to the
    /// same size and crops of the whole image.
    ///
    /// # Errors
    /// [`PreprocessError::UnexpectedSize`] if `source` is not [`Self::expected_size`]; other [`PreprocessError`]s if a
    /// step cannot be applied to its input size.
    pub fn plan(&self, source: ImageSize) -> Result<Plan, PreprocessError> {
        if let Some(expected) = self.expected_size
            && expected != source
        {
            return Err(PreprocessError::UnexpectedSize { expected, found: source });
        }
        let mut plan = Plan::untouched(source, self.principal_point)?;
        for step in &self.steps {
            step.extend(&mut plan)?;
        }
        Ok(plan)
    }
}

impl fmt::Display for Preprocessing {
    /// One line with all parameters, so that equal lines mean equal preprocessing.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(size) = self.expected_size {
            write!(f, "only {size}: ")?;
        }
        if self.steps.is_empty() {
            write!(f, "as it is")?;
        }
        for (position, step) in self.steps.iter().enumerate() {
            let separator = if position == 0 { "" } else { ", then " };
            write!(f, "{separator}{step}")?;
        }
        let rule = match self.principal_point {
            PrincipalPointRule::Frozen => "frozen",
            PrincipalPointRule::Corrected => "corrected",
        };
        write!(f, "; principal point {rule}")
    }
}

macro_rules! steps {
    ($($step:ident),*) => {
        impl Step {
            fn extend(&self, plan: &mut Plan) -> Result<(), PreprocessError> {
                match self {
                    $(Self::$step(step) => step.extend(plan),)*
                }
            }
        }

        impl fmt::Display for Step {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$step(step) => step.fmt(f),)*
                }
            }
        }

        $(impl From<$step> for Step {
            fn from(step: $step) -> Self {
                Self::$step(step)
            }
        })*
    };
}

steps!(RescaleAndCrop, PatchCrop, CentreCrop, SquareCrop, Resize);

#[cfg(test)]
mod tests;
