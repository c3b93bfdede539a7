use std::path::PathBuf;

use atsplat_files::FileError;
use thiserror::Error;

/// Errors of reading, editing, rendering and writing Gaussians.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum SplatError {
    /// An array of [`crate::GaussianParts`] has the wrong length.
    #[error("Gaussians: {field} has {found} entries, expected {expected}")]
    Length { field: &'static str, expected: usize, found: usize },
    /// Packed harmonics that were packed from other Gaussians.
    #[error("packed harmonics: expected those of the Gaussians to render, found others at position {position}")]
    OtherHarmonics {
        /// The first Gaussian that was compared and differs.
        position: usize,
    },
    /// Spherical harmonics beyond what is implemented.
    #[error("Gaussians: spherical harmonics of degree {found}, expected at most {}", crate::MAX_SH_DEGREE)]
    ShDegree { found: u8 },
    /// An index out of range.
    #[error("Gaussians: position {found}, expected below {len}")]
    Position { found: usize, len: usize },
    /// A view that cannot be rendered.
    #[error("view: {what}: expected {expected}, found {found}")]
    View { what: &'static str, expected: String, found: String },
    /// A render option out of range.
    #[error("options: {what}: {found}, expected at most {:e} in magnitude", crate::LARGEST_CHANNEL)]
    Options { what: &'static str, found: f64 },
    /// A renderer constant out of range.
    #[error("constants: {field}: expected {least} to {most}, found {found}")]
    Constants {
        /// Field of [`crate::RendererConstants`], as spelled in files.
        field: &'static str,
        least: f64,
        most: f64,
        found: f64,
    },
    /// An unknown effect name.
    #[error("effects: expected auto, all, none or a list of {}, found {found:?}", known_effects())]
    Effect { found: String },
    /// A negative or non-finite tolerance.
    #[error("effects: tolerance: expected a finite number of at least 0, found {found}")]
    Tolerance { found: f64 },
    /// A malformed file of Gaussians.
    #[error("{path}: {location}: expected {expected}, found {found}")]
    Format {
        path: PathBuf,
        /// Where in it: a header line, a byte, an element and its property.
        location: String,
        expected: String,
        found: String,
    },
    /// A Git LFS pointer in place of a file that was not fetched.
    #[error("{path}: expected Gaussians, found a Git LFS pointer: run `git lfs pull` in the repository it came from")]
    LfsPointer { path: PathBuf },
    /// Reading or writing failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// Rendering would need more memory than the limit.
    #[error("rendering needs {needed} bytes, the limit is {limit}")]
    Memory {
        /// Estimated bytes.
        needed: u64,
        limit: u64,
    },
    /// A transform that is not a similarity.
    #[error("similarity: {what}: expected {expected}, found {found}")]
    Similarity { what: &'static str, expected: &'static str, found: f64 },
    /// A count that overflows its index type.
    #[error("rendering: {found} {what}, expected at most {most}")]
    Count { what: &'static str, most: u64, found: u64 },
    /// An image is missing, was not requested, or has another size than requested.
    #[error("{image}: expected {expected}, found {found}")]
    Image {
        image: &'static str,
        /// What was requested: its number of pixels, or no image.
        expected: String,
        found: String,
    },
    /// An image gradient with a NaN or infinite value.
    #[error("{image}: expected finite numbers, found {found} at pixel {pixel}")]
    NonFinite {
        image: &'static str,
        /// Row-major pixel index.
        pixel: usize,
        found: f64,
    },
    /// The lens is invalid.
    #[error(transparent)]
    Camera(#[from] atsplat_camera::CameraError),
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] crate::gpu::GpuError),
}

fn known_effects() -> String {
    crate::effects::EFFECTS.map(crate::effects::Effect::name).join(", ")
}
