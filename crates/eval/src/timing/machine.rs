use atsplat_results::times::{Machine, platform};
use atsplat_splat::cpu::processor;

/// The type of the current machine, with the number of threads of the caller's pool.
///
/// # Panics
/// Never: no machine has 2³² threads.
#[expect(clippy::expect_used, reason = "no machine has 2³² threads")]
pub fn this_machine() -> Machine {
    let count = |count: usize| u32::try_from(count).expect("fewer than 2³² threads");
    Machine {
        processor: processor(),
        platform: platform(),
        cpus: std::thread::available_parallelism().map_or(1, |cpus| count(cpus.get())),
        threads: count(rayon::current_num_threads()),
    }
}
