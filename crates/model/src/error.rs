use std::path::PathBuf;

use atsplat_files::{FileError, Malformed};
use atsplat_tensors::TensorError;
use thiserror::Error;

use crate::config::ImageSize;

/// Errors of configurations, weights files and networks.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// No built-in model has this name.
    #[error("model: expected one of {}, or a path that ends in .toml, found {name:?}", known.join(", "))]
    UnknownModel {
        /// The requested name.
        name: String,
        /// The built-in names.
        known: Vec<&'static str>,
    },
    /// A configuration, key map, weights file or input is malformed.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// Images, poses or outputs of the network contain NaN or infinite values.
    #[error("{location}: expected finite values, found {count} that are NaN or infinite")]
    NonFinite {
        /// Which image, camera or stage.
        location: String,
        /// Number of such values.
        count: usize,
    },
    /// Images of one input differ in size.
    #[error("model input: image {image}: expected {expected}, the size of image 0, found {found} (height x width)")]
    SizesDiffer {
        /// Index of the image, counted from 0.
        image: usize,
        /// Size of the first image.
        expected: ImageSize,
        /// Size of this image.
        found: ImageSize,
    },
    /// Patches do not divide an image.
    #[error(
        "model input: {branch} branch, image size: expected a height and width divisible by {step}, found {found} (height x width)"
    )]
    Indivisible {
        /// The branch of the patches.
        branch: &'static str,
        /// Side of a patch, in pixels of the image.
        step: usize,
        /// Size of the image.
        found: ImageSize,
    },
    /// The renderer rejected Gaussians, a view or options.
    #[cfg(feature = "network")]
    #[error("rendering: {0}")]
    Splat(#[from] atsplat_splat::SplatError),
    /// Networks cannot run on a processor.
    #[cfg(feature = "network")]
    #[error("the network on {processor}: {why}")]
    Processor {
        /// The processor.
        processor: crate::network::Processor,
        /// The reason, and the remedy if there is one.
        why: String,
    },
    /// A file of tensors could not be read or written.
    #[error(transparent)]
    Tensors(#[from] TensorError),
    /// Weights do not fit the network.
    #[error("weights: {0}")]
    Unfit(Box<crate::weights::ImportReport>),
    /// A configuration has no valid setting for large images, for this reason.
    #[error("setting for large images: {0}")]
    HighResolution(Box<ModelError>),
    /// Another error, with the file that caused it.
    #[error("{source} ({})", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// The error.
        source: Box<ModelError>,
    },
}

impl ModelError {
    pub(crate) fn malformed(
        what: &'static str,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Malformed::new(what, location, expected, found).into()
    }

    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        FileError::during(action, path)
    }

    /// The same error with its file.
    #[must_use]
    pub fn in_file(self, path: impl Into<PathBuf>) -> Self {
        Self::InFile { path: path.into(), source: Box::new(self) }
    }
}
