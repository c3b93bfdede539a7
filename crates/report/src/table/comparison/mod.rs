//! How the measured rows of a table compare with each other: marks of the best, undecided leads, paired differences to a method.
//! What does not compare, such as means over other targets, has a reason in place of a mark.

mod difference;
mod leads;
mod paired;
#[cfg(test)]
mod paired_tests;
mod rank;
#[cfg(test)]
mod rank_tests;
mod unranked_rows;

pub(super) use difference::{Difference, differ_in_weights, difference, why_without_difference};
pub(super) use leads::undecided_leads;
pub(super) use paired::add_differences;
pub(super) use rank::{Incomparable, rank};
