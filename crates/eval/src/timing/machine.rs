use std::fmt;

use atsplat_splat::cpu::processor;
use serde::{Deserialize, Serialize};

/// A machine type; only times of equal machine types are compared.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Machine {
    /// The processor's name and its vector instructions.
    pub processor: String,
    /// Operating system and architecture.
    pub platform: String,
    /// Logical processors.
    pub cpus: u32,
    /// Threads of the timed pool.
    pub threads: u32,
}

impl Machine {
    /// The current machine, with the number of threads of the caller's pool.
    ///
    /// # Panics
    /// Never: no machine has 2³² threads.
    #[expect(clippy::expect_used, reason = "no machine has 2³² threads")]
    pub fn current() -> Self {
        let count = |count: usize| u32::try_from(count).expect("fewer than 2³² threads");
        Self {
            processor: processor(),
            platform: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            cpus: std::thread::available_parallelism().map_or(1, |cpus| count(cpus.get())),
            threads: count(rayon::current_num_threads()),
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { processor, platform: _, cpus, threads } = self;
        let plural = if *threads == 1 { "thread" } else { "threads" };
        write!(f, "{processor}, {threads} {plural} on {cpus} logical processors")
    }
}
