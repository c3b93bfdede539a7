//! Renders Gaussians along a path of views into image files, and records what the images depend on.

mod exposures;
mod frame_request;
mod frame_timings;
mod frames;
mod images;
mod record;
mod settings;

use atsplat_files::FileError;
use atsplat_pixels::PixelError;
use atsplat_splat::SplatError;
use thiserror::Error;

pub use exposures::{ExposureSource, Exposures, ExposuresError};
pub use frame_request::{FrameRequest, PathRecord, PathSpacing, RenderPlan};
pub use frame_timings::{FrameTiming, FrameTimings};
pub use frames::{Frame, FrameFiles, empty_frames, empty_frames_warning, render_all, unknown_images_warning};
pub use images::{frame_file_name, is_frame_file_name, rendered_exr, rendered_image};
pub use record::{FrameCounts, RENDER_RECORD, Record, RenderFile, Report, ViewRecord};
pub use settings::{RenderSettings, RenderSettingsRecord, ignored_principal_points};

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
