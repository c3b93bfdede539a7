use std::fs;

use super::CpuRenderer;
use crate::Renderer as _;

/// The type of this machine's processor, on which the last bits of results may depend: its name, if known, and the
/// instruction set that renders.
pub fn processor() -> String {
    // Systems other than Linux have no such file.
    let cpuinfo = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = cpuinfo.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map_or("unknown processor", |(_, name)| name.trim());
    format!("{name}, {}", CpuRenderer::default().name())
}
