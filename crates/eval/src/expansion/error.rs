use thiserror::Error;

/// Why expansion cannot be studied in a scene.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ExpansionError {
    /// The network refuses the views, or gives numbers that are not finite.
    #[error(transparent)]
    Model(#[from] atsplat_model::ModelError),
    /// The renderer refuses a view.
    #[error("rendering: {0}")]
    Splat(#[from] atsplat_splat::SplatError),
    /// A render and its truth cannot be compared.
    #[error(transparent)]
    Metric(#[from] atsplat_metrics::MetricError),
    /// A picture cannot be read.
    #[error(transparent)]
    Protocol(#[from] atsplat_protocol::ProtocolError),
    /// A camera maps nothing.
    #[error(transparent)]
    Camera(#[from] atsplat_camera::CameraError),
    /// A render has not the samples of a picture.
    #[error(transparent)]
    Pixels(#[from] atsplat_pixels::PixelError),
    /// A trial that is none for a network.
    #[error("{what}: expected {expected}, found {found}")]
    Unfit {
        /// What was asked for.
        what: &'static str,
        /// What would fit.
        expected: String,
        /// What was given.
        found: String,
    },
}
