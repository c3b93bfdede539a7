//! Passes the commit to the binary if it is built inside its own repository, with a mark of the changes that are not committed.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// What a binary is made of.
const SOURCES: [&str; 4] = [":(glob)crates/*/src/**", "eval", "Cargo.toml", "Cargo.lock"];

pub(crate) fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // In another repository, the commits are not of this project.
    // Not `env!`: a script that another checkout has built with the same target folder is run here too.
    let Some(manifest) = std::env::var_os("CARGO_MANIFEST_DIR") else { return };
    let ours = Path::new(&manifest).join("../..").canonicalize().ok();
    let top = git(&["rev-parse", "--show-toplevel"]).and_then(|top| Path::new(&top).canonicalize().ok());
    let Some(top) = top.filter(|top| ours.as_ref() == Some(top)) else { return };
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).is_file()) {
        println!("cargo::rerun-if-changed={log}");
    }
    let sources = top.join("crates").read_dir().into_iter().flatten().flatten().map(|entry| entry.path().join("src"));
    for source in sources.chain([top.join("eval"), top.join("Cargo.toml"), top.join("Cargo.lock")]) {
        println!("cargo::rerun-if-changed={}", source.display());
    }
    if let Some(commit) = commit_of(&top) {
        println!("cargo::rustc-env=ATSPLAT_COMMIT={commit}");
    }
}

/// The commit of a repository, followed by `+` and a hash of its uncommitted changes, if it has any: two programs that differ may not
/// share a store.
pub(crate) fn commit_of(top: &Path) -> Option<String> {
    let folder = top.to_str()?;
    let head = git(&["-C", folder, "rev-parse", "HEAD"])?;
    let changes = git(&[&["-C", folder, "diff", "HEAD", "--binary", "--no-ext-diff", "--"], &SOURCES[..]].concat())?;
    let others = [&["-C", folder, "ls-files", "--others", "--exclude-standard", "--"], &SOURCES[..]].concat();
    let mut all = changes;
    for file in git(&others)?.lines() {
        all.push_str(file);
        all.push_str(&git(&["-C", folder, "hash-object", "--", file])?);
    }
    if all.is_empty() { Some(head) } else { Some(format!("{head}+{}", hash(&all)?.get(..12)?)) }
}

fn hash(text: &str) -> Option<String> {
    let mut git = Command::new("git")
        .args(["hash-object", "--stdin"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .ok()?;
    git.stdin.take()?.write_all(text.as_bytes()).ok()?;
    text_of(git.wait_with_output().ok()?)
}

fn git(args: &[&str]) -> Option<String> {
    text_of(Command::new("git").args(args).output().ok()?)
}

fn text_of(output: std::process::Output) -> Option<String> {
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
