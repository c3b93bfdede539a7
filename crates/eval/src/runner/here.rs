use std::time::{SystemTime, UNIX_EPOCH};

use crate::Provenance;
use crate::timing::Machine;

/// What a run says of the machine and the moment; `commit` is that of the build and `command` the words it was called with.
pub fn here(version: &str, commit: Option<&str>, command: Vec<String>) -> Provenance {
    let Machine { processor, platform, threads, .. } = Machine::here();
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    Provenance {
        atsplat: version.to_owned(),
        commit: commit.map(str::to_owned),
        platform,
        processor,
        threads,
        started: since.map(|since| since.as_secs()).unwrap_or_default(),
        command,
        ..Provenance::default()
    }
}
