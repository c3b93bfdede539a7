//! Object storage that fails after a dataset was opened: what was read until then is not the dataset.

#![cfg(unix)]

mod common;

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::process::Command;

use common::write_trajectory;

/// Stands for `atsplat-objects`: the objects are the files of a folder, one of which cannot be read.
const PROGRAM: &str = r#"#!/bin/sh
answer() {
  printf '{"id":%s,"traffic":{"requests":0,"bytes_read":0,"bytes_written":0},"content":%s}\n' "$id" "$1"
}
failure='{"Failed":{"Request":{"url":"s3://lab/data","action":"reading an object","detail":"connection reset"}}}'
while read -r line; do
  id=$(printf '%s' "$line" | sed 's/[^0-9]*\([0-9]*\).*/\1/')
  case $line in
    *'"List"'*) answer "$LISTED" ;;
    *"\"$LOST\""*) answer "$failure" ;;
    *)
      printf '%s\n' "$line" | tr '{' '\n' | sed -n 's/^"name":"\([^"]*\)".*"file":"\([^"]*\)".*/\1 \2/p' |
        while read -r name file; do
          mkdir -p "${file%/*}" && cp "$THERE/$name" "$file"
          answer "{\"Each\":[\"$name\",{\"tag\":null,\"version\":null}]}"
        done
      answer '"Done"'
      ;;
  esac
done
"#;

/// More scenes than are read to open the dataset, so that the last one is lost later.
#[test]
fn a_dataset_that_could_not_be_fetched_is_not_exported_as_a_shorter_one() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let there = here.join("there");
    fs::create_dir(&there).unwrap();
    let object = |scene: u32| {
        let name = format!("s{scene:02}.txt");
        write_trajectory(&there.join(&name), 20);
        serde_json::json!({ "name": name, "bytes": fs::metadata(there.join(&name)).unwrap().len(), "tag": "t" })
    };
    let listed = serde_json::json!({ "Objects": (0..25).map(object).collect::<Vec<_>>() }).to_string();
    let program = here.join("objects");
    fs::write(&program, PROGRAM).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let index = r#"{ "s00": { "context": [4, 14], "target": [9] }, "s24": { "context": [2, 9], "target": [5] } }"#;
    fs::write(here.join("given.json"), index).unwrap();
    let run = |args: &str, lost: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_atsplat"));
        command.args(args.split(' ')).args(["--cache", "cache"]).current_dir(here);
        command.env("ATSPLAT_OBJECTS", &program).env("THERE", &there).env("LISTED", &listed).env("LOST", lost);
        let output = command.output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let commands = [
        ("data export s3://lab/data cameras.csv", Some("cameras.csv")),
        ("data inspect s3://lab/data", None),
        ("protocol overlap given.json --data s3://lab/data --out overlap.json", Some("overlap.json")),
    ];
    for (lost, code) in [("s24.txt", 1), ("none.txt", 0)] {
        for (args, out) in commands {
            let (found, errors) = run(args, lost);
            assert_eq!(found, Some(code), "{args}: {errors}");
            assert_eq!(errors.contains("connection reset"), code == 1, "{args}: {errors}");
            assert!(out.is_none_or(|out| here.join(out).exists() == (code == 0)), "{args}: {errors}");
        }
    }
}
