//! Operations on burn's tensors.

mod attention;
mod gather;
mod rows;

pub use attention::{cross_attention, self_attention};
pub use gather::{gather_max, gather_rows};
pub use rows::{gelu, layer_norm, linear, normalize_heads, rms_norm};
