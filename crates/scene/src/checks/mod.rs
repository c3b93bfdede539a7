//! What is probably wrong with a dataset although its format allows it: cameras, lenses, images that do not fit their cameras,
//! images that were cut short, and scenes that an opened dataset leaves out.

pub(crate) mod cameras;
pub(crate) mod cut_short;
pub(crate) mod ignored;
pub(crate) mod image_mismatch;
pub(crate) mod intrinsics_unit;
pub(crate) mod lens_end;
pub(crate) mod outlier_cameras;
pub(crate) mod still_cameras;
pub(crate) mod unposed;
