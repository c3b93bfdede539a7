use thiserror::Error;

/// Why a scene cannot be analysed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ExpansionError {
    /// The network rejects the views or returns non-finite numbers.
    #[error(transparent)]
    Model(#[from] atsplat_model::ModelError),
    /// The renderer rejects a view.
    #[error("rendering: {0}")]
    Splat(#[from] atsplat_splat::SplatError),
    /// A render and its ground truth cannot be compared.
    #[error(transparent)]
    Metric(#[from] atsplat_metrics::MetricError),
    /// A picture cannot be read.
    #[error(transparent)]
    Protocol(#[from] atsplat_protocol::ProtocolError),
    /// An invalid camera.
    #[error(transparent)]
    Camera(#[from] atsplat_camera::CameraError),
    /// A render has the wrong number of samples.
    #[error(transparent)]
    Pixels(#[from] atsplat_pixels::PixelError),
    /// A target that the trial does not have.
    #[error("{what}: expected {expected}, found {found}")]
    Invalid {
        /// What was requested.
        what: &'static str,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
}
