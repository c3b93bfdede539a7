//! The ATSplat model (paper: "Compact Feed-forward 3D Gaussian Splatting with Adaptive Token Expansion"), which turns
//! context views into Gaussians: configuration with every variant of the paper, token and Gaussian budgets, the network on
//! burn's tensors, and reading and writing of weights.
//!
//! Independent of dataset formats and metrics.

pub mod budget;
pub mod config;
mod error;
pub mod farthest_point;
mod hash;
pub mod neighbours;
#[cfg(feature = "network")]
pub mod network;
pub mod parameters;
pub mod selection;
pub mod weights;

pub use config::{ImageSize, ModelConfig};
pub use error::ModelError;

/// A TOML error with the line and column, counted from 1, at which its byte span begins.
pub(crate) fn toml_error(what: &'static str, expected_whole: &str, text: &str, error: &toml::de::Error) -> ModelError {
    let start = error.span().map_or(0, |span| span.start);
    let before = &text[..start];
    let line = before.bytes().filter(|byte| *byte == b'\n').count() + 1;
    let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
    let message = error.message();
    let (found, expected) = message.rsplit_once(", expected ").unwrap_or((message, expected_whole));
    ModelError::malformed(what, format!("line {line} column {column}"), expected, found)
}
