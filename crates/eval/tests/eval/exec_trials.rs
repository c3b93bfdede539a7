//! The numbers of the trials that a process is given.

#![cfg(unix)]

use std::collections::BTreeSet;
use std::fs;

use crate::common::shell::exec;
use crate::common::{Run, Walls, dataset, entry};
use atsplat_eval::runner::Selection;
use atsplat_eval::timing::TimingPlan;
use atsplat_results::Shard;

/// A shard, whose timing pass asks for trials again: a method that seeds by the number gives the same results as in a whole run.
#[test]
fn a_trials_number_is_its_entrys_position_in_the_whole_index() {
    let folder = tempfile::tempdir().unwrap();
    let (script, seen) = (folder.path().join("method.sh"), folder.path().join("seen"));
    let text = r#"echo '{"atsplat": 1, "name": "shell", "version": "1", "gives": "images"}'
field() { printf '%s' "$line" | sed "s/.*\"$1\":\"*\([^\",]*\).*/\1/"; }
while IFS= read -r line; do
  echo "$(field scene) $(field entry) $(field trial)" >> "$1"
  echo "{\"trial\": $(field trial), \"not_applicable\": \"it only counts\"}"
done
"#;
    fs::write(&script, text).unwrap();
    let method = exec(&format!("sh '{}' '{}'", script.display(), seen.display()));
    let entries = [entry(&[0, 4], &[1]), entry(&[0, 6], &[3])];
    let run = Run {
        selection: Selection { limit: None, shard: Some(Shard { number: 2, count: 2 }) },
        timing: Some(TimingPlan { trials: 1, ..TimingPlan::default() }),
        ..Run::new(vec![dataset(Walls::new(6, 8), &entries)], vec![method])
    };
    run.run(&folder.path().join("store")).unwrap();
    let numbers = (3..6).flat_map(|scene| [0, 1].map(|entry| format!("wall-{scene} {entry} {}", 2 * scene + entry)));
    let seen = fs::read_to_string(seen).unwrap();
    let seen: Vec<String> = seen.lines().map(str::to_owned).collect();
    assert_eq!(seen.iter().cloned().collect::<BTreeSet<_>>(), numbers.collect());
    assert!(seen.len() > 6, "the timing pass asks too: {seen:?}");
}
