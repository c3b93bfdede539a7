//! Runs the binary and writes small datasets for it.

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

/// A file of Gaussians.
pub(crate) const SCENE: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../splat/tests/fixtures/files/compressed_degree1.ply");

/// Outcome of a call of the binary.
pub(crate) struct Outcome {
    args: String,
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Outcome {
    /// Expects an exit code, and a text on standard error.
    #[track_caller]
    pub(crate) fn says(&self, code: i32, text: &str) {
        self.expect(code, text, &self.stderr);
    }

    /// Expects an exit code, and a text on standard output.
    #[track_caller]
    pub(crate) fn prints(&self, code: i32, text: &str) {
        self.expect(code, text, &self.stdout);
    }

    #[track_caller]
    fn expect(&self, code: i32, text: &str, found: &str) {
        let Self { args, stdout, stderr, .. } = self;
        let is_expected = self.code == code && found.contains(text);
        assert!(is_expected, "{args}: expected {code} and {text:?}, found {}: {stdout}{stderr}", self.code);
    }
}

/// Runs `atsplat` with `args` in `folder`.
pub(crate) fn atsplat(folder: &Path, args: &[&str]) -> Outcome {
    let output = Command::new(env!("CARGO_BIN_EXE_atsplat")).args(args).current_dir(folder).output().unwrap();
    Outcome {
        args: args.join(" "),
        code: output.status.code().unwrap(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs `atsplat`, expects exit code 0, and returns its standard output.
pub(crate) fn succeed(folder: &Path, args: &[&str]) -> String {
    let outcome = atsplat(folder, args);
    assert_eq!(outcome.code, 0, "{args:?}: {}", outcome.stderr);
    outcome.stdout
}

pub(crate) fn json_of(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

/// What [`succeed`] returns, as JSON.
pub(crate) fn printed_json(folder: &Path, args: &[&str]) -> Value {
    json_of(&succeed(folder, args))
}

pub(crate) fn read_json(path: &Path) -> Value {
    json_of(&std::fs::read_to_string(path).unwrap())
}

/// Starts `atsplat` in `folder`, and waits until it has written `file` there; it must not end before.
pub(crate) fn started(folder: &Path, args: &[&str], file: &str) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_atsplat"));
    started_command(command.args(args).current_dir(folder), &folder.join(file))
}

/// Starts a command, and waits until it has written a file or folder; it must not end before.
pub(crate) fn started_command(command: &mut Command, written: &Path) -> Child {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let begin = Instant::now();
    while !written.exists() && begin.elapsed() < Duration::from_mins(1) {
        assert!(child.try_wait().unwrap().is_none(), "it ended");
        sleep(Duration::from_millis(5));
    }
    child
}

/// Eight photos of 64×64 pixels around [`SCENE`], in `photos`.
pub(crate) fn photograph(folder: &Path) {
    succeed(folder, &["render", SCENE, "--orbit", "8", "--size", "64x64", "--out", "photos"]);
}

/// Writes a RE10K trajectory of a camera that moves right by 2 cm per frame and turns a little.
pub(crate) fn write_trajectory(path: &Path, frames: usize) {
    let mut text = "https://example.org/video\n".to_owned();
    for frame in 0..frames {
        let angle = 0.002 * frame as f64;
        let (sin, cos) = angle.sin_cos();
        let x = -0.02 * frame as f64;
        writeln!(
            text,
            "{} 0.48 0.86 0.5 0.5 0 0 {cos:.9} 0 {sin:.9} {x:.9} 0 1 0 0 {:.9} 0 {cos:.9} 0",
            frame * 33_367,
            -sin
        )
        .unwrap();
    }
    std::fs::write(path, text).unwrap();
}
