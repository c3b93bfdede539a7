use std::path::PathBuf;

use atsplat_pickle::TorchError;
use thiserror::Error;

use crate::config::ImageSize;

/// What can go wrong between a configuration, a weights file and a network.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The operating system refused.
    #[error("{action}: {source} ({})", path.display())]
    Io {
        /// What was being done.
        action: &'static str,
        /// To which file.
        path: PathBuf,
        /// The operating system's words.
        source: std::io::Error,
    },
    /// No built-in model has this name.
    #[error("model: expected one of {}, or a path that ends in .toml, found {name:?}", known.join(", "))]
    UnknownModel {
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<&'static str>,
    },
    /// A configuration, key map, weights file or input is not what it should be.
    #[error("{what}: {location}: expected {expected}, found {found}")]
    Malformed {
        /// What was being read, e.g. "model configuration".
        what: &'static str,
        /// Line and column, field, or tensor.
        location: String,
        /// What should stand there.
        expected: String,
        /// What stands there, shortened.
        found: String,
    },
    /// Pictures, poses or what the network made of them hold NaN or infinities.
    #[error("{location}: expected finite values, found {count} that are NaN or infinite")]
    NonFinite {
        /// Which picture, camera or stage.
        location: String,
        /// How many values.
        count: usize,
    },
    /// One network takes pictures of one size.
    #[error("model input: picture {picture}: expected {expected}, the size of picture 0, found {found}")]
    SizesDiffer {
        /// Which picture, counted from 0.
        picture: usize,
        /// The first one's.
        expected: ImageSize,
        /// Its own.
        found: ImageSize,
    },
    /// Patches do not divide a picture.
    #[error("model input: {branch} branch, picture size: expected height and width that {step} divides, found {found}")]
    Indivisible {
        /// Which branch's patches.
        branch: &'static str,
        /// Side of a patch, in pixels of the picture.
        step: usize,
        /// The picture.
        found: ImageSize,
    },
    /// The splatter refused Gaussians, a view or options.
    #[cfg(feature = "network")]
    #[error("rendering: {0}")]
    Splat(#[from] atsplat_splat::SplatError),
    /// A network cannot compute there.
    #[cfg(feature = "network")]
    #[error("the network on {processor}: {why}")]
    Processor {
        /// Where.
        processor: crate::network::Processor,
        /// What stands in the way, and what helps.
        why: String,
    },
    /// A file is not what `torch.save` writes.
    #[error("checkpoint: {0}")]
    Torch(#[from] TorchError),
    /// Weights do not fit the network.
    #[error("weights: {0}")]
    Unfit(Box<crate::weights::ImportReport>),
    /// A weights file is absent.
    #[error("weights: expected {expected}, found no file ({})", path.display())]
    MissingWeights {
        /// What the file is, where users get it, and its sha256 where that is known.
        expected: String,
        /// Where it was looked for.
        path: PathBuf,
    },
    /// Any of these in a file.
    #[error("{source} ({})", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<ModelError>,
    },
}

impl ModelError {
    #[expect(clippy::needless_pass_by_value, reason = "callers give numbers and fresh text as often as borrowed ones")]
    pub(crate) fn malformed(
        what: &'static str,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        let found = found.to_string();
        Self::Malformed { what, location: location.into(), expected: expected.into(), found: shortened(&found) }
    }

    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { action, path, source }
    }

    /// The same error, with the file that it is in.
    #[must_use]
    pub fn in_file(self, path: impl Into<PathBuf>) -> Self {
        Self::InFile { path: path.into(), source: Box::new(self) }
    }
}

/// At most 200 characters of untrusted text.
fn shortened(text: &str) -> String {
    const SHOWN: usize = 200;
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text.to_owned(),
    }
}
