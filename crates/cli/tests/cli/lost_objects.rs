//! Object storage that fails after a dataset was opened: what was read until then is not the dataset.

#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::Command;

use crate::common::write_trajectory;
use crate::evaluation::write_preset;
use atsplat_pixels::{ImageU8, encode_png};
use atsplat_scene::{SceneSource as _, Warnings};
use serde_json::json;
use tempfile::TempDir;

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

/// Objects below `s3://lab/data`, and the folder in which commands run.
struct Objects {
    here: TempDir,
    listed: String,
}

impl Objects {
    fn new(objects: &[(String, Vec<u8>)]) -> Self {
        let here = tempfile::tempdir().unwrap();
        let object = |(name, bytes): &(String, Vec<u8>)| {
            let file = here.path().join("there").join(name);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(&file, bytes).unwrap();
            json!({ "name": name, "bytes": bytes.len(), "tag": "t" })
        };
        let listed = json!({ "Objects": objects.iter().map(object).collect::<Vec<_>>() }).to_string();
        let program = here.path().join("objects");
        fs::write(&program, PROGRAM).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        Self { here, listed }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.here.path().join(name)
    }

    /// Exit code and standard error of a command for which the object `lost` cannot be read.
    fn run(&self, args: &str, lost: &str) -> (Option<i32>, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_atsplat"));
        command.args(args.split(' ')).current_dir(self.here.path());
        command.args(["--cache", "cache"].iter().filter(|_| args.contains("://")));
        command.env("ATSPLAT_OBJECTS", self.path("objects")).env("THERE", self.path("there"));
        let output = command.env("LISTED", &self.listed).env("LOST", lost).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    }
}

fn trajectory(frames: usize) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    write_trajectory(&folder.path().join("clip.txt"), frames);
    fs::read(folder.path().join("clip.txt")).unwrap()
}

/// More scenes than are read to open the dataset, so that the last one is lost later.
#[test]
fn a_dataset_that_could_not_be_fetched_is_not_exported_as_a_shorter_one() {
    let scenes: Vec<_> = (0..25).map(|scene| (format!("s{scene:02}.txt"), trajectory(20))).collect();
    let objects = Objects::new(&scenes);
    let index = r#"{ "s00": { "context": [4, 14], "target": [9] }, "s24": { "context": [2, 9], "target": [5] } }"#;
    fs::write(objects.path("given.json"), index).unwrap();
    let commands = [
        ("data export s3://lab/data cameras.csv", Some("cameras.csv")),
        ("data inspect s3://lab/data", None),
        ("protocol overlap given.json --data s3://lab/data --out overlap.json", Some("overlap.json")),
    ];
    for out in ["cameras.csv", "overlap.json"] {
        fs::write(objects.path(out), "old").unwrap();
    }
    for (lost, code) in [("s24.txt", 1), ("none.txt", 0)] {
        for (args, out) in commands {
            let (found, errors) = objects.run(args, lost);
            assert_eq!(found, Some(code), "{args}: {errors}");
            assert_eq!(errors.contains("connection reset"), code == 1, "{args}: {errors}");
            let is_old = |out: &str| fs::read_to_string(objects.path(out)).unwrap() == "old";
            assert!(out.is_none_or(|out| is_old(out) == (code == 1)), "{args}: {errors}");
        }
    }
}

/// The first scene's chunk is complete when an image of the second is lost.
#[test]
fn chunks_of_a_dataset_that_could_not_be_fetched_are_not_read_as_a_shorter_one() {
    let image = encode_png(&ImageU8::new(16, 9, vec![7; 16 * 9 * 3]).unwrap()).unwrap();
    let of_scene = |scene: u32| {
        let images = [0, 33_367].map(|time| (format!("s{scene}/{time}.png"), image.clone()));
        images.into_iter().chain([(format!("s{scene}.txt"), trajectory(2))])
    };
    let objects = Objects::new(&(0..3).flat_map(of_scene).collect::<Vec<_>>());
    let all = ["s0", "s1", "s2"];
    for (lost, out, code, keys) in [("s1/33367.png", "part", 1, &all[..0]), ("none", "whole", 0, &all[..])] {
        let (found, errors) = objects.run(&format!("data export s3://lab/data {out} --chunks --chunk-bytes 1"), lost);
        assert_eq!((found, errors.contains("connection reset")), (Some(code), code == 1), "{errors}");
        assert!(objects.path(out).join("000000.torch").is_file(), "{errors}");
        assert_eq!(atsplat_scene::open(objects.path(out), &mut Warnings::new()).unwrap().keys(), keys, "{out}");
    }
}

/// One image is there, and one is not.
#[test]
fn a_table_names_objects_by_their_urls() {
    let image = encode_png(&ImageU8::new(16, 9, vec![7; 16 * 9 * 3]).unwrap()).unwrap();
    let objects = Objects::new(&[("s0.txt".to_owned(), trajectory(2)), ("s0/33367.png".to_owned(), image)]);
    let (code, errors) = objects.run("data export s3://lab/data cameras.csv", "none");
    assert_eq!(code, Some(0), "{errors}");
    let table = fs::read_to_string(objects.path("cameras.csv")).unwrap();
    for cells in [",missing,s3://lab/data/s0/0", ",file,s3://lab/data/s0/33367.png,"] {
        assert!(table.contains(cells), "{cells}: {table}");
    }
    assert!(!table.contains("/cache/"), "{table}");
    assert!(errors.contains("1 × missing-image\n") && errors.contains("no s3://lab/data/s0/0"), "{errors}");
}

/// As a copy of a folder whose simulation was still running.
#[test]
fn strict_counts_a_simulation_that_had_not_ended_when_it_was_copied() {
    for (planned, code) in [(false, 0), (true, 4)] {
        let plan = planned.then(|| ("planned.json".to_owned(), b"[]".to_vec()));
        let objects: Vec<_> = [("s0.txt".to_owned(), trajectory(20))].into_iter().chain(plan).collect();
        let (found, errors) = Objects::new(&objects).run("data inspect s3://lab/data --strict", "none");
        assert_eq!(found, Some(code), "{errors}");
        let warning = "has not ended: s3://lab/data/planned.json lists all its scenes";
        assert_eq!(errors.contains(warning), planned, "{errors}");
    }
}

/// The protocol expects the size of the smaller copy, which an earlier command fetched or not.
#[test]
fn the_chosen_copy_of_images_does_not_depend_on_the_cache() {
    let pose = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let frame = |at: u32| {
        let pose = pose(f64::from(at) * 0.1);
        json!({ "file_path": format!("images/{at}.png"), "transform_matrix": pose })
    };
    let frames: Vec<_> = (0..3).map(frame).collect();
    let transforms = json!({ "w": 128, "h": 96, "fl_x": 128, "frames": frames }).to_string();
    let mut capture = vec![("a/transforms.json".to_owned(), transforms.into_bytes())];
    for (copy, width) in [("images_2", 64), ("images_4", 32)] {
        let height = 3 * width / 4;
        let image = ImageU8::new(width, height, vec![90; (width * height * 3) as usize]).unwrap();
        capture.extend((0..3).map(|at| (format!("a/{copy}/{at}.png"), encode_png(&image).unwrap())));
    }
    let objects = Objects::new(&capture);
    write_preset(objects.here.path(), 16);
    let preset = fs::read_to_string(objects.path("tiny.toml")).unwrap();
    let sized = "[preprocessing]\nexpected-size = { width = 32, height = 24 }";
    fs::write(objects.path("tiny.toml"), preset.replacen("[preprocessing]", sized, 1)).unwrap();
    fs::write(objects.path("given.json"), r#"{ "a": { "context": [0, 2], "target": [1] } }"#).unwrap();
    let lint = |data: &str| {
        let args = format!("protocol lint given.json --preset tiny.toml --data {data} --strict");
        objects.run(&args, "none").0
    };
    assert_eq!([lint("there"), lint("s3://lab/data")], [Some(0), Some(4)], "on disk, and of nothing fetched");
    let (fetched, errors) = objects.run("data inspect s3://lab/data --images 4", "none");
    assert_eq!((fetched, lint("s3://lab/data")), (Some(0), Some(4)), "{errors}");
}
