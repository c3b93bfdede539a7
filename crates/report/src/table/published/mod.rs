//! How a table's measured rows compare with the published figures: which values agree, and whether rows are in the published order.
//! An order is decided by the interval of a paired difference, not by two means.

mod agreement;
mod orders;
#[cfg(test)]
mod orders_tests;
mod reference;

pub use agreement::{Agreement, Headline, agreement};
pub(super) use orders::orders;
pub use orders::{Order, Outcome};
pub(super) use reference::differences_to_reference;
