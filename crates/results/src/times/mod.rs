//! Times of methods, as a timing pass measured them: a row for each trial, and their spread over repetitions and trials.

mod load;
mod machine;
mod row;
mod spread;
mod times;

pub use load::Load;
pub use machine::{Machine, platform};
pub use row::{TimingRow, rendered_targets};
pub use spread::Spread;
pub(crate) use times::times_on;
pub use times::{GAUSSIANS_UNTIMED, NOTHING_ENCODED, Times, machine_of, times};

pub(crate) use row::merged;
