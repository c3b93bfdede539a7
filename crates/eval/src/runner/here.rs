use std::fs;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::Provenance;

/// What a run says of the machine and the moment; `commit` is that of the build and `command` the words it was called with.
pub fn here(version: &str, commit: Option<&str>, command: Vec<String>) -> Provenance {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    Provenance {
        atsplat: version.to_owned(),
        commit: commit.map(str::to_owned),
        platform: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        processor: processor(),
        threads: u32::try_from(rayon::current_num_threads()).unwrap_or(u32::MAX),
        started: since.map(|since| since.as_secs()).unwrap_or_default(),
        command,
        ..Provenance::default()
    }
}

/// The processor's name, as far as the system tells, and the instruction set that renders.
fn processor() -> String {
    let told = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map_or("unknown processor", |(_, name)| name.trim());
    let renderer = atsplat_splat::Renderer::name(&atsplat_splat::cpu::CpuRenderer::default());
    format!("{name}, {renderer}")
}
