//! Differentiable Gaussian splatting without CUDA: renders Gaussians from a camera, and propagates image gradients back
//! to every input. A standalone crate, without tensors or datasets.
//!
//! [`files`] reads and writes the common file formats; [`Gaussians`] validates, cleans, bounds, merges and transforms.
//!
//! Camera axes are OpenCV's; pixel `(column, row)` has its centre at `(column + 0.5, row + 0.5)`; quaternions
//! are `w, x, y, z`; colours are display-referred RGB, nominally in [0, 1].

#![expect(clippy::inline_always, reason = "SIMD target features apply only to inlined code")]
#![expect(clippy::neg_cmp_op_on_partial_ord, reason = "comparisons are written so that NaN fails them")]

// Tests share scenes with the integration tests, which name the crate.
#[cfg(test)]
extern crate self as atsplat_splat;

mod constants;
pub mod cpu;
pub mod effects;
mod error;
mod exposure;
pub mod files;
pub mod framing;
mod gaussians;
pub mod gpu;
mod gradient_field;
pub mod hard_cases;
mod options;
mod packed_harmonics;
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
pub use gradient_field::GradientField;
pub use options::{Channels, RasterMode, RenderOptions, StoppedGradients};
pub use packed_harmonics::PackedHarmonics;
pub use renderer::{ReferenceRenderer, Renderer, Stage};
pub use rendering::{GaussianCounts, Gradients, ImageGradients, Rendering};
pub use view::View;
