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
