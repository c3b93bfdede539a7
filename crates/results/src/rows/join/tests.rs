//! What runs of one store may differ in, and what merged shards count.

use super::*;
use crate::{AdapterRecord, MetricRecord, StatedCost, StatedSeconds};

#[test]
fn rows_of_several_processors_name_them_all() {
    let on = |processor: &str| Provenance { processor: processor.to_owned(), ..Provenance::default() };
    let mut all = on("b, avx2");
    for other in ["a, avx512", "b, avx2", "a, avx512; c"] {
        all.merge_shard(on(other), Shards::New).unwrap();
    }
    assert_eq!(all.processor, "a, avx512; b, avx2; c");
}

/// A run with a limit, the same without, and the first again; two parts of a run, each resumed by its command.
#[test]
fn every_command_is_recorded_once() {
    let of = |command: &str| {
        let command = command.split(' ').map(str::to_owned).collect();
        Provenance { command, ..Provenance::default() }
    };
    let all = |run: &Provenance| run.commands().map(|command| command.join(" ")).collect::<Vec<_>>();
    let mut known = of("atsplat run --limit 2");
    for next in ["atsplat run", "atsplat run --limit 2", "atsplat run"] {
        known.add_commands(&of(next));
    }
    known.add_commands(&Provenance { command: Vec::new(), ..of("") });
    assert_eq!(all(&known), ["atsplat run --limit 2", "atsplat run"]);
    let mut merged = of("atsplat run --shard 1/2");
    merged.merge_shard(known, Shards::New).unwrap();
    merged.merge_shard(of("atsplat run --shard 1/2"), Shards::Repeated).unwrap();
    assert_eq!(all(&merged), ["atsplat run --shard 1/2", "atsplat run --limit 2", "atsplat run"]);
    let text = serde_json::to_string(&of("atsplat run")).unwrap();
    assert!(!text.contains("more-commands"), "as older versions wrote it");
    assert_eq!(serde_json::from_str::<Provenance>(&text).unwrap(), of("atsplat run"));
}

/// Two machines without the weights of LPIPS, whose torch has its cache in different places.
#[test]
fn searched_folders_without_weights_may_differ() {
    let of = |absent: Option<&str>| {
        let hash = absent.is_none().then(|| "hash".to_owned());
        let id = "lpips".to_owned();
        let metric =
            MetricRecord { id, weights_sha256: hash, absent: absent.map(str::to_owned), ..MetricRecord::default() };
        let schema_version = crate::store::SCHEMA_VERSION;
        Provenance { schema_version, metrics: vec![metric], ..Provenance::default() }
    };
    let known = of(Some("weights absent: LPIPS (VGG) needs a.pth; get it; looked in ~/.cache/torch, /scratch/a"));
    let same = || of(Some("weights absent: LPIPS (VGG) needs a.pth; get it; looked in no folder"));
    let (mut resumed, mut merged) = (known.clone(), known.clone());
    resumed.resume_with(same()).unwrap();
    merged.merge_shard(same(), Shards::New).unwrap();
    assert!(resumed == known && merged == known, "the first record stays: {resumed:?} {merged:?}");
    known.clone().resume_with(of(None)).unwrap();
    assert!(of(None).resume_with(same()).is_err(), "rows would lack a number that others have");
    let other = || of(Some("weights absent: LPIPS (VGG) needs b.pth; get it; looked in no folder"));
    assert!(known.clone().resume_with(other()).is_err() && other().resume_with(same()).is_err());
    for (other, expected) in [(of(None), "lpips: in one store not computed, "), (other(), "lpips.absent: ")] {
        let refused = known.clone().merge_shard(other, Shards::New).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }
}

#[test]
fn parts_of_a_run_are_named() {
    let of = |shard| Provenance { schema_version: crate::store::SCHEMA_VERSION, shard, ..Provenance::default() };
    let second = Some(crate::Shard { number: 2, count: 8 });
    let refused = of(None).resume_with(of(second)).unwrap_err().to_string();
    assert!(refused.contains("shards of the two runs differ: the whole run and shard 2 of 8; "), "{refused}");
}

/// Every shard warns of what is true of the whole run; each of its scenes causes separate warnings.
#[test]
fn warnings_about_a_run_are_counted_once_over_its_shards() {
    let of = |kind: &str, count| {
        let warning = WarningCount { kind: kind.to_owned(), count, ..WarningCount::default() };
        Provenance { warnings: vec![warning], ..Provenance::default() }
    };
    for (kind, expected) in
        [("learned metrics with other weights than the published ones", 2), ("frames without an image", 5)]
    {
        let mut known = of(kind, 2);
        known.merge_shard(of(kind, if expected == 2 { 2 } else { 3 }), Shards::New).unwrap();
        assert_eq!(known.warnings[0].count, expected, "{kind}");
    }
}

#[test]
fn shards_may_list_their_presets_and_methods_in_another_order() {
    let of = |names: [&str; 2]| {
        let method = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
        Provenance { methods: names.map(method).to_vec(), ..Provenance::default() }
    };
    let mut known = of(["b", "a"]);
    known.merge_shard(of(["a", "b"]), Shards::New).unwrap();
    assert_eq!(known.methods, of(["b", "a"]).methods, "in the order of the first");
    let (before, command) = (known.clone(), vec!["atsplat".to_owned()]);
    let other = Provenance { command, ..of(["a", "c"]) };
    let refused = known.merge_shard(other, Shards::New).unwrap_err().to_string();
    assert_eq!(known, before, "nothing is added");
    assert!(refused.contains("b: present and absent") && refused.contains("c: absent and present"), "{refused}");
    let of = |names: [&str; 2]| {
        let preset = |name: &str| PresetRecord { name: name.to_owned(), ..PresetRecord::default() };
        Provenance { presets: names.map(preset).to_vec(), ..Provenance::default() }
    };
    let mut known = of(["b", "a"]);
    known.merge_shard(of(["a", "b"]), Shards::New).unwrap();
    assert_eq!(known.presets, of(["b", "a"]).presets, "in the order of the first");
    assert!(known.merge_shard(of(["a", "c"]), Shards::New).is_err());
}

/// A method of a store has one device; another one needs another name. The provenance lists every adapter once.
#[test]
fn rows_of_two_devices_are_not_mixed_under_one_name() {
    let adapter = |driver: &str| {
        let [name, backend, driver] = ["card", "Vulkan", driver].map(str::to_owned);
        Some(AdapterRecord { name, backend, driver })
    };
    let on = |name: &str, driver: Option<&str>| MethodRecord {
        name: name.to_owned(),
        network_adapter: driver.and_then(adapter),
        renderer_adapter: driver.and_then(adapter),
        ..MethodRecord::default()
    };
    let of = |methods: &[MethodRecord]| Provenance {
        schema_version: crate::store::SCHEMA_VERSION,
        adapter: Provenance::adapters(methods),
        methods: methods.to_vec(),
        ..Provenance::default()
    };
    let mut known = of(&[on("m", Some("driver 1"))]);
    for other in [None, Some("driver 2")] {
        let refused = known.clone().resume_with(of(&[on("m", other)])).unwrap_err().to_string();
        assert!(refused.contains("methods m") && refused.contains("network-adapter"), "{refused}");
        assert!(known.clone().merge_shard(of(&[on("m", other)]), Shards::New).is_err());
    }
    known.resume_with(of(&[on("cpu", None), on("other", Some("driver 2"))])).unwrap();
    assert_eq!(known.adapter.as_deref(), Some("card (Vulkan), driver 1; card (Vulkan), driver 2"));
}

/// Gaussians under two protocols, and seconds under the first of them.
#[test]
fn costs_can_be_stated_later_and_corrected_each_under_its_protocol() {
    let of = |stated: &[(&str, Option<u64>, Option<f64>)]| {
        let seconds = |encode| StatedSeconds { encode, render: None, machine: "a card".to_owned() };
        let cost = |gaussians, encode: Option<f64>| StatedCost { gaussians, seconds: encode.map(seconds) };
        let stated = stated.iter().map(|(preset, count, encode)| ((*preset).to_owned(), cost(*count, *encode)));
        let method = MethodRecord { name: "m".to_owned(), stated: stated.collect(), ..MethodRecord::default() };
        let schema_version = crate::store::SCHEMA_VERSION;
        Provenance { schema_version, methods: vec![method], ..Provenance::default() }
    };
    let mut known = of(&[]);
    let (two, six) = (("2 views", Some(7), None), ("6 views", Some(21), None));
    for (next, expected) in [
        (of(&[("2 views", Some(5), None)]), of(&[("2 views", Some(5), None)])),
        (of(&[two]), of(&[two])),
        (of(&[]), of(&[two])),
        (of(&[six]), of(&[two, six])),
        (of(&[("2 views", None, Some(0.5))]), of(&[("2 views", Some(7), Some(0.5)), six])),
        (of(&[("2 views", Some(8), None)]), of(&[("2 views", Some(8), Some(0.5)), six])),
    ] {
        known.resume_with(next).unwrap();
        assert_eq!(known.methods, expected.methods);
    }
    assert!(known.merge_shard(of(&[six]), Shards::New).is_err(), "parts of one run state the same");
}

/// The second run corrects the title, the third states none.
#[test]
fn imported_files_can_be_titled_later_and_other_methods_cannot() {
    let of = |kind: &str, title: &str| {
        let [name, kind, title] = ["m", kind, title].map(str::to_owned);
        let methods = vec![MethodRecord { name, kind, title, ..MethodRecord::default() }];
        let schema_version = crate::store::SCHEMA_VERSION;
        Provenance { schema_version, methods, ..Provenance::default() }
    };
    for kind in ["renders", "ply"] {
        let mut known = of(kind, "m");
        for (next, expected) in [("Ours (K=4)", "Ours (K=4)"), ("Ours (K=8)", "Ours (K=8)"), ("m", "Ours (K=8)")] {
            known.resume_with(of(kind, next)).unwrap();
            assert_eq!(known.methods, of(kind, expected).methods);
        }
        assert!(known.merge_shard(of(kind, "m"), Shards::New).is_err(), "parts of one run have the same title");
    }
    let refused = of("exec", "m").resume_with(of("exec", "Ours")).unwrap_err().to_string();
    assert!(refused.contains("methods m") && refused.contains("title"), "{refused}");
    assert!(of("ply", "m").resume_with(of("renders", "Ours")).is_err(), "another kind");
}

#[test]
fn paths_to_the_same_places_are_equal() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("data/test")).unwrap();
    std::fs::write(folder.path().join("index.json"), "{}").unwrap();
    let of = |data: &str, index: &str, renders: &str| {
        let [dataset, index, renders] =
            [data, index, renders].map(|path| folder.path().join(path).display().to_string());
        let method = MethodRecord {
            name: "m".to_owned(),
            parameters: [("folder".to_owned(), renders.into())].into(),
            ..MethodRecord::default()
        };
        Provenance {
            schema_version: crate::store::SCHEMA_VERSION,
            presets: vec![PresetRecord { name: "p".to_owned(), dataset, index, ..PresetRecord::default() }],
            methods: vec![method],
            ..Provenance::default()
        }
    };
    let with_other_index = |mut run: Provenance| {
        run.presets[0].index_sha256 = "another".to_owned();
        run
    };
    let known = of("data/test", "index.json", "data");
    let other = || of("data/../data/test/", "./index.json", "data/test/..");
    let (mut resumed, mut merged) = (known.clone(), known.clone());
    resumed.resume_with(other()).unwrap();
    merged.merge_shard(other(), Shards::Repeated).unwrap();
    assert!(resumed == known && merged == known, "{resumed:?} {merged:?}");
    let other_index = || with_other_index(of("data/test", "data", "data"));
    let refused = known.clone().resume_with(other_index()).unwrap_err().to_string();
    assert!(refused.contains("index: ") && refused.contains("index-sha256: "), "{refused}");
    assert!(known.clone().merge_shard(other_index(), Shards::Repeated).is_err());
    let elsewhere = || of("data", "copy.json", "data/test");
    let expect = |found: Provenance, runs: u64| {
        let Provenance { warnings, .. } = &found;
        let [data, files] = warnings.as_slice() else { panic!("{warnings:?}") };
        assert_eq!((data.kind.clone(), data.count), (RunWarning::OtherData.to_string(), runs));
        assert!(data.example.ends_with(&format!("data; the first is {}", known.presets[0].dataset)), "{data:?}");
        assert_eq!((files.kind.clone(), files.count), (RunWarning::OtherFolder.about("m"), runs));
        assert!(files.example.contains("data/test; the first is "), "{files:?}");
        assert!(warnings.iter().all(|warning| warning.preset == "p"), "{warnings:?}");
        assert_eq!(Provenance { warnings: Vec::new(), ..found }, known, "the first places stay");
    };
    let (mut resumed, mut merged) = (known.clone(), known.clone());
    resumed.resume_with(elsewhere()).unwrap();
    assert_eq!(resumed, known, "nothing was compared yet");
    resumed.take_places(&elsewhere());
    assert_eq!(resumed, elsewhere(), "no other place is left");
    merged.merge_shard(elsewhere(), Shards::New).unwrap();
    expect(merged.clone(), 1);
    merged.merge_shard(elsewhere(), Shards::New).unwrap();
    expect(merged, 2);
    assert_eq!(known.moved(&other()), crate::Moved::default());
    let moved = known.moved(&elsewhere());
    let [folder_of_known, folder_of_other] = &moved.files["m"];
    assert!(folder_of_known.ends_with("/data") && folder_of_other.ends_with("/data/test"), "{moved:?}");
    assert_eq!(moved.data["p"], [&known, &elsewhere()].map(|run| run.presets[0].dataset.clone()));
}

/// Another copy of the data has the scenes in another order.
#[test]
fn shards_and_limits_are_parts_of_the_same_scenes() {
    let of = |scenes: Option<&str>, shard, limit| {
        let (name, scenes_sha256) = ("p".to_owned(), scenes.map(str::to_owned));
        let presets = vec![PresetRecord { name, scenes_sha256, ..PresetRecord::default() }];
        let schema_version = crate::store::SCHEMA_VERSION;
        Provenance { schema_version, shard, limit, presets, ..Provenance::default() }
    };
    let part = |number| Some(crate::Shard { number, count: 2 });
    let refused = of(Some("a"), part(1), None).merge_shard(of(Some("b"), part(2), None), Shards::New).unwrap_err();
    let said = refused.to_string();
    assert!(said.starts_with("scenes under p of the two runs differ: the data of one have other scenes"), "{said}");
    assert!(said.ends_with("; run all shards on equal copies of the data"), "{said}");
    of(Some("a"), part(1), None).merge_shard(of(Some("a"), part(2), None), Shards::New).unwrap();
    of(None, part(1), None).merge_shard(of(None, part(2), None), Shards::New).unwrap();
    let is_resumed = |now: &str, shard, limits: [Option<u64>; 2]| {
        let [mut known, now] =
            [("a", limits[0]), (now, limits[1])].map(|(scenes, limit)| of(Some(scenes), shard, limit));
        known.resume_with(now).is_ok()
    };
    for (shard, limits) in
        [(part(1), [None; 2]), (None, [Some(3); 2]), (None, [Some(3), Some(6)]), (None, [Some(3), None])]
    {
        assert!(is_resumed("a", shard, limits) && !is_resumed("b", shard, limits), "{shard:?} {limits:?}");
    }
    assert!(is_resumed("b", None, [None; 2]), "all scenes, in whichever order");
    let mut older = of(None, part(1), None);
    older.resume_with(of(Some("a"), part(1), None)).unwrap();
    assert_eq!(older.presets[0].scenes_sha256, None, "nobody knows");
}
