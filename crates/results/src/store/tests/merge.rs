//! Merging the stores of one run's shards.

use super::*;
use crate::{GapKind, RunWarning};

fn shard(number: u32, scenes: &[&str]) -> Results {
    let folder = tempfile::tempdir().unwrap();
    let provenance = Provenance { shard: Some(Shard { number, count: 3 }), ..Provenance::default() };
    let store = Store::create(folder.path(), provenance).unwrap();
    for scene in scenes {
        store.append(&trial(scene), &targets(scene)).unwrap();
    }
    store.add_timings(vec![timing(scenes[0], number)]).unwrap();
    store.finish().unwrap()
}

/// A shard with five warnings, and an entry for each of its scenes.
fn warned_shard(number: u32, scenes: &[&str]) -> Results {
    let mut part = shard(number, scenes);
    let entries = scenes.len() as u64;
    let preset = PresetRecord { name: "preset".to_owned(), entries, ..PresetRecord::default() };
    let warning = WarningCount { preset: "preset".to_owned(), count: 5, ..WarningCount::default() };
    (part.provenance.presets, part.provenance.warnings) = (vec![preset], vec![warning]);
    part
}

#[test]
fn a_store_that_is_given_twice_is_found_under_another_path() {
    let folder = tempfile::tempdir().unwrap();
    let [one, two] = ["one", "two"].map(|name| folder.path().join(name));
    fs::create_dir(&one).unwrap();
    let again = one.join("..").join("one");
    let missing = folder.path().join("missing");
    assert_eq!(repeated_store(&[two.clone(), one.clone(), again.clone()]), Some([again.as_path(), one.as_path()]));
    assert_eq!(repeated_store(&[two.clone(), one, missing.clone()]), None);
    assert_eq!(repeated_store(&[missing.clone(), two, missing.clone()]), Some([missing.as_path(), missing.as_path()]));
}

#[test]
fn shards_merge_into_one_run_and_missing_ones_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let whole = filled(folder.path(), &["a", "b", "c", "d"]).finish().unwrap();
    let shards = [shard(3, &["d"]), shard(1, &["c", "a"]), shard(2, &["b", "a"])];
    let merged = Results::merge(shards.to_vec()).unwrap();
    assert_eq!(merged.missing_shards, [] as [u32; 0]);
    assert_eq!(merged.results.trials, whole.trials);
    assert_eq!(merged.results.targets, whole.targets);
    assert_eq!(merged.results.provenance.shard, None);
    let machines: Vec<&str> = merged.results.timings.iter().map(|row| row.machine.processor.as_str()).collect();
    assert_eq!(machines, ["processor 2", "processor 1", "processor 3"], "scenes b, c and d, each on its machine");
    let written = folder.path().join("merged");
    merged.results.write(&written).unwrap();
    assert_eq!(Results::read(&written).unwrap().timings, merged.results.timings);
    let partial = Results::merge(shards[..2].to_vec()).unwrap();
    assert_eq!(partial.missing_shards, [2]);
    assert_eq!(
        partial.results.provenance.part().as_deref(),
        Some("shards 1 and 3 of 3"),
        "an incomplete run stays a part"
    );
    assert_eq!(partial.why_incomplete(), ["shard 2 is missing"]);
    assert_eq!(shards[0].provenance.part().as_deref(), Some("shard 3 of 3"));
    assert!(Results::merge(Vec::new()).is_err());
}

/// The first store has two of three shards.
#[test]
fn partial_results_are_completed_by_the_other_shards_and_by_no_overlapping_ones() {
    let shards = [warned_shard(1, &["a"]), warned_shard(2, &["b"]), warned_shard(3, &["c"])];
    let whole = Results::merge(shards.to_vec()).unwrap();
    let partial = Results::merge(shards[..2].to_vec()).unwrap().results;
    for parts in [vec![partial.clone(), shards[2].clone()], vec![shards[2].clone(), partial.clone(), partial.clone()]] {
        let merged = Results::merge(parts).unwrap();
        assert_eq!(merged.missing_shards, [] as [u32; 0]);
        let Provenance { presets, warnings, shard, merged_shards, .. } = &merged.results.provenance;
        assert_eq!((presets[0].entries, warnings[0].count), (3, 15), "each shard counts once");
        assert_eq!((*shard, merged_shards.as_slice()), (None, &[][..]));
        assert!(merged.results.gaps().iter().all(|gap| gap.kind != GapKind::MissingShards));
        assert_eq!(merged.results.trials, whole.results.trials);
    }
    let error = Results::merge(vec![shards[1].clone(), partial.clone()]).unwrap_err().to_string();
    assert!(error.contains("shard 2 in two of them"), "{error}");
    let gaps = partial.gaps().into_iter().filter(|gap| gap.kind == GapKind::MissingShards);
    let gaps: Vec<String> = gaps.map(|gap| gap.to_string()).collect();
    assert_eq!(gaps, ["preset: 1 shard of the run is missing: this is shards 1 and 2 of 3"]);
}

/// A store that is given twice, under whatever path, is one part of the run.
#[test]
fn a_repeated_shard_counts_once() {
    let (first, second) = (warned_shard(1, &["a", "b"]), warned_shard(2, &["c", "d"]));
    let merged = Results::merge(vec![first.clone(), first.clone(), second, first]).unwrap();
    let Provenance { presets, warnings, .. } = &merged.results.provenance;
    assert_eq!((presets[0].entries, warnings[0].count, merged.repeated), (4, 10, 4));
}

/// The second scene's entry, skipped for the poses of these methods.
fn skipped(methods: &[&str]) -> SkippedEntry {
    let methods = methods.iter().map(|name| (*name).to_owned()).collect();
    let [preset, scene, reason] = ["p", "b", "baseline"].map(str::to_owned);
    SkippedEntry { preset, scene, reason, methods, ..SkippedEntry::default() }
}

/// Two methods have a row of the first scene.
#[test]
fn an_entry_skipped_for_one_methods_poses_is_not_done_for_another() {
    let method = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
    let mut results = Results::default();
    results.provenance.presets = vec![PresetRecord { name: "p".to_owned(), entries: 2, ..PresetRecord::default() }];
    results.provenance.methods = ["m", "n"].map(method).to_vec();
    results.trials = vec![trial("a"), TrialRow { key: key("a").of_method("n"), ..trial("a") }];
    let mut unfinished = |methods: &[&str]| -> Vec<(String, u64)> {
        results.provenance.skipped = vec![skipped(methods)];
        results.unfinished().into_iter().map(|run| (run.method, run.entries)).collect()
    };
    assert_eq!(unfinished(&["m"]), [("n".to_owned(), 1)]);
    assert!(unfinished(&["m", "n"]).is_empty());
    assert!(unfinished(&[]).is_empty(), "for a reason that is the same for all methods");
}

/// Of two entries each, `m` has one under `p`, `n` one under `q` and `o` both under `p`; they were run apart.
#[test]
fn only_methods_with_a_row_were_interrupted() {
    let preset = |name: &str| PresetRecord { name: name.to_owned(), entries: 2, ..PresetRecord::default() };
    let method = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
    let mut results = Results::default();
    results.provenance.presets = ["p", "q"].map(preset).to_vec();
    results.provenance.methods = ["m", "n", "o"].map(method).to_vec();
    let rows = [("p", "m", "a"), ("q", "n", "b"), ("p", "o", "a"), ("p", "o", "b")];
    let row = |(preset, method, scene): (&str, &str, &str)| TrialRow {
        key: TrialKey { preset: preset.to_owned(), ..key(scene).of_method(method) },
        ..trial(scene)
    };
    results.trials = rows.map(row).to_vec();
    let found = results.interrupted();
    let found: Vec<_> = found.iter().map(|run| (run.preset.as_str(), run.method.as_str(), run.entries)).collect();
    assert_eq!(found, [("p", "m", 1), ("q", "n", 1)]);
    assert_eq!(results.unfinished().len(), 5, "the other pairs have no row");
    assert_eq!(results.cut_off(), results.interrupted(), "each protocol and each method has a row");
}

/// Each shard ran `m` under `p` and `n` under `q` into one store, as sweeps do.
#[test]
fn shards_of_several_runs_are_done_when_each_run_is() {
    let row = |preset: &str, method: &str, scene: &str| TrialRow {
        key: TrialKey { preset: preset.to_owned(), ..key(scene).of_method(method) },
        ..trial(scene)
    };
    let part = |number: u32, scene: &str| {
        let preset = |name: &str| PresetRecord { name: name.to_owned(), entries: 1, ..PresetRecord::default() };
        let method = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
        let mut results = Results::default();
        results.provenance.shard = Some(Shard { number, count: 2 });
        results.provenance.presets = ["p", "q"].map(preset).to_vec();
        results.provenance.methods = ["m", "n"].map(method).to_vec();
        results.trials = vec![row("p", "m", scene), row("q", "n", scene)];
        results
    };
    let merged = Results::merge(vec![part(1, "a"), part(2, "b")]).unwrap();
    assert_eq!((merged.why_incomplete(), merged.results.provenance.shard), (Vec::new(), None));
    // One run has no row in one shard, and one shard has a copy that was cut off.
    let cut_off = Results { trials: vec![row("p", "m", "b")], ..part(2, "b") };
    let merged = Results::merge(vec![part(1, "a"), cut_off.clone()]).unwrap();
    assert_eq!(merged.why_incomplete(), ["shard 2 of 2 is not done: 0 of 1 entries of q under n"]);
    assert!(merged.results.provenance.shard.is_some());
    let merged = Results::merge(vec![cut_off, part(2, "b"), part(1, "a")]).unwrap();
    assert_eq!((merged.why_incomplete(), merged.results.provenance.shard), (Vec::new(), None));
    // Both shards were killed before the second run.
    let first_run = |number, scene| Results { trials: vec![row("p", "m", scene)], ..part(number, scene) };
    let merged = Results::merge(vec![first_run(1, "a"), first_run(2, "b")]).unwrap();
    let said = merged.why_incomplete();
    assert!(said.contains(&"shard 2 of 2 is not done: 0 of 1 entries of q under n".to_owned()), "{said:?}");
    assert!(merged.results.provenance.shard.is_some());
}

/// Copies of the data in two places have the same scenes or not; overlapping parts have the number of scenes that a limit takes.
#[test]
fn shards_of_differently_ordered_copies_are_not_merged() {
    let part = |number: u32, scenes: [&str; 2], copy: &str, divided: &str| {
        let mut part = shard(number, &scenes);
        (part.provenance.shard, part.provenance.limit) = (Some(Shard { number, count: 2 }), Some(3));
        part.provenance.presets = vec![PresetRecord {
            name: "p".to_owned(),
            dataset: copy.to_owned(),
            entries: scenes.len() as u64,
            scenes_sha256: Some(divided.to_owned()),
            ..PresetRecord::default()
        }];
        part
    };
    let first = || part(1, ["a", "b"], "one", "abcd");
    let merged = Results::merge(vec![first(), part(2, ["c", "d"], "another", "abcd")]).unwrap();
    let Provenance { warnings, shard, .. } = merged.results.provenance;
    let found = (RunWarning::of(&warnings[0].kind), warnings[0].count, shard);
    assert_eq!(found, (Some((RunWarning::OtherData, None)), 1, None));
    for scenes in [["c", "d"], ["b", "c"]] {
        let refused = Results::merge(vec![first(), part(2, scenes, "another", "abc")]).unwrap_err().to_string();
        assert!(refused.contains("scenes under p") && refused.contains("run all shards on equal copies"), "{refused}");
    }
}

/// A shard of two scenes under methods m and n, and the methods with L1 in its first scenes.
fn with_l1(number: u32, scenes: [&str; 2], with: &[(&str, usize)]) -> Results {
    let method = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
    let metric = |id: &str| MetricRecord { id: id.to_owned(), ..MetricRecord::default() };
    let mut part = Results::default();
    part.provenance.shard = Some(Shard { number, count: 2 });
    part.provenance.presets = vec![PresetRecord { name: "p".to_owned(), entries: 2, ..PresetRecord::default() }];
    part.provenance.methods = ["m", "n"].map(method).to_vec();
    part.provenance.metrics = ["psnr", "l1"].map(metric).to_vec();
    for (method, (at, scene)) in
        ["m", "n"].into_iter().flat_map(|name| scenes.iter().enumerate().map(move |at| (name, at)))
    {
        let key = key(scene).of_method(method);
        let is_added = with.iter().any(|(name, scenes)| *name == method && at < *scenes);
        part.trials.push(TrialRow { key: key.clone(), ..trial(scene) });
        part.targets.extend(targets(scene).into_iter().map(|mut target| {
            target.key = key.clone();
            if is_added && target.status == TargetStatus::Scored {
                target.scores.insert("l1".to_owned(), 0.25);
            }
            target
        }));
    }
    part
}

/// Killed while it added a metric, which some of its rows have.
#[test]
fn a_shard_that_lacks_a_metric_in_some_rows_is_not_done() {
    let whole = || with_l1(1, ["a", "b"], &[("m", 2)]);
    assert_eq!(whole().unfinished(), [], "n was not run again");
    let killed = with_l1(2, ["c", "d"], &[("m", 1)]);
    let gaps: Vec<String> = killed.gaps().iter().map(ToString::to_string).collect();
    assert!(gaps.contains(&"p: the run of m is unfinished: 1 of 2 index entries with l1".to_owned()), "{gaps:?}");
    let merged = Results::merge(vec![whole(), killed]).unwrap();
    assert_eq!(merged.why_incomplete(), ["shard 2 of 2 is not done: 1 of 2 entries of p under m with l1"]);
    assert!(merged.results.provenance.shard.is_some());
    let merged = Results::merge(vec![whole(), with_l1(2, ["c", "d"], &[("m", 2)])]).unwrap();
    assert_eq!((merged.why_incomplete(), merged.results.provenance.shard), (Vec::new(), None));
}

/// L1 was added for both methods in one shard, and for one in the other.
#[test]
fn shards_with_a_metric_of_different_methods_are_not_the_whole_run() {
    let parts = vec![with_l1(1, ["a", "b"], &[("m", 2), ("n", 2)]), with_l1(2, ["c", "d"], &[("m", 2)])];
    assert!(parts.iter().all(|part| part.unfinished().is_empty()));
    let merged = Results::merge(parts).unwrap();
    assert_eq!(merged.why_incomplete(), ["a store is not done: 2 of 4 entries of p under n with l1"]);
    assert!(merged.results.provenance.shard.is_some());
}

#[test]
fn a_reason_of_several_stores_concerns_the_methods_of_each() {
    let merged = |first: &[&str], second: &[&str]| {
        let [first, second] = [first, second].map(|methods| {
            let mut part = shard(1, &["a"]);
            part.provenance.skipped = vec![skipped(methods)];
            part
        });
        Results::merge(vec![first, second]).unwrap().results.provenance.skipped
    };
    assert_eq!(merged(&["n"], &["m"]), [skipped(&["m", "n"])]);
    assert_eq!(merged(&["m"], &[]), [skipped(&[])]);
}

#[test]
fn rejects_merging_different_runs() {
    let mut other = shard(2, &["a"]);
    other.targets[0].scores.insert("psnr".to_owned(), 12.0);
    let error = Results::merge(vec![shard(1, &["a"]), other]).unwrap_err().to_string();
    assert!(error.contains("scene \"a\"") && error.contains("differ in psnr") || error.contains("scores"), "{error}");
    let mut built = shard(2, &["b"]);
    built.provenance.commit = Some("other".to_owned());
    let error = Results::merge(vec![shard(1, &["a"]), built.clone()]).unwrap_err().to_string();
    assert!(error.contains("commits of atsplat"), "{error}");
    let parts = [shard(1, &["a"]), shard(3, &["c"]), built];
    assert_eq!(Results::merge(parts.to_vec()).unwrap_err().part, Some(2));
    let [first, second, other] = parts;
    assert_eq!(Results::merge(vec![first, other, second]).unwrap_err().part, Some(1), "the first that does not fit");
    assert_eq!(Results::merge(Vec::new()).unwrap_err().part, None);
    let folder = tempfile::tempdir().unwrap();
    let whole = filled(folder.path(), &["a"]).finish().unwrap();
    assert!(Results::merge(vec![shard(1, &["a"]), whole]).is_err());
}

/// Two stores of one shard, each with another method.
#[test]
fn rows_of_other_data_are_not_merged() {
    let merged_with = |data: &str| {
        let mut other = shard(1, &["a"]);
        for trial in &mut other.trials {
            (trial.key, trial.data_hash) = (trial.key.of_method("n"), Some(data.to_owned()));
        }
        other.targets.iter_mut().for_each(|target| target.key = target.key.of_method("n"));
        Results::merge(vec![shard(1, &["a"]), other])
    };
    assert_eq!(merged_with("data a 0").unwrap().results.trials.len(), 2);
    let error = merged_with("data a 1").unwrap_err().to_string();
    assert!(error.contains("different images or cameras: m on p, scene \"a\", entry 0"), "{error}");
}

#[test]
fn rejects_conflicting_times_of_one_pass() {
    let [mut first, mut second] = [shard(1, &["a"]), shard(2, &["b"])];
    second.timings = first.timings.clone();
    assert_eq!(Results::merge(vec![first.clone(), second.clone()]).unwrap().results.timings.len(), 1);
    first.timings[0].encode[0] = 9.0;
    let error = Results::merge(vec![first, second]).unwrap_err().to_string();
    assert!(error.contains("the times of one pass on processor 1"), "{error}");
}

/// The first part has an image as a link relative to its place, and another that a power failure has cut.
#[cfg(unix)]
#[test]
fn a_merged_store_has_whole_images_and_no_symbolic_links() {
    use crate::store::images::{hash_of_bytes, image_path, is_stored, write_image};
    use atsplat_pixels::ImageU8;

    let root = tempfile::tempdir().unwrap();
    let [first, second, merged] = ["first", "second", "merged"].map(|name| root.path().join(name));
    let image = |sample| ImageU8::new(1, 1, vec![sample; 3]).unwrap();
    let [x, y] = ["x", "y"].map(|scene| sample_rows::key("m", scene, 0));
    write_image(&first, &x, 4, &image(20)).unwrap();
    let linked = image_path(&first, &x, 4);
    fs::rename(&linked, linked.with_file_name("file")).unwrap();
    std::os::unix::fs::symlink("file", &linked).unwrap();
    for part in [&first, &second] {
        write_image(part, &y, 4, &image(30)).unwrap();
    }
    let cut = fs::read(image_path(&first, &y, 4)).unwrap()[..40].to_vec();
    fs::write(image_path(&first, &y, 4), &cut).unwrap();
    let parts = [first.clone(), second];
    let write = || Results::default().write_merged(&merged, &parts).unwrap();
    assert!(write() && !write(), "the second time, nothing is left to do");
    fs::remove_file(image_path(&merged, &x, 4)).unwrap();
    assert!(write() && !write(), "an image was lost");
    for (key, sample) in [(&x, 20), (&y, 30)] {
        assert!(is_stored(&merged, key, 4, Some(&hash_of_bytes(&image(sample)))).unwrap(), "{key}");
    }
    assert!(!image_path(&merged, &x, 4).is_symlink());
    assert_eq!(fs::read(image_path(&first, &y, 4)).unwrap(), cut, "the part keeps its file");
}

/// As of somebody who wants the results of several methods in one table.
#[test]
fn stores_that_are_no_shards_of_one_run_are_not_merged_and_the_message_says_what_takes_them() {
    let of_method = |number: u32, name: &str| {
        let mut part = shard(number, &["a"]);
        part.provenance.methods = vec![MethodRecord { name: name.to_owned(), ..MethodRecord::default() }];
        part
    };
    let mut whole = of_method(2, "warp");
    whole.provenance.shard = None;
    for (second, expected) in [
        (of_method(2, "mine"), "methods of the two runs differ: "),
        (whole, "numbers of shards of the two runs differ: expected 3 shards, found a whole run; "),
    ] {
        let refused = Results::merge(vec![of_method(1, "warp"), second]).unwrap_err().to_string();
        let is_advised = refused.ends_with("; `atsplat report` takes the stores of several");
        assert!(refused.starts_with(expected) && is_advised, "{refused}");
    }
}
