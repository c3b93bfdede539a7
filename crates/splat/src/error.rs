use std::path::PathBuf;

use atsplat_files::FileError;
use thiserror::Error;

/// Errors of reading, editing, rendering and writing Gaussians.
#[derive(Debug, Error)]
pub enum SplatError {
    /// An array of [`crate::GaussianParts`] has the wrong length.
    #[error("Gaussians: {field} has {found} entries, expected {expected}")]
    Length {
        /// Name of the array.
        field: &'static str,
        /// Entries required by the other arrays.
        expected: usize,
        /// Entries found.
        found: usize,
    },
    /// Packed harmonics that were packed from other Gaussians.
    #[error("packed harmonics: expected those of the Gaussians to render, found others at position {position}")]
    OtherHarmonics {
        /// The first Gaussian that was compared and differs.
        position: usize,
    },
    /// Spherical harmonics beyond what is implemented.
    #[error("Gaussians: spherical harmonics of degree {found}, expected at most {}", crate::MAX_SH_DEGREE)]
    ShDegree {
        /// Degree found.
        found: u8,
    },
    /// An index out of range.
    #[error("Gaussians: position {found}, expected below {len}")]
    Position {
        /// The index.
        found: usize,
        /// Number of Gaussians.
        len: usize,
    },
    /// A view that cannot be rendered.
    #[error("view: {what}: expected {expected}, found {found}")]
    View {
        /// The invalid property.
        what: &'static str,
        /// The accepted values.
        expected: String,
        /// The value found.
        found: String,
    },
    /// A render option out of range.
    #[error("options: {what}: {found}, expected at most {:e} in magnitude", crate::LARGEST_CHANNEL)]
    Options {
        /// Which option.
        what: &'static str,
        /// The value found.
        found: f64,
    },
    /// A renderer constant out of range.
    #[error("constants: {field}: expected {least} to {most}, found {found}")]
    Constants {
        /// Field of [`crate::RendererConstants`], as spelled in files.
        field: &'static str,
        /// Smallest accepted value.
        least: f64,
        /// Largest accepted value.
        most: f64,
        /// The value found.
        found: f64,
    },
    /// An unknown effect name.
    #[error("effects: expected auto, all, none or a list of {}, found {found:?}", known_effects())]
    Effect {
        /// The name.
        found: String,
    },
    /// A negative or non-finite tolerance.
    #[error("effects: tolerance: expected a finite number of at least 0, found {found}")]
    Tolerance {
        /// The value found.
        found: f64,
    },
    /// A malformed file of Gaussians.
    #[error("{path}: {location}: expected {expected}, found {found}")]
    Format {
        /// The file.
        path: PathBuf,
        /// Where in it: a header line, a byte, an element and its property.
        location: String,
        /// The accepted values.
        expected: String,
        /// The value found.
        found: String,
    },
    /// A Git LFS pointer in place of a file that was not fetched.
    #[error("{path}: expected Gaussians, found a Git LFS pointer: run `git lfs pull` in the repository it came from")]
    LfsPointer {
        /// The file.
        path: PathBuf,
    },
    /// Reading or writing failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// Rendering would need more memory than the limit.
    #[error("rendering needs {needed} bytes, the limit is {limit}")]
    Memory {
        /// Estimated bytes.
        needed: u64,
        /// Allowed bytes.
        limit: u64,
    },
    /// A transform that is not a similarity.
    #[error("similarity: {what}: expected {expected}, found {found}")]
    Similarity {
        /// The invalid property.
        what: &'static str,
        /// The accepted values.
        expected: &'static str,
        /// The value found.
        found: f64,
    },
    /// A count that overflows its index type.
    #[error("rendering: {found} {what}, expected at most {most}")]
    Count {
        /// What is counted.
        what: &'static str,
        /// Largest count.
        most: u64,
        /// The value found.
        found: u64,
    },
    /// An image is missing, was not requested, or has another size than requested.
    #[error("{image}: expected {expected}, found {found}")]
    Image {
        /// Which image.
        image: &'static str,
        /// What was requested: its number of pixels, or no image.
        expected: String,
        /// What was rendered.
        found: String,
    },
    /// An image gradient with a NaN or infinite value.
    #[error("{image}: expected finite numbers, found {found} at pixel {pixel}")]
    NonFinite {
        /// Which image.
        image: &'static str,
        /// Row-major pixel index.
        pixel: usize,
        /// The value found.
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
