//! Times of methods, as a timing pass measured them: a row for each trial, and their spread over repetitions and trials.

mod load;
mod machine;
mod of_method;
mod row;
mod spread;

pub use load::Load;
pub use machine::{Machine, platform};
pub use of_method::{GAUSSIANS_UNTIMED, NOTHING_ENCODED, Times, machine_of, times};
pub(crate) use of_method::{timed_trials, times_on};
pub use row::{TimingRow, rendered_targets};
pub use spread::Spread;

pub(crate) use row::merged;
