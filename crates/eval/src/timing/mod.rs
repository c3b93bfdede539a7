//! Times, measured in a pass of their own.
//!
//! Trials that are evaluated share the processor, and a thread that waits inside rayon takes up another trial's work: a clock
//! around a method then counts what is not the method's. So no clock runs during evaluation. A [pass](TimingPlan) comes after
//! it, with a thread pool of its own that nothing else can put work into, while no trial is evaluated anywhere in the process:
//! some trials of each protocol, one at a time, under each method, warmed up and repeated. What the rest of the machine did
//! meanwhile is part of the result ([`Load`]).

mod load;
mod machine;
pub mod memory;
mod merge;
mod pass;
mod quiet;
mod row;
mod samples;
mod times;

pub use load::Load;
pub use machine::Machine;
pub use pass::TimingPlan;
pub use row::TimingRow;
pub use times::{NOTHING_ENCODED, Spread, Times, machine_of, times};

pub(crate) use merge::merged;
pub(crate) use pass::pass;
pub(crate) use quiet::evaluating;
