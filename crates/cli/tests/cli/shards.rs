//! Parts of a run: numbered by the environment, reading no more than they need, merged when all are done.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::{atsplat, json_of, printed_json, succeed};
use crate::evaluation::{bare, write_noise};
use atsplat_results::{Results, Shard};
use atsplat_scene::Warnings;
use atsplat_scene::torch::export_chunks;

fn run_with(here: &Path, variables: &[(&str, &str)], args: &[&str]) -> (Option<i32>, String) {
    let mut run = Command::new(env!("CARGO_BIN_EXE_atsplat"));
    run.args(["run", "tiny.toml", "--data", "data", "--method", "nearest-view"]).args(args).current_dir(here);
    let output = run.envs(variables.iter().copied()).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn a_slurm_array_numbers_its_parts() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 4);
    fs::remove_file(here.join("data/scene-03.txt")).unwrap();
    let array = |id| {
        let (of, step) = (("SLURM_ARRAY_TASK_COUNT", "2"), ("SLURM_ARRAY_TASK_STEP", "1"));
        [("SLURM_ARRAY_TASK_ID", id), ("SLURM_ARRAY_TASK_MIN", "5"), ("SLURM_ARRAY_TASK_MAX", "6"), of, step]
    };
    for (id, out) in [("5", "first"), ("6", "second")] {
        let (code, message) = run_with(here, &array(id), &["--shard", "env", "--out", out]);
        assert_eq!(code, Some(0), "{message}");
    }
    let second = Results::read(&here.join("second")).unwrap();
    assert_eq!(second.provenance.shard, Some(Shard { number: 2, count: 2 }));
    assert_eq!(second.trials.len(), 2);
    succeed(here, &["merge", "first", "second", "--out", "merged"]);
    let merged = Results::read(&here.join("merged")).unwrap();
    assert_eq!(merged.trials.len(), 3);
    let warnings = merged.provenance.warnings.iter().filter(|warning| warning.kind.contains("not in the data"));
    let absent: Vec<(u64, &str)> = warnings.map(|warning| (warning.count, warning.example.as_str())).collect();
    assert_eq!(absent, [(1, "scene-03")], "one missing scene, though both parts miss it");
    let (code, message) = run_with(here, &[("RANK", "1")], &["--shard", "env", "--out", "third"]);
    assert!(code == Some(2) && message.contains("WORLD_SIZE"), "{message}");
}

/// The pages of the whole run and of its merged parts have the same images.
#[test]
fn a_merge_keeps_the_images_of_its_parts() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 3);
    let runs: [(&str, &[&str]); 3] = [("whole", &[]), ("one", &["--shard", "1/2"]), ("two", &["--shard", "2/2"])];
    for (out, shard) in runs {
        let args = [&["--out", out, "--keep-images", "all"][..], shard].concat();
        assert_eq!(run_with(here, &[], &args).0, Some(0), "{out}");
    }
    succeed(here, &["merge", "one", "two", "--out", "merged"]);
    let images = |store: &str| {
        let mut found = Vec::new();
        for method in ["nearest-view", "truth", "context"] {
            for scene in 0..3 {
                let trial = format!("images/tiny/{method}/scene-{scene:02}-0");
                for file in fs::read_dir(here.join(store).join(&trial)).unwrap() {
                    let file = file.unwrap();
                    found.push((trial.clone(), file.file_name(), fs::read(file.path()).unwrap()));
                }
            }
        }
        found.sort();
        found
    };
    assert_eq!(images("whole").len(), 3 * (8 + 8 + 2));
    assert!(images("merged") == images("whole"), "byte by byte");
    succeed(here, &["report", "merged", "--out", "page"]);
    let page = fs::read_to_string(here.join("page/index.html")).unwrap();
    assert!(page.contains("24 of 24 images are in this page"));
    assert!(page.contains("<dt>Commands (3)</dt>") && page.contains("merge one two --out merged</dd>"));
}

/// Killed when its store was whole, before it ended; the same results in another order have other records.
#[test]
fn a_merge_that_is_repeated_finds_its_store() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 2);
    for (shard, out) in [("1/2", "one"), ("2/2", "two")] {
        assert_eq!(run_with(here, &[], &["--shard", shard, "--out", out]).0, Some(0));
    }
    let merge = ["merge", "one", "two", "--out", "merged", "--json"];
    let first = atsplat(here, &merge);
    assert!(first.code == 0 && !first.stderr.contains("nothing was left to do"), "{}", first.stderr);
    let mark = here.join("merged/merge.partial");
    fs::write(&mark, "").unwrap();
    let files = || {
        ["provenance.json", "targets.parquet", "trials.parquet"]
            .map(|name| fs::read(here.join("merged").join(name)).unwrap())
    };
    let before = files();
    let again = atsplat(here, &merge);
    let said = "note: merged has exactly these results already: nothing was left to do";
    again.says(0, said);
    assert!(again.stdout == first.stdout && files() == before && !mark.exists());
    for others in [&["two", "one"][..], &["one", "--partial"]] {
        let expected = "merged: expected a folder without results, found results; choose another folder";
        atsplat(here, &[&["merge"], others, &["--out", "merged"]].concat()).says(1, expected);
    }
    assert!(files() == before);
}

/// One of two parts has a target without its image, so that its trial has a failed target.
#[test]
fn a_merge_counts_what_failed_in_its_parts() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 2);
    assert_eq!(run_with(here, &[], &["--out", "all", "--keep-images", "all"]).0, Some(0));
    let renders = "all/images/tiny/nearest-view";
    let images = fs::read_dir(here.join(renders).join("scene-01-0")).unwrap().map(|file| file.unwrap().path());
    let mut images = images.filter(|file| file.extension().is_some_and(|found| found == "png"));
    fs::remove_file(images.next().unwrap()).unwrap();
    for (shard, out, code) in [("1/2", "one", 0), ("2/2", "two", 4)] {
        let score = ["score", "tiny.toml", "--data", "data", "--renders", renders, "--name", "mine", "--strict"];
        let scored = atsplat(here, &[&score[..], &["--shard", shard, "--out", out]].concat());
        assert_eq!(scored.code, code, "{shard}: {}", scored.stderr);
    }
    let merged = atsplat(here, &["merge", "one", "two", "--out", "merged", "--strict", "--json"]);
    assert_eq!(merged.code, 4, "{}", merged.stderr);
    let report = json_of(&merged.stdout);
    assert_eq!(report["partial"], serde_json::json!([]), "{report}");
    let report = printed_json(here, &["merge", "one", "--out", "part", "--partial", "--json"]);
    assert_eq!(report["partial"], serde_json::json!(["shard 2 is missing"]), "{report}");
    for (stores, out, is_whole) in [(&["one", "two"][..], "whole", true), (&["two"], "again", false)] {
        let merged = atsplat(here, &[&["merge"], stores, &["--out", out, "--partial"]].concat());
        assert_eq!((merged.code, merged.stderr.contains("note: --partial has no effect")), (0, is_whole), "{out}");
    }
}

/// The second of two parts finds the data, their index and the renders in other folders.
#[test]
fn parts_may_find_their_data_elsewhere_and_tables_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 2);
    assert_eq!(run_with(here, &[], &["--out", "all", "--keep-images", "all"]).0, Some(0));
    let renders = "all/images/tiny/nearest-view";
    let score = |shard: &str, data: &str, renders: &str, out: &str| {
        let places = ["score", "tiny.toml", "--data", data, "--renders", renders, "--name", "mine"];
        succeed(here, &[&places[..], &["--shard", shard, "--out", out]].concat());
    };
    score("1/2", "data", renders, "one");
    fs::rename(here.join("data"), here.join("scratch")).unwrap();
    fs::rename(here.join(renders), here.join("tuesday")).unwrap();
    score("2/2", "scratch", "tuesday", "two");
    let merged = succeed(here, &["merge", "one", "two", "--out", "merged"]);
    let of_data = "tiny: 1 runs on data in another place than the first: scratch; the first is data\n";
    let of_files = "tiny: 1 runs on files in another folder than the first: mine: tuesday; the first is all/images";
    assert!(merged.contains(of_data) && merged.contains(of_files), "{merged}");
    succeed(here, &["report", "merged", "--out", "page", "--format", "markdown"]);
    let table = fs::read_to_string(here.join("page/tables/protocol-tiny.md")).unwrap();
    assert!(table.contains("in another folder than the first: mine: tuesday"), "{table}");
}

/// Two scenes, of which the first of three parts gets none; the other two have no renders of one of them.
#[test]
fn a_part_without_trials_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 2);
    let (code, message) = run_with(here, &[], &["--shard", "1/3", "--out", "one"]);
    assert!(code == Some(0) && message.contains("shard 1 of 3 of 2 scenes is empty"), "{message}");
    for (shard, out) in [("2/3", "two"), ("3/3", "three")] {
        assert_eq!(run_with(here, &[], &["--shard", shard, "--out", out, "--keep-images", "all"]).0, Some(0));
    }
    succeed(here, &["merge", "one", "two", "three", "--out", "merged"]);
    let renders = "two/images/tiny/nearest-view";
    for (shard, out, code) in [("2/3", "scored-2", 0), ("3/3", "scored-3", 1)] {
        let score = ["score", "tiny.toml", "--data", "data", "--renders", renders, "--name", "mine"];
        let scored = atsplat(here, &[&score[..], &["--shard", shard, "--out", out]].concat());
        assert_eq!(scored.code, code, "{shard}: {}", scored.stderr);
        assert_eq!(Results::read(&here.join(out)).unwrap().trials.len(), 1, "{shard}: also of failed trials");
    }
}

#[test]
fn a_part_that_is_not_done_is_named_and_not_merged() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 6);
    for (shard, out) in [("1/3", "one"), ("2/3", "two"), ("3/3", "three")] {
        assert_eq!(run_with(here, &[], &["--shard", shard, "--out", out]).0, Some(0));
    }
    // As a killed run leaves it: one of its two scenes has no row.
    let results = Results::read(&here.join("two")).unwrap();
    let scene = results.trials[0].key.scene.clone();
    let half = Results {
        trials: results.trials.into_iter().filter(|row| row.key.scene == scene).collect(),
        targets: results.targets.into_iter().filter(|row| row.key.scene == scene).collect(),
        ..results
    };
    half.write(&here.join("killed")).unwrap();
    let merge = ["merge", "one", "killed", "three", "--out", "merged"];
    let rejected = atsplat(here, &merge);
    assert_eq!(rejected.code, 1, "{}", rejected.stderr);
    let named = "shard 2 of 3 is not done: 1 of 2 entries of tiny under nearest-view";
    assert!(rejected.stderr.contains(named) && !here.join("merged").exists(), "{}", rejected.stderr);
    let both = atsplat(here, &["merge", "one", "killed", "--out", "merged"]);
    assert!(both.stderr.contains("shard 3 is missing; shard 2"), "{}", both.stderr);
    atsplat(here, &[&merge[..], &["--partial", "--strict"]].concat()).says(4, "the results are partial: shard 2 of 3");
    assert!(Results::read(&here.join("merged")).unwrap().provenance.shard.is_some(), "marked as partial");
    let report = atsplat(here, &["report", "merged", "one", "--out", "page", "--strict"]);
    report.says(4, "one: tiny: 2 shards of the run are missing");
    assert!(!report.stderr.contains("0 shards"), "{}", report.stderr);
    let accepted = atsplat(here, &["drift", "accept", "one", "--baseline", "b.json", "--why", "first"]);
    assert!(accepted.stdout.contains("warning: a part of the run, shard 1 of 3"), "{}", accepted.stdout);
    succeed(here, &["merge", "one", "killed", "two", "three", "--out", "whole"]);
}

/// Eight scenes in four chunks, of which three are no chunks any more when the second of four parts is run.
#[test]
fn a_part_opens_the_chunks_of_its_scenes_alone() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 8);
    let source = atsplat_scene::open(here.join("data"), &mut Warnings::default()).unwrap();
    let scene: u64 =
        fs::read_dir(here.join("data/scene-00")).unwrap().map(|file| file.unwrap().metadata().unwrap().len()).sum();
    let exported =
        export_chunks(&source, &here.join("chunks"), scene * 3 / 2, &mut Warnings::default(), &|| ()).unwrap();
    assert_eq!(exported.written.chunks.len(), 4);
    fs::copy(here.join("data/evaluation_index.json"), here.join("chunks/evaluation_index.json")).unwrap();
    fs::rename(here.join("data"), here.join("frames")).unwrap();
    fs::rename(here.join("chunks"), here.join("data")).unwrap();
    assert_eq!(run_with(here, &[], &["--out", "whole"]).0, Some(0));
    let whole = Results::read(&here.join("whole")).unwrap();
    for (number, chunk) in exported.written.chunks.iter().enumerate() {
        if number != 1 {
            fs::write(here.join("data").join(chunk.file_name().unwrap()), b"no chunk").unwrap();
        }
    }
    let (code, message) = run_with(here, &[], &["--shard", "2/4", "--out", "part", "--strict"]);
    assert_eq!(code, Some(0), "{message}");
    let part = Results::read(&here.join("part")).unwrap();
    let scenes: BTreeSet<&str> = part.trials.iter().map(|row| row.key.scene.as_str()).collect();
    assert_eq!(scenes, BTreeSet::from(["scene-02", "scene-03"]));
    let (trials, _) = bare(&part);
    assert!(trials.iter().all(|trial| whole.trials.contains(trial)), "the same rows as of the whole run");
    assert_eq!(
        run_with(here, &[], &["--shard", "1/4", "--out", "other", "--strict"]).0,
        Some(1),
        "another part needs them"
    );
}
