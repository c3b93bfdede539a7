//! Renders Gaussians along a path of views into image files, and records what the images depend on.

mod exposures;
mod frames;
mod look;
mod record;
mod shot;

use atsplat_files::FileError;
use atsplat_pixels::PixelError;
use atsplat_splat::SplatError;
use thiserror::Error;

pub use exposures::{ExposureSource, Exposures, ExposuresError};
pub use frames::{Frame, FrameFiles, empty_frames_warning, render_all, unknown_images};
pub use look::{Look, LookRecord, ignored_principal_points};
pub use record::{FrameCounts, Record, RenderFile, Report, ViewRecord};
pub use shot::{PathRecord, Plan, Shot};

/// Why images cannot be rendered and written.
#[derive(Debug, Error)]
pub enum RenderingError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// An image cannot be encoded.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// The renderer rejected the scene, a view or options.
    #[error(transparent)]
    Splat(#[from] SplatError),
}
