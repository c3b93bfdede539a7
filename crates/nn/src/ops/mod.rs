//! Operations on burn's tensors.

mod attention;
mod gather;
mod nearest;
mod rows;

pub use attention::{cross_attention, self_attention};
pub use gather::{gather_max, gather_rows};
pub use nearest::nearest_neighbours;
pub use rows::{gelu, layer_norm, linear, normalize_heads, rms_norm};
