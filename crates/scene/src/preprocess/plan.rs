use atsplat_camera::{Camera, CropRect, ImageSize, NormalizedIntrinsics, PrincipalPointRule};
use atsplat_pixels::ImageU8;

use super::{PreprocessError, Resampling};

/// The operations of a preprocessing for one image size.
///
/// Created by [`super::Preprocessing::plan`]; every operation is valid for its input size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    source: ImageSize,
    output: ImageSize,
    principal_point: PrincipalPointRule,
    operations: Vec<Operation>,
}

/// One operation on an image.
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
    /// Maximum pixels that a step may resample to, 16 384 × 16 384, so that a mistake in a preset is an error instead of
    /// an allocation of gigabytes.
    pub const MAX_PIXELS: u64 = 1 << 28;

    /// A plan without operations.
    pub(super) fn untouched(source: ImageSize, principal_point: PrincipalPointRule) -> Result<Self, PreprocessError> {
        not_empty("image", source)?;
        Ok(Self { source, output: source, principal_point, operations: Vec::new() })
    }

    /// Input size.
    pub const fn source(&self) -> ImageSize {
        self.source
    }

    /// Output size.
    pub const fn output(&self) -> ImageSize {
        self.output
    }

    /// The operations in order, none of which is a copy.
    pub fn operations(&self) -> &[Operation] {
        &self.operations
    }

    /// Intrinsics of the output image. Resampling does not change normalised intrinsics; a crop scales the focal
    /// lengths by the *integer* sizes before and after it (455, not 455.11…) and treats the principal point by the
    /// preprocessing's rule (pixelSplat `src/dataset/shims/crop_shim.py`).
    ///
    /// # Errors
    /// [`PreprocessError::Camera`] if a focal length or principal point overflows f64.
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

    /// The camera of the output image: same pose, new intrinsics. Distortion coefficients apply to the `z = 1` plane
    /// and do not change.
    ///
    /// # Errors
    /// Those of [`Self::intrinsics`].
    pub fn camera(&self, source: &Camera) -> Result<Camera, PreprocessError> {
        Ok(Camera { intrinsics: self.intrinsics(&source.intrinsics)?, ..*source })
    }

    /// The output image.
    ///
    /// # Errors
    /// [`PreprocessError::WrongImage`] if the size of `image` is not [`Self::source`], [`PreprocessError::Pixels`] if
    /// resampling fails.
    pub fn apply(&self, image: &ImageU8) -> Result<ImageU8, PreprocessError> {
        let found = ImageSize { width: image.width(), height: image.height() };
        if found != self.source {
            return Err(PreprocessError::WrongImage { expected: self.source, found });
        }
        let Some((first, rest)) = self.operations.split_first() else { return Ok(image.clone()) };
        rest.iter().try_fold(first.apply(image)?, |image, operation| operation.apply(&image))
    }

    /// Adds resampling to `size`, unless it would be a copy (as Pillow's `resize` to the same size is).
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
    fn apply(&self, image: &ImageU8) -> Result<ImageU8, PreprocessError> {
        Ok(match self {
            Self::Resize { size, filter } => atsplat_pixels::resize(image, size.width, size.height, (*filter).into())?,
            Self::Crop(CropRect { column, row, size }) => {
                atsplat_pixels::crop(image, *column, *row, size.width, size.height)?
            }
        })
    }
}

/// [`PreprocessError::Empty`] if a side is 0.
pub(super) fn not_empty(what: &'static str, found: ImageSize) -> Result<(), PreprocessError> {
    if found.width == 0 || found.height == 0 { Err(PreprocessError::Empty { what, found }) } else { Ok(()) }
}
