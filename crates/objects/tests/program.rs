//! The library and the program `atsplat-objects` together, on folders of this machine.

#![cfg(feature = "object-storage")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use atsplat_objects::{Mirror, ObjectError, StoreCopy};

/// The tests run in a process whose environment names the program.
const VARIABLE: &str = "ATSPLAT_OBJECTS";
const PROGRAM: &str = env!("CARGO_BIN_EXE_atsplat-objects");

fn read(path: &Path) -> Vec<u8> {
    fs::read(path).unwrap()
}

/// Runs the ignored test of this name in a process of its own, whose environment has this variable and no other of ours.
fn passes_with(test: &str, variable: &str, value: &str) {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", test, "--ignored", "--nocapture"]).env_remove(VARIABLE).env(variable, value);
    let output = command.output().unwrap();
    let [stdout, stderr] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
    // Without a test of this name the process succeeds too.
    assert!(output.status.success() && stdout.contains("1 passed"), "{test}: {stdout}{stderr}");
}

/// Runs the ignored test of this name with `program` in its environment.
fn with_program(test: &str, program: &str) {
    passes_with(test, VARIABLE, program);
}

#[test]
fn a_folder_of_this_machine_is_read_and_written() {
    with_program("in_process_read_and_write", PROGRAM);
}

#[test]
#[ignore = "run by the test above, which sets its environment"]
fn in_process_read_and_write() {
    let [remote, cache] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let url = format!("file://{}", remote.path().display());
    for name in ["a", "b"] {
        fs::write(remote.path().join(name), "aa").unwrap();
    }
    let mirror = Mirror::open(&url, Some(cache.path())).unwrap();
    let [a, b] = ["a", "b"].map(|name| mirror.path().join(name));
    mirror.fetch(std::slice::from_ref(&b)).unwrap();
    assert_eq!((read(&a), read(&b), mirror.traffic().bytes_read), (vec![], b"aa".to_vec(), 2));
    fs::write(remote.path().join("a"), "a").unwrap();
    let error = mirror.fetch(&[mirror.path().to_owned()]).unwrap_err();
    assert!(matches!(error, ObjectError::Changed { .. }), "a truncated object: {error}");
    let url = format!("{url}/store");
    for content in ["first", "second"] {
        let copy = StoreCopy::begin(&url, Some(cache.path()), "one").unwrap();
        fs::write(copy.folder().join("provenance.json"), content).unwrap();
        copy.finish().unwrap();
    }
    assert_eq!(read(&remote.path().join("store/provenance.json")), b"second");
    let store = Mirror::complete(&url, Some(cache.path())).unwrap();
    assert_eq!(read(&store.path().join("provenance.json")), b"second");
    let error = Mirror::open("s3://", Some(cache.path())).unwrap_err();
    assert!(matches!(error, ObjectError::Invalid { .. }), "{error}");
}

#[test]
fn without_the_program_the_error_says_how_to_install_it() {
    passes_with("in_process_without", "PATH", "/nowhere");
}

#[test]
#[ignore = "run by the test above, which sets its environment"]
fn in_process_without() {
    let error = Mirror::open("s3://bucket/data", Some(Path::new("cache"))).unwrap_err();
    assert!(
        matches!(error, ObjectError::NotInstalled { .. }) && error.to_string().contains("cargo install"),
        "{error}"
    );
}

#[test]
fn an_error_about_the_program_that_the_environment_names_says_so() {
    with_program("in_process_named", "/nowhere/atsplat-objects");
}

#[test]
#[ignore = "run by the test above, which sets its environment"]
fn in_process_named() {
    let error = Mirror::open("s3://bucket/data", Some(Path::new("cache"))).unwrap_err().to_string();
    assert!(error.contains("the variable ATSPLAT_OBJECTS names \"/nowhere/atsplat-objects\""), "{error}");
}

#[test]
fn a_program_that_ends_too_early_is_an_error() {
    with_program("in_process_early_end", "false");
}

#[test]
#[ignore = "run by the test above, which sets its environment"]
fn in_process_early_end() {
    let cache = tempfile::tempdir().unwrap();
    let error = Mirror::open("s3://bucket/data", Some(cache.path())).unwrap_err();
    assert!(matches!(error, ObjectError::Request { .. }), "{error}");
}

#[test]
fn lines_that_are_no_requests_end_the_program() {
    let mut command = Command::new(PROGRAM);
    let mut child = command.arg("file:///").stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(b"hello\n").unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("reading a request"));
}
