//! What the rows of a process say that goes wrong, and what is no row.

#![cfg(unix)]

use std::fs;

use crate::common::shell::{exec, run_of, script, write_images};
use atsplat_eval::EvalError;
use atsplat_results::TrialStatus;
use atsplat_tests::on_threads;

/// What a method writes names files in a folder whose name is random, and seconds that it measured: here the number of a process.
#[test]
fn equal_runs_have_equal_rows_whatever_goes_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_images(here, 5);
    let body = r#"
      case $scene in
        wall-0) answer "\"error\": \"no parallax in $folder/context-0.npy\"";;
        wall-1) answer "\"images\": \"$folder/b.npy\"";;
        wall-2) cp -r warp/$scene-0 "$folder/out"; cp "$folder/out/000003.png" "$folder/out/3.png"
          answer "\"images\": \"$folder/out\"";;
        wall-3) answer "\"images\": \"a.npy\", \"seconds\": {\"encode\": 1000$$}";;
        *) echo "no weights in $folder" >&2; exit 3;;
      esac"#;
    let rows = || {
        let store = tempfile::tempdir().unwrap();
        let (found, _) = run_of(5, exec(&script(here, "images", body))).run(store.path()).unwrap();
        let trials = found.trials.iter().map(|row| (row.status, row.detail.clone()));
        let targets = found.targets.iter().map(|row| (row.status, row.detail.clone()));
        (trials.collect::<Vec<_>>(), targets.collect::<Vec<_>>())
    };
    let (trials, targets) = rows();
    let details: Vec<&str> = trials.iter().filter_map(|(_, detail)| detail.as_deref()).collect();
    let (_, second) = &targets[5];
    assert_eq!(second.as_deref(), Some("two files for frame 3: out/000003.png and out/3.png"), "{targets:?}");
    assert_eq!(details[0], "the method says: no parallax in context-0.npy");
    assert_eq!(details[1], "expected the file \"b.npy\" that it named, found none");
    assert!(details[4].ends_with(": no weights in the trial's folder"), "{details:?}");
    assert_eq!(rows(), (trials, targets));
}

/// As if the disk were full: the process is never asked, and the same command continues when it works again.
#[test]
fn files_for_a_method_that_cannot_be_written_stop_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_images(here, 3);
    let body = r#"if [ ! -e broken ]; then
          parent=$(dirname "$folder"); rm -rf "$parent"; : > "$parent"; echo "$parent" > broken
          answer '"not_applicable": "the first"'; continue
        fi
        cp -r warp/$scene-0 "$folder/out"; answer '"images": "out"'"#;
    let run = || on_threads(1, || run_of(3, exec(&script(here, "images", body))).run(&here.join("stopped")));
    let error = run().map(drop).unwrap_err();
    fs::remove_file(fs::read_to_string(here.join("broken")).unwrap().trim()).ok();
    assert!(matches!(error, EvalError::Io(_)), "{error:?}");
    let error = error.to_string();
    assert!(error.starts_with("creating a folder for a method's trial: ") && error.contains("/request-"), "{error}");
    let (found, _) = run().unwrap();
    let failed = found.trials.iter().filter(|trial| trial.status == TrialStatus::Failed).count();
    assert_eq!((found.trials.len(), failed), (3, 0), "{:?}", found.trials);
}
