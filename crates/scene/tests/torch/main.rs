//! `.torch` files: what PyTorch wrote, what this toolkit writes, and what nobody should have written.

mod chunks;
mod corpus;
mod fixtures;
mod hostile;
mod support;
