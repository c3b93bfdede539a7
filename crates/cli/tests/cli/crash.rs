//! Killed runs and full disks: nothing is lost, and a resumed run has the same results.

#![cfg(unix)]

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::common::{atsplat, succeed};
use crate::evaluation::{FRAMES, bare, write_index, write_noise};
use atsplat_files::FileLock;
use atsplat_results::Results;

fn command(here: &Path, out: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_atsplat"));
    let args = ["--threads", "2", "run", "tiny.toml", "--data", "data", "--method", "nearest-view,warp", "--out", out];
    command.args(args).current_dir(here).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn finished(here: &Path, out: &str) -> Results {
    assert!(command(here, out).status().unwrap().success());
    Results::read(&here.join(out)).unwrap()
}

/// Noise scenes with two targets each: the plane warp takes milliseconds for a target.
fn write_scenes(here: &Path, scenes: u8) {
    write_noise(here, scenes);
    let keys: Vec<String> = (0..scenes).map(|scene| format!("scene-{scene:02}")).collect();
    let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
    write_index(&here.join("data"), &keys, "[0, 20]", "[1, 9]");
}

/// `child.kill()` is kill −9.
fn killed_after(here: &Path, out: &str, delay: Duration) {
    let mut child = command(here, out).spawn().unwrap();
    sleep(delay);
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_run_killed_at_twenty_moments_resumes_to_the_same_results() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_scenes(here, 16);
    let start = Instant::now();
    let expected = finished(here, "undisturbed");
    let whole = start.elapsed();
    assert_eq!(expected.trials.len(), 32);
    let mut partial = 0;
    for moment in 0..20u32 {
        let out = format!("killed-{moment}");
        // Quasi-random moments by the golden ratio.
        let share = (f64::from(moment) * 0.618_033_988_75).fract();
        killed_after(here, &out, whole.mul_f64(share));
        let left = Results::read(&here.join(&out)).map_or(0, |results| results.trials.len());
        partial += usize::from(left > 0 && left < 32);
        let resumed = finished(here, &out);
        assert_eq!(bare(&resumed), bare(&expected), "killed after {share} of the time, with {left} trials there");
        assert!(!here.join(&out).join("parts").exists());
    }
    assert!(partial >= 3, "the moments hardly met the work: {partial} of 20");
}

#[test]
fn a_run_killed_repeatedly_resumes_to_the_same_results() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_scenes(here, 12);
    let start = Instant::now();
    let expected = finished(here, "undisturbed");
    let whole = start.elapsed();
    for moment in 1..=20u32 {
        killed_after(here, "store", whole.mul_f64(f64::from(moment * 7 % 20) / 20.0));
    }
    assert_eq!(bare(&finished(here, "store")), bare(&expected));
}

/// Files may grow to 24 KiB (48 if the shell counts in KiB): the provenance fits, the rows of a trial
/// with many targets do not.
fn with_a_full_disk(here: &Path, out: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_atsplat");
    let script = "trap '' XFSZ; ulimit -f 48; exec \"$0\" \"$@\"";
    let mut args = vec!["-c", script, program, "run", "tiny.toml", "--data", "data", "--method", "warp"];
    args.extend(["--metrics", "all", "--out", out]);
    Command::new("sh").args(args).current_dir(here).output().unwrap()
}

#[test]
fn a_full_disk_stops_the_run_without_losing_results() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 3);
    // One scene needs more than a file may hold.
    let frames: Vec<String> = (1..FRAMES).map(|frame| frame.to_string()).collect();
    let (few, many) = ("[1, 2]", format!("[{}]", frames.join(", ")));
    let entry = |scene: &str, target: &str| format!("\"{scene}\": {{\"context\": [0, 20], \"target\": {target}}}");
    let index = [entry("scene-00", few), entry("scene-01", &many), entry("scene-02", few)].join(", ");
    std::fs::write(here.join("data/evaluation_index.json"), format!("{{{index}}}")).unwrap();
    let full = with_a_full_disk(here, "store");
    let message = String::from_utf8(full.stderr).unwrap();
    assert_eq!(full.status.code(), Some(1), "{message}");
    assert!(message.contains("writing results") && message.contains("store"), "{message}");
    let left = Results::read(&here.join("store")).unwrap();
    assert!(left.trials.iter().all(|trial| trial.targets == 2), "whole trials or none");
    let resume = |out: &str| {
        let args = ["run", "tiny.toml", "--data", "data", "--method", "warp", "--metrics", "all", "--out", out];
        let status = Command::new(env!("CARGO_BIN_EXE_atsplat")).args(args).current_dir(here).output().unwrap();
        assert!(status.status.success(), "{}", String::from_utf8_lossy(&status.stderr));
        Results::read(&here.join(out)).unwrap()
    };
    assert_eq!(bare(&resume("store")), bare(&resume("undisturbed")));
}

/// Of two acceptances at once, the later one would lose the reason of the other.
#[test]
fn one_process_at_a_time_accepts_a_baseline() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    finished(here, "store");
    let accept = ["drift", "accept", "store", "--baseline", "b.json", "--why", "first", "--no-probe"];
    let lock = FileLock::of(&here.join("b.json")).unwrap();
    atsplat(here, &accept).says(1, "b.json is being written by process ");
    assert!(!here.join("b.json").exists());
    drop(lock);
    succeed(here, &accept);
}

/// Exit code of a run, for a shell, that is sent what Ctrl-C sends when the first results of its trials are there. The caller of the
/// tests may ignore that, and processes inherit it.
#[cfg(target_os = "linux")]
fn interrupted(here: &Path, out: &str) -> i32 {
    let run = command(here, out);
    let mut shell = Command::new("sh");
    shell.args(["-c", "env --default-signal=INT \"$0\" \"$@\"; exit $?"]).arg(run.get_program()).args(run.get_args());
    let mut shell = shell.current_dir(here).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let store = here.join(out);
    let is_there = |part: &Path| part.extension().is_some_and(|extension| extension == "json");
    let has_part =
        || store.join("parts").read_dir().is_ok_and(|mut parts| parts.any(|part| is_there(&part.unwrap().path())));
    while !has_part() && shell.try_wait().unwrap().is_none() {
        sleep(Duration::from_millis(1));
    }
    if let Ok(holder) = std::fs::read(store.join("run.json")) {
        let holder: serde_json::Value = serde_json::from_slice(&holder).unwrap();
        // It may have ended meanwhile.
        Command::new("kill").args(["-s", "INT", &holder["pid"].to_string()]).stderr(Stdio::null()).status().unwrap();
    }
    shell.wait().unwrap().code().unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn an_interrupted_run_resumes_with_the_same_command() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 16);
    let expected = finished(here, "undisturbed");
    let stopped = (0..10).map(|round| format!("store-{round}")).find(|out| {
        let code = interrupted(here, out);
        assert!([0, 130].contains(&code), "{code}");
        code == 130 && (1..32).contains(&Results::read(&here.join(out)).unwrap().trials.len())
    });
    let out = stopped.expect("one of ten runs is interrupted before it ends");
    // As of a run that was just writing a table.
    let partial = here.join(&out).join(".AbC123.partial");
    std::fs::write(&partial, "half a table").unwrap();
    assert_eq!(bare(&finished(here, &out)), bare(&expected));
    assert!(!partial.exists() && !here.join(&out).join("parts").exists());
}
