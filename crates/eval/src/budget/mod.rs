//! Tokens, Gaussians and memory of configurations by formula, next to the paper's numbers and to those of a run.

mod measure;
mod published;
mod report;

pub use measure::{BudgetMeasurer, MeasuredBudget};
pub use published::{BrokenTable, Count, PublishedBudget, published_budgets};
pub use report::{BudgetCase, BudgetReport, BudgetRow};
