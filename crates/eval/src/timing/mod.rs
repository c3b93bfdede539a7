//! Times, measured in a separate pass.
//!
//! Trials that are evaluated concurrently share the processor, and a thread that waits inside rayon steals another trial's
//! work, so a clock around a method would include foreign work. No clock runs during evaluation. A [pass](TimingPlan) follows
//! it, in its own thread pool and while nothing is evaluated anywhere in the process: some trials of each protocol, one at a
//! time, under each method, with warm-up and repetitions. The load of the rest of the machine is part of the result
//! ([`Load`](atsplat_results::times::Load)).

mod exclusion;
mod load;
mod machine;
pub mod memory;
mod pass;
mod quota;
mod samples;

pub use machine::this_machine;
pub use pass::TimingPlan;

pub(crate) use exclusion::evaluating;
pub(crate) use load::processor_secs_of_stat;
pub(crate) use memory::status_bytes;
pub(crate) use pass::pass;
