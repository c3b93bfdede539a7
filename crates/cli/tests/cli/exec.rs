//! `--method exec:COMMAND` as a user runs it.

#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::common::{atsplat, succeed};
use crate::evaluation::write_noise;
use atsplat_results::Results;

const HELLO: &str = r#"echo '{"atsplat": 1, "name": "shell", "version": "1", "gives": "images"}'"#;

/// Three scenes, the plane warp's images of them below `baseline`, and a script that answers with the images of a run, `$1` below the
/// working folder.
fn write_copying(here: &Path) {
    write_noise(here, 3);
    let run = ["run", "tiny.toml", "--data", "data", "--method", "warp", "--keep-images", "all", "--out", "baseline"];
    succeed(here, &run);
    let body = r#"
while IFS= read -r line; do
  field() { printf '%s' "$line" | sed "s/.*\"$1\":\"*\([^\",]*\).*/\1/"; }
  cp -r "$1/$(field scene)-0" "$(field folder)/out"
  echo "{\"trial\": $(field trial), \"images\": \"out\"}"
done"#;
    fs::write(here.join("method.sh"), format!("{HELLO}\n{body}\n")).unwrap();
}

/// Equal to the bit: the process is given a folder of images that `score` reads too.
#[test]
fn a_process_and_score_give_equal_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_copying(here);
    let (data, renders) = (["tiny.toml", "--data", "data"], "baseline/images/tiny/warp");
    succeed(here, &[&["score"], &data[..], &["--renders", renders, "--name", "mine", "--out", "scores"]].concat());
    let method = format!("nearest-view,mine=exec:sh method.sh {renders} 'a, b'");
    let run = [&["run"], &data[..], &["--method", &method, "--method-processes", "2", "--out", "store"]].concat();
    succeed(here, &run);
    let scores = Results::read(&here.join("scores")).unwrap().targets;
    let mine: Vec<_> = Results::read(&here.join("store"))
        .unwrap()
        .targets
        .into_iter()
        .filter(|row| row.key.method == "mine")
        .collect();
    assert_eq!((mine.len(), mine), (3 * 8, scores));
    assert!(succeed(here, &run).contains("0 results computed"), "resumed");
    // Another script is another method.
    fs::write(here.join("method.sh"), fs::read_to_string(here.join("method.sh")).unwrap() + "# changed\n").unwrap();
    atsplat(here, &run).says(1, "methods mine");
}

#[test]
fn no_process_starts_before_all_options_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    fs::write(here.join("method.sh"), "touch started\nexit 1\n").unwrap();
    let run = ["run", "tiny.toml", "--data", "data", "--out", "store", "--method", "a=exec:sh method.sh"];
    atsplat(here, &[&run[..], &["--repetitions", "6"]].concat()).says(2, "--repetitions requires --timing");
    assert!(!here.join("started").exists());
    let failed = atsplat(here, &[&run[..], &["--repetitions", "6", "--timing"]].concat());
    assert!(failed.code == 1 && here.join("started").exists(), "{}", failed.stderr);
}

/// A process says what it gives only when it has started.
#[test]
fn options_about_gaussians_are_errors_if_all_processes_give_images() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let fails = r#"while read -r line; do echo '{"trial": 0, "error": "none"}'; done"#;
    for gives in ["images", "gaussians"] {
        fs::write(here.join(gives), format!("{}\n{fails}\n", HELLO.replace("images", gives))).unwrap();
    }
    let run = |methods: &str, options: &[&str]| {
        let run = ["run", "tiny.toml", "--data", "data", "--out", "store", "--method", methods];
        atsplat(here, &[&run[..], options].concat())
    };
    for options in
        [&["--background", "white"][..], &["--constants", "inria"], &["--mode", "classic"], &["--opacities-as-stored"]]
    {
        for methods in ["a=exec:sh images", "nearest-view,a=exec:sh images"] {
            let error = format!("{} requires a method that gives Gaussians", options[0]);
            run(methods, options).says(2, &error);
        }
        assert!(!here.join("store").exists(), "{options:?}");
        run("a=exec:sh gaussians", options).says(1, "the method says: none");
        fs::remove_dir_all(here.join("store")).unwrap();
    }
}

/// The second of three scenes fails until a file is there.
#[test]
fn failed_trials_are_asked_again_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_copying(here);
    let path = here.join("method.sh");
    let fails = r#"  if [ "$(field scene)" = scene-01 ] && [ ! -e memory ]; then
    echo "{\"trial\": $(field trial), \"error\": \"out of memory\"}"; continue
  fi
  cp -r "#;
    fs::write(&path, fs::read_to_string(&path).unwrap().replacen("  cp -r ", fails, 1)).unwrap();
    let method = "mine=exec:sh method.sh baseline/images/tiny/warp";
    let run = ["run", "tiny.toml", "--data", "data", "--method", method, "--out", "store"];
    let retry = [&run[..], &["--retry-failed"]].concat();
    let first = atsplat(here, &run);
    first.prints(0, "3 results computed");
    let why =
        "warning: the first failed result: mine on tiny, scene \"scene-01\", entry 0: the method says: out of memory";
    assert_eq!(first.stderr.matches(why).count(), 1, "{}", first.stderr);
    fs::write(here.join("memory"), "").unwrap();
    assert!(succeed(here, &run).contains("0 results computed; 3 were there before"));
    let again = atsplat(here, &retry);
    assert!(again.stderr.contains("note: 1 failed result of mine is evaluated again"), "{}", again.stderr);
    assert!(again.stdout.contains("1 result computed; 2 were there before"), "{}", again.stdout);
    assert!(succeed(here, &retry).contains("0 results computed; 3 were there before"));
}

#[test]
fn a_command_that_is_no_method_is_an_error_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let run =
        |method: &str| atsplat(here, &["run", "tiny.toml", "--data", "data", "--out", "store", "--method", method]);
    let silent = run("exec:sh -c 'echo missing module >&2; exit 4'");
    let ended = "method exec: the command \"sh -c '";
    assert!(silent.stderr.contains(ended), "{}", silent.stderr);
    let ended = "exit 4'\": the method's process: it ended with exit status: 4";
    silent.says(1, ended);
    assert!(silent.stderr.contains("missing module") && !here.join("store").exists(), "{}", silent.stderr);
    run("mine=exec:sh -c 'sleep 5; exit 4'").says(1, "waiting for mine to start, at most 600 s: ");
    assert_eq!(run("exec:").code, 2);
}

/// A process that never reads its input again, and one that it started; they are killed however the run ends. The folder of its
/// trials is removed by the next run.
#[test]
#[cfg(target_os = "linux")]
fn a_killed_run_leaves_no_process_behind() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let hung = "read -r line\nsleep 77 &\necho $! > child\necho $$ > parent\nwait\n";
    fs::write(here.join("hung.sh"), format!("{HELLO}\n{hung}")).unwrap();
    fs::write(here.join("ended.sh"), HELLO).unwrap();
    let temporary = here.join("temporary");
    fs::create_dir(&temporary).unwrap();
    let start = |method: &str, out: &str| {
        let mut run = Command::new(env!("CARGO_BIN_EXE_atsplat"));
        run.args(["run", "tiny.toml", "--data", "data", "--method", method, "--out", out]);
        run.current_dir(here).env("TMPDIR", &temporary).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    };
    let folders = || {
        let names = fs::read_dir(&temporary).unwrap().map(|entry| entry.unwrap().file_name());
        names.filter(|name| name.to_string_lossy().starts_with("atsplat-method-")).count()
    };
    let eventually = |condition: &dyn Fn() -> bool| {
        (0..300).any(|_| {
            condition() || {
                sleep(Duration::from_millis(50));
                false
            }
        })
    };
    let lives = |process: &str| {
        let status = fs::read_to_string(format!("/proc/{process}/status"));
        status.is_ok_and(|status| !status.contains("State:\tZ"))
    };
    for (signal, out) in [("KILL", "killed"), ("TERM", "ended")] {
        let mut run = start("exec:sh hung.sh", out);
        let written = |name: &str| fs::read_to_string(here.join(name)).ok().filter(|process| process.ends_with('\n'));
        assert!(eventually(&|| written("parent").is_some()), "the process is asked");
        let processes = ["parent", "child"].map(|name| written(name).unwrap().trim().to_owned());
        assert!(processes.iter().all(|process| lives(process)), "{signal}");
        let sent = Command::new("kill").args(["-s", signal, &run.id().to_string()]).status().unwrap();
        assert!(sent.success() && !run.wait().unwrap().success(), "{signal}");
        assert!(eventually(&|| !processes.iter().any(|process| lives(process))), "one lives on after {signal}");
        assert_eq!(folders(), 1, "nobody could remove it");
        for name in ["parent", "child"] {
            fs::remove_file(here.join(name)).unwrap();
        }
    }
    start("exec:sh ended.sh", "other").wait().unwrap();
    assert_eq!(folders(), 0);
}
