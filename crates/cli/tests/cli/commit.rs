//! The commit that a build records.

#[path = "../../build.rs"]
#[expect(dead_code, clippy::print_stdout, reason = "its main is that of builds, which cargo listens to")]
mod build;

use std::path::Path;
use std::process::Command;

fn git(at: &Path, args: &[&str]) {
    let identity = ["-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false"];
    let done = Command::new("git").arg("-C").arg(at).args(identity).args(args).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

fn write(at: &Path, file: &str, text: &str) {
    let path = at.join(file);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

/// Programs that differ have other commits, also if the difference is not committed.
#[test]
fn uncommitted_changes_of_sources_are_part_of_the_commit() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write(here, "crates/splat/src/lib.rs", "one");
    write(here, "docs/a.md", "one");
    git(here, &["init", "-q"]);
    git(here, &["add", "."]);
    git(here, &["commit", "-q", "-m", "first"]);
    let commit = || build::commit_of(here).unwrap();
    let clean = commit();
    assert!(clean.len() == 40 && clean.bytes().all(|byte| byte.is_ascii_hexdigit()), "{clean}");
    write(here, "docs/a.md", "two");
    assert_eq!(commit(), clean, "no part of the program");
    let mut found = vec![clean.clone()];
    for (file, text) in [
        ("crates/splat/src/lib.rs", "two"),
        ("crates/splat/src/lib.rs", "three"),
        ("crates/splat/src/other.rs", "one"),
        ("crates/splat/src/other.rs", "two"),
        ("eval/presets/a.toml", "one"),
        ("crates/splat/Cargo.toml", "opt-level = 1"),
    ] {
        write(here, file, text);
        let now = commit();
        assert!(now.starts_with(&format!("{clean}+")) && now.len() == 53, "{file}: {now}");
        assert!(!found.contains(&now), "{file}");
        found.push(now);
    }
    git(here, &["add", "."]);
    git(here, &["commit", "-q", "-m", "second"]);
    assert!(!commit().contains('+') && commit() != clean);
}

/// As in an archive of the sources, or where git refuses to read a repository.
#[test]
fn without_a_repository_a_hash_of_the_sources_tells_programs_apart() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let hash = || build::hash_of_sources(here);
    write(here, "eval/presets/a.toml", "one");
    assert_eq!(hash(), None, "without crates");
    write(here, "crates/splat/src/lib.rs", "one");
    write(here, "crates/splat/src/gpu/mod.rs", "two");
    let first = hash().unwrap();
    assert!(first.starts_with("sources+") && first.len() == 24, "{first}");
    write(here, "docs/a.md", "one");
    write(here, "crates/splat/tests/a.rs", "one");
    assert_eq!(hash().unwrap(), first, "no part of the program");
    let mut found = vec![first];
    for (file, text) in [
        ("crates/splat/src/lib.rs", "two"),
        ("crates/splat/src/gpu/mod.rs", "one"),
        ("crates/splat/src/gpu/other.rs", ""),
        ("crates/splat/Cargo.toml", "one"),
        ("eval/presets/a.toml", "two"),
        ("Cargo.lock", "one"),
    ] {
        write(here, file, text);
        let now = hash().unwrap();
        assert!(!found.contains(&now), "{file}");
        found.push(now);
    }
}
