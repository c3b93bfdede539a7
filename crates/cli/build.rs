//! Passes the commit to the binary if it is built inside its own repository, with a mark of the changes that are not committed, and
//! otherwise a hash of the sources.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What a binary is made of.
const SOURCES: [&str; 5] = [":(glob)crates/*/src/**", ":(glob)crates/*/Cargo.toml", "eval", "Cargo.toml", "Cargo.lock"];

pub(crate) fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Not `env!`: a script that another checkout has built with the same target folder is run here too.
    let Some(manifest) = std::env::var_os("CARGO_MANIFEST_DIR") else { return };
    let Ok(ours) = Path::new(&manifest).join("../..").canonicalize() else { return };
    for source in parts(&ours) {
        println!("cargo::rerun-if-changed={}", source.display());
    }
    // In another repository, the commits are not of this project. Git may be absent, or refuse a repository of another user.
    let top = git(&["rev-parse", "--show-toplevel"]).and_then(|top| Path::new(&top).canonicalize().ok());
    let is_repository = top.is_some_and(|top| top == ours);
    let log = git(&["rev-parse", "--git-path", "logs/HEAD"]);
    if let Some(log) = log.filter(|log| is_repository && Path::new(log).is_file()) {
        println!("cargo::rerun-if-changed={log}");
    }
    let commit = if is_repository { commit_of(&ours) } else { None };
    if let Some(commit) = commit.or_else(|| hash_of_sources(&ours)) {
        println!("cargo::rustc-env=ATSPLAT_COMMIT={commit}");
    }
}

/// The files and folders that a binary is made of, as [`SOURCES`].
fn parts(top: &Path) -> Vec<PathBuf> {
    let crates = entries(&top.join("crates")).into_iter();
    let of_crates = crates.flat_map(|part| [part.join("src"), part.join("Cargo.toml")]);
    let all = of_crates.chain(["eval", "Cargo.toml", "Cargo.lock"].map(|name| top.join(name)));
    // A path that is not there would run the script in every build.
    all.filter(|path| path.exists()).collect()
}

/// The entries of a folder in order; none if it cannot be listed.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> =
        folder.read_dir().into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    entries.sort();
    entries
}

/// `sources+` and a hash (FNV-1a) of all sources, for folders without commits. `None` without crates, as in a registry, where the
/// version says which program it is.
pub(crate) fn hash_of_sources(top: &Path) -> Option<String> {
    let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
    let mut found = false;
    let mut unread = parts(top);
    unread.reverse();
    while let Some(path) = unread.pop() {
        if path.is_dir() && !path.is_symlink() {
            unread.extend(entries(&path).into_iter().rev());
        } else if let Ok(bytes) = std::fs::read(&path) {
            let name = path.strip_prefix(top).unwrap_or(&path).to_string_lossy().replace('\\', "/");
            found |= name.starts_with("crates/");
            for part in [name.as_bytes(), bytes.as_slice()] {
                hash.add(&(part.len() as u64).to_le_bytes());
                hash.add(part);
            }
        }
    }
    found.then(|| format!("sources+{:016x}", hash.0))
}

struct Fnv(u64);

impl Fnv {
    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
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
