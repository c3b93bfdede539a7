//! `.torch` files: what PyTorch wrote, what this toolkit writes, and what nobody should have written.

#![expect(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail like tests")]

mod chunks;
mod corpus;
mod fixtures;
mod hostile;
mod support;
