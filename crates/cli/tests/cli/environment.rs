//! What environment variables change.

use std::process::Command;

use crate::evaluation::write_noise;
use atsplat_results::Results;

const RUN: [&str; 7] = ["run", "tiny.toml", "--data", "data", "--method", "warp", "--out"];

/// A timing pass records the number of threads.
#[test]
fn rayons_variable_is_the_number_of_threads_where_no_argument_states_one() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let threads = |out: &str, arguments: &[&str]| {
        let mut run = Command::new(env!("CARGO_BIN_EXE_atsplat"));
        run.args(arguments).args(RUN).args([out, "--timing"]).current_dir(here).env("RAYON_NUM_THREADS", "3");
        let output = run.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Results::read(&here.join(out)).unwrap().timings[0].machine.threads
    };
    assert_eq!(threads("variable", &[]), 3);
    assert_eq!(threads("argument", &["--threads", "2"]), 2);
}

#[test]
fn a_number_of_threads_that_is_none_is_a_usage_error_unless_an_argument_states_one() {
    let list = |value: &str, arguments: &[&str]| {
        let mut list = Command::new(env!("CARGO_BIN_EXE_atsplat"));
        let output = list.args(arguments).args(["protocol", "list"]).env("RAYON_NUM_THREADS", value).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    for value in ["abc", "-1", "2.5", "3 "] {
        let (code, error) = list(value, &[]);
        let found =
            format!("error: RAYON_NUM_THREADS: expected a number of threads, found {value}: correct or unset it");
        assert!(code == Some(2) && error.starts_with(&found), "{code:?}: {error}");
        assert_eq!(list(value, &["--threads", "1"]).0, Some(0), "{value}");
    }
    for value in ["", "0", "2"] {
        assert_eq!(list(value, &[]).0, Some(0), "{value}");
    }
}

/// The output of `report` on a terminal, which `script` stands for.
#[cfg(target_os = "linux")]
fn report_on_a_terminal(here: &std::path::Path, no_color: Option<&str>) -> String {
    let mut terminal = Command::new("script");
    let command = "\"$ATSPLAT\" report store --out page 2> log";
    terminal.args(["--quiet", "--return", "--command", command, "/dev/null"]).current_dir(here);
    terminal.env("SHELL", "/bin/sh").env("ATSPLAT", env!("CARGO_BIN_EXE_atsplat")).env_remove("NO_COLOR");
    if let Some(value) = no_color {
        terminal.env("NO_COLOR", value);
    }
    let output = terminal.stdin(std::process::Stdio::null()).output().unwrap();
    let log = std::fs::read_to_string(here.join("log")).unwrap();
    assert!(output.status.success(), "{log}");
    String::from_utf8(output.stdout).unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn tables_on_a_terminal_have_no_escape_sequences_if_no_color_is_not_empty() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    crate::common::succeed(here, &[&RUN[..], &["store"]].concat());
    for (value, is_styled) in [(None, true), (Some(""), true), (Some("1"), false)] {
        let text = report_on_a_terminal(here, value);
        assert!(text.contains("PSNR"), "{text}");
        assert_eq!(text.contains('\u{1b}'), is_styled, "{value:?}: {text}");
    }
}

/// How long the allocator of a training keeps freed memory: for ever, unless the caller says otherwise. Its process is that which was started.
#[cfg(target_os = "linux")]
#[test]
fn trainings_keep_freed_memory_unless_the_environment_says_how_long() {
    const DELAY: &str = "MIMALLOC_PURGE_DELAY";
    for (given, expected) in [(None, "-1"), (Some("700"), "700")] {
        let folder = tempfile::tempdir().unwrap();
        let mut training = Command::new(env!("CARGO_BIN_EXE_atsplat"));
        let experiment = concat!(env!("CARGO_MANIFEST_DIR"), "/../../eval/experiments/overfit-room.toml");
        training.args(["train", "--config", experiment, "--out", "run"]).current_dir(folder.path()).env_remove(DELAY);
        if let Some(given) = given {
            training.env(DELAY, given);
        }
        // It is past its start once its folder is there.
        let run = folder.path().join("run");
        let mut training = crate::common::started_command(&mut training, &run);
        assert!(run.exists(), "the training has not begun");
        let environment = std::fs::read(format!("/proc/{}/environ", training.id())).unwrap();
        training.kill().unwrap();
        training.wait().unwrap();
        let environment = String::from_utf8_lossy(&environment);
        let found: Vec<&str> = environment.split('\0').filter_map(|line| line.strip_prefix(DELAY)).collect();
        assert_eq!(found, [format!("={expected}")]);
    }
}
