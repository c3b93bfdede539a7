//! Layers as burn modules. Parameter names are part of the interface: weights of PyTorch models map to them.

mod attention;
mod block;
mod linear;
mod mlp;
mod norm;

pub use attention::{AttentionConfig, CrossAttention, SelfAttention};
pub use block::{Block, BlockConfig, LayerScale};
pub use linear::{Linear, LinearConfig};
pub use mlp::{Mlp, MlpConfig};
pub use norm::{Norm, NormConfig};
