//! Gaussian splatting without CUDA: Gaussians and a camera into images, and image gradients into gradients of
//! everything that made them. Usable on its own; knows nothing of tensors or datasets.
//!
//! [`files`] reads and writes what people exchange Gaussians in; [`Gaussians`] are counted, cleaned, bounded, merged
//! and moved.
//!
//! Camera axes are OpenCV's; pixel `(column, row)` has its centre at `(column + 0.5, row + 0.5)`; quaternions
//! are `w, x, y, z`; colours are display-referred RGB, nominally in [0, 1].

#![expect(clippy::inline_always, reason = "vector instructions reach only what is inlined")]
#![expect(clippy::neg_cmp_op_on_partial_ord, reason = "a test that NaN must fail is written so that it does")]

mod constants;
pub mod cpu;
pub mod effects;
mod error;
mod exposure;
pub mod files;
pub mod framing;
mod gaussians;
pub mod gpu;
pub mod hard_cases;
mod options;
mod reach;
pub mod reference;
mod renderer;
mod rendering;
pub mod round_trip;
pub mod scene_file;
pub mod sh;
pub mod stress;
mod view;

pub use constants::{
    ClampedGradient, Extent, LARGEST_CHANNEL, PrincipalPoint, RendererConstants, SMALLEST_MIN_ALPHA, ShAxes,
};
pub use error::SplatError;
pub use exposure::Exposure;
pub use gaussians::{
    Bounds, Cleaning, Field, Finding, GaussianParts, Gaussians, LOG_SCALE_LIMIT, LOGIT_LIMIT, LOGIT_OF_INFINITY,
    MAX_SH_DEGREE, Problem, Validation, sh_coefficients,
};
pub use options::{Channels, GradientReach, RasterMode, RenderOptions};
pub use renderer::{ReferenceRenderer, Renderer, Stage};
pub use rendering::{Census, Gradients, ImageGradients, Rendering};
pub use view::View;
