//! What is an error before any work, and how a command line is recorded.

use std::fs;

use crate::common::{SCENE, atsplat, succeed, write_trajectory};
use crate::evaluation::write_noise;

#[test]
fn urls_as_outputs_are_usage_errors_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for args in [
        &["render", SCENE, "--orbit", "1", "--size", "8x8", "--out", "s3://bucket/frames"][..],
        &["data", "simulate", "s3://bucket/rooms", "--scenes", "1"],
        &["data", "simulate", "rooms", "--scenes", "1", "--costs", "--plot", "gs://bucket/costs.svg"],
        &["stress", "--plot", "S3://bucket/stress.svg"],
        &["merge", "nowhere", "--out", "gcs://bucket/store"],
    ] {
        let rejected = atsplat(here, args);
        let url = args.iter().find(|arg| arg.contains("://")).unwrap();
        rejected.says(2, url);
    }
    assert_eq!(fs::read_dir(here).unwrap().count(), 0);
}

#[cfg(target_os = "linux")]
#[test]
fn help_and_version_that_cannot_be_written_are_failures() {
    for argument in ["--help", "--version"] {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output =
            std::process::Command::new(env!("CARGO_BIN_EXE_atsplat")).arg(argument).stdout(full).output().unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.code() == Some(1) && message.contains("writing to standard output"),
            "{argument}: {message}"
        );
    }
    let here = tempfile::tempdir().unwrap();
    assert!(succeed(here.path(), &["--version"]).starts_with("atsplat "));
    assert!(succeed(here.path(), &["help", "run"]).contains("--method"));
    assert_eq!(atsplat(here.path(), &["--nothing"]).code, 2);
}

/// Files of Gaussians in every format are inputs of these commands.
#[test]
fn help_names_the_extensions_of_all_files_of_gaussians() {
    let here = tempfile::tempdir().unwrap();
    for command in ["score", "fit"] {
        let help = succeed(here.path(), &[command, "--help"]);
        for extension in atsplat_splat::files::EXTENSIONS {
            assert!(help.contains(&format!(".{extension}")), "{command}: {extension}");
        }
    }
}

/// They are Latin-1, as on old disks.
#[cfg(target_os = "linux")]
#[test]
fn a_run_records_arguments_that_are_not_utf_8() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt as _;
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let data = OsStr::from_bytes(b"caf\xe9");
    fs::rename(here.join("data"), here.join(data)).unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_atsplat"));
    let command = command.args(["run", "tiny.toml", "--method", "warp", "--out", "store", "--data"]).arg(data);
    let output = command.current_dir(here).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let command = atsplat_results::Results::read(&here.join("store")).unwrap().provenance.command;
    assert_eq!(command.last().unwrap(), "caf\u{fffd}");
}

#[test]
fn a_report_is_written_by_one_process_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    succeed(here, &["run", "tiny.toml", "--data", "data", "--method", "warp", "--out", "store"]);
    let lock = atsplat_files::FolderLock::of(&here.join("page")).unwrap();
    atsplat(here, &["report", "store", "--out", "page"]).says(1, "page is being written by process ");
    drop(lock);
    succeed(here, &["report", "store", "--out", "page"]);
    assert!(here.join("page/index.html").is_file());
}

/// Two processes would otherwise mix their chunks in a folder, or replace each other's file unseen.
#[test]
fn an_output_is_written_by_one_process_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/aaaa.txt"), 20);
    fs::write(here.join("given.json"), r#"{ "aaaa": { "context": [4, 14], "target": [9] } }"#).unwrap();
    let rejected_by = |args: &str, out: &str| {
        let expected = format!("{out} is being written by process ");
        atsplat(here, &args.split(' ').collect::<Vec<_>>()).says(1, &expected);
    };
    for (args, out) in [
        ("data export data cameras.csv", "cameras.csv"),
        ("weights import nowhere.pth --model nano --out imported.safetensors", "imported.safetensors"),
        ("weights export micro-rooms --key-map identity --out other.safetensors", "other.safetensors"),
        ("protocol build data --sampler re10k-2v --out index.json", "index.json"),
        ("protocol extrapolate given.json --out further.json", "further.json"),
        ("protocol overlap given.json --data data --out overlap.json", "overlap.json"),
        ("protocol overlap given.json --data data --plot overlap.svg", "overlap.svg"),
        ("protocol estimators --scenes 1 --plot estimates.png", "estimates.png"),
    ] {
        let lock = atsplat_files::FileLock::of(&here.join(out)).unwrap();
        rejected_by(args, out);
        drop(lock);
        assert!(!here.join(out).exists(), "{args}");
    }
    let lock = atsplat_files::FolderLock::of(&here.join("chunks")).unwrap();
    rejected_by("data export data chunks --chunks", "chunks");
    drop(lock);
    succeed(here, &["data", "export", "data", "cameras.csv"]);
    let files = fs::read_dir(here).unwrap().map(|entry| entry.unwrap().path());
    let locks: Vec<_> = files.filter(|path| path.extension().is_some_and(|extension| extension == "lock")).collect();
    assert!(cfg!(not(unix)) || locks.is_empty(), "{locks:?}");
}
