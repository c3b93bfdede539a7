use atsplat_camera::{Camera, CropRect, ImageSize, NormalizedIntrinsics, PrincipalPointRule};
use atsplat_pixels::ImageU8;

use super::{PreprocessError, Resampling};

/// A preprocessing worked out for one picture size: which pixels are resampled and cut, in order.
///
/// Made by [`super::Preprocessing::plan`]; every operation fits the picture that reaches it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    source: ImageSize,
    output: ImageSize,
    principal_point: PrincipalPointRule,
    operations: Vec<Operation>,
}

/// One change of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Resample to a size.
    Resize {
        /// The new size.
        size: ImageSize,
        /// Pillow's filter.
        filter: Resampling,
    },
    /// Keep a rectangle.
    Crop(CropRect),
}

impl Plan {
    /// Most pixels that a step may resample to, 16 384 × 16 384: a preset's typing error is an error, not an
    /// allocation of gigabytes.
    pub const MAX_PIXELS: u64 = 1 << 28;

    /// The picture as it is.
    pub(super) fn untouched(source: ImageSize, principal_point: PrincipalPointRule) -> Result<Self, PreprocessError> {
        not_empty("picture", source)?;
        Ok(Self { source, output: source, principal_point, operations: Vec::new() })
    }

    /// Size of the pictures that the plan is for.
    pub const fn source(&self) -> ImageSize {
        self.source
    }

    /// Size of the pictures that come out.
    pub const fn output(&self) -> ImageSize {
        self.output
    }

    /// What happens, in order; nothing that would be a copy.
    pub fn operations(&self) -> &[Operation] {
        &self.operations
    }

    /// Intrinsics of the picture that comes out. Resampling changes no normalised number; a crop scales the
    /// focal lengths by the *whole* sizes before and after it (455, not 455.11…) and treats the principal
    /// point by the preprocessing's rule (pixelSplat `src/dataset/shims/crop_shim.py`).
    ///
    /// # Errors
    /// [`PreprocessError::Camera`] where a focal length or principal point leaves the range of f64.
    pub fn intrinsics(&self, source: &NormalizedIntrinsics) -> Result<NormalizedIntrinsics, PreprocessError> {
        let mut size = self.source;
        let mut k = *source;
        for operation in &self.operations {
            match operation {
                Operation::Resize { size: new, .. } => size = *new,
                Operation::Crop(crop) => {
                    k = k.cropped(size, *crop, self.principal_point)?;
                    size = crop.size;
                }
            }
        }
        Ok(NormalizedIntrinsics::new(k.fx, k.fy, k.cx, k.cy)?)
    }

    /// The camera of the picture that comes out: same pose, new intrinsics. Distortion coefficients act on
    /// the `z = 1` plane, so they stay.
    ///
    /// # Errors
    /// As [`Self::intrinsics`].
    pub fn camera(&self, source: &Camera) -> Result<Camera, PreprocessError> {
        Ok(Camera { intrinsics: self.intrinsics(&source.intrinsics)?, ..*source })
    }

    /// The picture that comes out.
    ///
    /// # Errors
    /// [`PreprocessError::WrongPicture`] where `picture` has another size than [`Self::source`],
    /// [`PreprocessError::Pixels`] where resampling fails.
    pub fn apply(&self, picture: &ImageU8) -> Result<ImageU8, PreprocessError> {
        let found = ImageSize { width: picture.width(), height: picture.height() };
        if found != self.source {
            return Err(PreprocessError::WrongPicture { expected: self.source, found });
        }
        let Some((first, rest)) = self.operations.split_first() else { return Ok(picture.clone()) };
        rest.iter().try_fold(first.apply(picture)?, |picture, operation| operation.apply(&picture))
    }

    /// Adds resampling to `size`, unless it would be a copy (Pillow's `resize` to the same size is one).
    pub(super) fn resize(
        &mut self,
        step: &'static str,
        size: ImageSize,
        filter: Resampling,
    ) -> Result<(), PreprocessError> {
        not_empty(step, size)?;
        if u64::from(size.width) * u64::from(size.height) > Self::MAX_PIXELS {
            return Err(PreprocessError::TooLarge { step, wanted: size, limit: Self::MAX_PIXELS });
        }
        if size != self.output {
            self.operations.push(Operation::Resize { size, filter });
            self.output = size;
        }
        Ok(())
    }

    /// Adds a centred crop, the half-pixel of an odd margin rounded down.
    pub(super) fn crop_centre(&mut self, step: &'static str, size: ImageSize) -> Result<(), PreprocessError> {
        not_empty(step, size)?;
        if size.width > self.output.width || size.height > self.output.height {
            return Err(PreprocessError::TooSmall { step, wanted: size, found: self.output });
        }
        if size != self.output {
            self.operations.push(Operation::Crop(CropRect::centred(self.output, size)?));
            self.output = size;
        }
        Ok(())
    }
}

impl Operation {
    fn apply(&self, picture: &ImageU8) -> Result<ImageU8, PreprocessError> {
        Ok(match self {
            Self::Resize { size, filter } => {
                atsplat_pixels::resize(picture, size.width, size.height, (*filter).into())?
            }
            Self::Crop(CropRect { column, row, size }) => {
                atsplat_pixels::crop(picture, *column, *row, size.width, size.height)?
            }
        })
    }
}

/// `Ok` where both sides have a pixel.
pub(super) fn not_empty(what: &'static str, found: ImageSize) -> Result<(), PreprocessError> {
    if found.width == 0 || found.height == 0 { Err(PreprocessError::Empty { what, found }) } else { Ok(()) }
}
