use serde::Serialize;

/// The world frame of Gaussians in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum GaussianFrame {
    /// The dataset's.
    #[default]
    Dataset,
    /// The trial's, whose poses are normalised for the network.
    Trial,
}

impl GaussianFrame {
    /// `dataset` or `trial`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dataset => "dataset",
            Self::Trial => "trial",
        }
    }
}
