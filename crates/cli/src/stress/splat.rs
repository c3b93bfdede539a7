use atsplat_splat::gpu::AdapterChoice;
use atsplat_splat::hard_cases::{HardCase, catalogue};
use atsplat_splat::stress::StressRow;
use atsplat_splat::stress::{self, Path};

use crate::adapter_tests::AdapterTests;
use crate::output::warn;
use crate::parse::usage_error;
use crate::progress::Progress;

/// Parses `--case`.
pub(super) fn case_name(name: &str) -> Result<String, String> {
    if catalogue().iter().any(|case| case.name == name) {
        Ok(name.to_owned())
    } else {
        Err("no hard case has this name; `atsplat stress --list` lists all".to_owned())
    }
}

/// Runs the selected cases and paths, or all if none is selected.
pub(super) fn rows(cases: &[String], names: &[String]) -> anyhow::Result<Vec<StressRow>> {
    let mut paths = stress::paths();
    let exists = |paths: &[Path], name: &str| paths.iter().any(|path| path.renderer.name().contains(name));
    if names.is_empty() || names.iter().any(|name| !exists(&paths, name)) {
        let tests = AdapterTests::new(false);
        let path = stress::gpu_path(&AdapterChoice::Automatic, &tests);
        tests.finish();
        match path {
            Ok(path) => paths.push(path),
            Err(error) => warn(&format!("warning: no rows for a GPU: {error}")),
        }
    }
    if let Some(name) = names.iter().find(|name| !exists(&paths, name)) {
        let known: Vec<String> = paths.iter().map(|path| path.renderer.name()).collect();
        return Err(usage_error(format!("--path {name}: this machine has {}", known.join("; "))).into());
    }
    paths.retain(|path| names.is_empty() || names.iter().any(|name| path.renderer.name().contains(name)));
    let selected = selected(cases);
    let progress = Progress::new("hard cases", selected.len());
    let mut rows = Vec::with_capacity(selected.len() * paths.len());
    for case in &selected {
        rows.extend(stress::rows(case, &mut paths)?);
        progress.step();
    }
    Ok(rows)
}

/// One line per case with name and description.
pub(super) fn list(cases: &[String]) -> String {
    let lines: Vec<String> =
        selected(cases).iter().map(|case| format!("{:<24} {}", case.name, case.description)).collect();
    lines.join("\n") + "\n"
}

fn selected(cases: &[String]) -> Vec<HardCase> {
    let mut all = catalogue();
    all.retain(|case| cases.is_empty() || cases.iter().any(|name| name == case.name));
    all
}
