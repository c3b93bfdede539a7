use std::fmt;

use atsplat_numeric::counted;
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

/// The operating system and architecture of the current machine.
pub fn platform() -> String {
    format!("{} {}", std::env::consts::OS, std::env::consts::ARCH)
}

impl Machine {
    /// A machine of which only a name is known, because its times were stated and not measured here.
    pub fn stated(name: &str) -> Self {
        Self { processor: name.to_owned(), ..Self::default() }
    }

    /// Whether its times were stated: a machine of this toolkit has processors.
    pub const fn is_stated(&self) -> bool {
        self.cpus == 0
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { processor, platform: _, cpus, threads } = self;
        if self.is_stated() {
            return write!(f, "{processor} (stated, not measured here)");
        }
        let threads = counted((*threads).into(), "thread");
        write!(f, "{processor}, {threads} on {}", counted((*cpus).into(), "logical processor"))
    }
}
