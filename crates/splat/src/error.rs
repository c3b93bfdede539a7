use std::path::PathBuf;

use thiserror::Error;

/// What can go wrong between a file of Gaussians and a picture.
#[derive(Debug, Error)]
pub enum SplatError {
    /// An array of [`crate::GaussianParts`] has the wrong length.
    #[error("Gaussians: {field} has {found} entries, expected {expected}")]
    Length {
        /// Name of the array.
        field: &'static str,
        /// Entries that the other arrays call for.
        expected: usize,
        /// Entries found.
        found: usize,
    },
    /// Spherical harmonics beyond what is implemented.
    #[error("Gaussians: spherical harmonics of degree {found}, expected at most {}", crate::MAX_SH_DEGREE)]
    ShDegree {
        /// Degree found.
        found: u8,
    },
    /// A position outside the list of Gaussians.
    #[error("Gaussians: position {found}, expected below {len}")]
    Position {
        /// Position asked for.
        found: usize,
        /// Number of Gaussians.
        len: usize,
    },
    /// A view that cannot be rendered.
    #[error("view: {what}: expected {expected}, found {found}")]
    View {
        /// What is wrong with it.
        what: &'static str,
        /// What would be right.
        expected: String,
        /// What was there.
        found: String,
    },
    /// Options with a number that no picture can come of.
    #[error("options: {what}: {found}, expected at most {:e} in magnitude", crate::LARGEST_CHANNEL)]
    Options {
        /// Which option.
        what: &'static str,
        /// What was there.
        found: f64,
    },
    /// Constants of a renderer that nothing can be rendered with.
    #[error("constants: {field}: expected {least} to {most}, found {found}")]
    Constants {
        /// Which of [`crate::RendererConstants`], as files spell it.
        field: &'static str,
        /// The smallest that would do.
        least: f64,
        /// The largest that would do.
        most: f64,
        /// What was there.
        found: f64,
    },
    /// A word that names no effect.
    #[error("effects: expected auto, all, none or a list of {}, found {found:?}", known_effects())]
    Effect {
        /// The word.
        found: String,
    },
    /// A tolerance that no effect can keep.
    #[error("effects: tolerance: expected a finite number of at least 0, found {found}")]
    Tolerance {
        /// What was there.
        found: f64,
    },
    /// A file of Gaussians that breaks its format.
    #[error("{path}: {location}: expected {expected}, found {found}")]
    Format {
        /// The file.
        path: PathBuf,
        /// Where in it: a header line, a byte, an element and its property.
        location: String,
        /// What would be right.
        expected: String,
        /// What was there.
        found: String,
    },
    /// A file is what Git LFS leaves in the place of one that was not fetched.
    #[error(
        "{path}: expected Gaussians, found a Git LFS pointer to them: run `git lfs pull` in the repository that it came \
         from"
    )]
    LfsPointer {
        /// The file.
        path: PathBuf,
    },
    /// Reading or writing failed.
    #[error("{action} {path}")]
    Io {
        /// What was being done, as "reading" or "writing".
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's answer.
        #[source]
        source: std::io::Error,
    },
    /// More memory than the caller allows.
    #[error("rendering needs {needed} bytes, the limit is {limit}")]
    Memory {
        /// Estimated bytes.
        needed: u64,
        /// Allowed bytes.
        limit: u64,
    },
    /// A change of the world that is none.
    #[error("similarity: {what}: expected {expected}, found {found}")]
    Similarity {
        /// What of it.
        what: &'static str,
        /// What would be right.
        expected: &'static str,
        /// What was there.
        found: f64,
    },
    /// More of something than its numbering has numbers.
    #[error("rendering: {found} {what}, expected at most {most}")]
    Count {
        /// What is numbered.
        what: &'static str,
        /// Largest count.
        most: u64,
        /// What was there.
        found: u64,
    },
    /// A derivative by an image that is no number to go on with.
    #[error("{image}: expected finite numbers, found {found} at pixel {pixel}")]
    NonFinite {
        /// Which image.
        image: &'static str,
        /// Row by row.
        pixel: usize,
        /// What was there.
        found: f64,
    },
    /// A scalar that cannot be composited.
    #[error("scalars: Gaussian {position}: expected a number within ±{:e}, found {found}", crate::LARGEST_CHANNEL)]
    Scalar {
        /// Among all Gaussians.
        position: usize,
        /// What was there.
        found: f32,
    },
    /// The lens cannot be used.
    #[error(transparent)]
    Camera(#[from] atsplat_camera::CameraError),
    /// The graphics processor failed.
    #[error(transparent)]
    Gpu(#[from] crate::gpu::GpuError),
}

fn known_effects() -> String {
    crate::effects::EFFECTS.map(crate::effects::Effect::name).join(", ")
}
