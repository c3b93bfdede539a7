use atsplat_splat::gpu::AdapterChoice;
use atsplat_splat::hard_cases::{HardCase, catalogue};
use atsplat_splat::stress::StressRow;
use atsplat_splat::stress::{self, Path};

use clap::Command;
use clap::error::ErrorKind;

use crate::adapter_tests::AdapterTests;
use crate::output::complain;
use crate::progress::Progress;

/// Parses `--case`.
pub(super) fn case_name(word: &str) -> Result<String, String> {
    if catalogue().iter().any(|case| case.name == word) {
        Ok(word.to_owned())
    } else {
        Err("no hard case has this name; `atsplat stress --list` tells those that there are".to_owned())
    }
}

/// Rows of the chosen cases and paths; of all where none is chosen.
pub(super) fn rows(cases: &[String], words: &[String]) -> anyhow::Result<Vec<StressRow>> {
    let mut paths = stress::paths();
    let is_here = |paths: &[Path], word: &str| paths.iter().any(|path| path.renderer.name().contains(word));
    if words.is_empty() || words.iter().any(|word| !is_here(&paths, word)) {
        let tests = AdapterTests::new(false);
        let path = stress::gpu_path(&AdapterChoice::Automatic, &tests);
        tests.finish();
        match path {
            Ok(path) => paths.push(path),
            Err(error) => complain(&format!("warning: no rows of a graphics processor: {error}")),
        }
    }
    if let Some(word) = words.iter().find(|word| !is_here(&paths, word)) {
        let names: Vec<String> = paths.iter().map(|path| path.renderer.name()).collect();
        let told = format!("--path {word}: this machine has {}", names.join("; "));
        return Err(Command::new("atsplat").error(ErrorKind::ValueValidation, told).into());
    }
    paths.retain(|path| words.is_empty() || words.iter().any(|word| path.renderer.name().contains(word)));
    let chosen = chosen(cases);
    let progress = Progress::new("hard cases", chosen.len());
    let mut rows = Vec::with_capacity(chosen.len() * paths.len());
    for case in &chosen {
        rows.extend(stress::rows(case, &mut paths)?);
        progress.step();
    }
    Ok(rows)
}

/// Names and descriptions, a line each.
pub(super) fn list(cases: &[String]) -> String {
    let lines: Vec<String> =
        chosen(cases).iter().map(|case| format!("{:<24} {}", case.name, case.description)).collect();
    lines.join("\n") + "\n"
}

fn chosen(cases: &[String]) -> Vec<HardCase> {
    let mut all = catalogue();
    all.retain(|case| cases.is_empty() || cases.iter().any(|name| name == case.name));
    all
}
