//! Changes planted in what methods and stages start from, and in how metrics and methods are set: each is named, and nothing else.

use atsplat_protocol::Preset;
use atsplat_scene::preprocess::RescaleAndCrop;

use super::*;
use crate::probe::Attribution;

/// Makes a changed built-in preset the preset of the rows.
fn set_preset(results: &mut Results, change: fn(&mut Preset)) {
    let mut preset = Preset::named("rooms-2v-64").unwrap();
    change(&mut preset);
    let record = &mut results.provenance.presets[0];
    (record.hash, record.toml) = (preset.hash().unwrap().to_string(), preset.to_toml().unwrap());
}

/// Six scenes of three targets under a built-in preset.
fn base() -> Results {
    let mut base = store(true, 6, 0.0, 1);
    set_preset(&mut base, |_| ());
    base.provenance.presets[0].index_sha256 = "an index".to_owned();
    base
}

/// A change that also moves a number, against a baseline that may be of an older version.
fn report_of(change: fn(&mut Results), of_older_version: bool) -> DriftReport {
    let mut baseline = baseline_of(&base());
    for trial in baseline.trials.iter_mut().filter(|_| of_older_version) {
        (trial.context, trial.data_hash) = (None, None);
    }
    let mut now = base();
    now.targets[7].scores.values_mut().for_each(|score| *score -= 1.0);
    change(&mut now);
    compare(&now, &baseline).with_attribution(Attribution { stages: Vec::new(), metrics: Vec::new() })
}

fn found(report: &DriftReport) -> Vec<(Cause, &str)> {
    report.changes.iter().map(|change| (change.stage, change.detail.as_str())).collect()
}

/// Another trial on other data, as with a moved camera.
fn move_camera(results: &mut Results) {
    let trial = &mut results.trials[2];
    (trial.trial_hash, trial.data_hash) = ("moved".to_owned(), Some("moved".to_owned()));
}

/// Another trial on other data, of another context frame under another index.
fn other_entry(results: &mut Results) {
    move_camera(results);
    results.trials[2].context = vec![0, 8];
    results.provenance.presets[0].index_sha256 = "another".to_owned();
}

/// Other trials and images of the same data.
fn crop(results: &mut Results) {
    set_preset(results, |preset| preset.preprocessing.steps.push(RescaleAndCrop::new(48, 40).into()));
    for trial in &mut results.trials {
        trial.trial_hash.push_str(" cropped");
        trial.context_hashes.iter_mut().for_each(|hash| hash.push_str(" cropped"));
    }
    results.targets.iter_mut().filter_map(|row| row.truth_hash.as_mut()).for_each(|hash| hash.push_str(" cropped"));
}

type Case = (fn(&mut Results), Cause, &'static str);

#[test]
fn each_cause_is_named_and_nothing_else() {
    let cases: [Case; 10] = [
        (move_camera, Cause::Cameras, "sampled, scene scene 002, entry 0"),
        (other_entry, Cause::Index, "sampled, scene scene 002, entry 0: context frame 9 is now 8"),
        (
            |now| {
                now.trials[2].trial_hash = "other".to_owned();
                now.targets[7].frame = 5;
                now.provenance.presets[0].index_sha256 = "another".to_owned();
            },
            Cause::Index,
            "sampled, scene scene 002, entry 0: target frame 1 is now 5",
        ),
        (crop, Cause::Preprocessing, "preset sampled, preprocessing.steps: was [], is now [{"),
        (
            |now| set_preset(now, |preset| preset.renderer.dilation = 0.1),
            Cause::Protocol,
            "preset sampled, renderer.dilation: was 0.3, is now 0.1",
        ),
        (
            |now| set_preset(now, |preset| preset.dataset = "yards".to_owned()),
            Cause::Protocol,
            "preset sampled, dataset: was rooms, is now yards",
        ),
        (
            |now| {
                set_preset(now, |preset| preset.near_far.near = 0.02);
                now.trials.iter_mut().for_each(|trial| trial.trial_hash.push_str(" nearer"));
            },
            Cause::Protocol,
            "preset sampled, near-far.near: was 0.01, is now 0.02",
        ),
        (
            |now| now.trials[4].context_hashes[1] = "blurred".to_owned(),
            Cause::Data,
            "sampled, scene scene 004, frame 9 (context)",
        ),
        (
            |now| set_preset(now, |preset| preset.metrics.ssim = "ssim-clipped"),
            Cause::Metric,
            "preset sampled, metrics.ssim: was ssim, is now ssim-clipped",
        ),
        (
            |now| now.provenance.methods[0].weights_sha256 = Some("trained again".to_owned()),
            Cause::Method,
            "method m, weights-sha256: was nothing, is now trained again",
        ),
    ];
    for (change, cause, detail) in cases {
        let report = report_of(change, false);
        let named = found(&report);
        let expected_outside = if cause == Cause::Metric { vec![Cause::Outside] } else { vec![] };
        let [(first, text), rest @ ..] = &named[..] else { panic!("{detail}: {report}") };
        assert_eq!((*first, report.verdict), (cause, DriftVerdict::Drifted), "{report}");
        assert!(text.starts_with(detail), "{detail}: {report}");
        assert_eq!(rest.iter().map(|(cause, _)| *cause).collect::<Vec<_>>(), expected_outside, "{report}");
        let said = format!("The first change is in the {}: {detail}", cause.name());
        assert!(report.to_string().contains(&said), "{said}: {report}");
    }
    let outside = report_of(|_| (), false);
    assert_eq!(outside.first_change(), Some(Cause::Outside), "{outside}");
    assert!(outside.to_string().contains("The cause is outside atsplat's pipeline: "), "{outside}");
    let json = serde_json::to_value(report_of(move_camera, false)).unwrap();
    let expected = serde_json::json!([{ "stage": "cameras", "detail": "sampled, scene scene 002, entry 0" }]);
    assert_eq!(json["changes"], expected);
}

#[test]
fn images_of_another_crop_are_not_compared() {
    let report = report_of(crop, false);
    let expected = DataComparison { preprocessed_differently: 6 * 4, ..DataComparison::default() };
    assert_eq!(report.data, expected, "{report}");
    assert!(report.findings.iter().all(|finding| finding.kind != FindingKind::Data), "{report}");
    assert!(report.to_string().contains("24 images not compared: the preset crops or resizes them differently"));
    assert_eq!(serde_json::to_value(&report.data).unwrap()["preprocessed-otherwise"], 24, "a name in files");
    // With another crop, the data of a trial still tell.
    let both = report_of(
        |now| {
            crop(now);
            now.trials[4].data_hash = Some("restored".to_owned());
        },
        false,
    );
    let first = (Cause::Data, "images or cameras of sampled, scene scene 004, entry 0");
    assert_eq!(found(&both)[0], first, "{both}");
    assert_eq!(found(&both)[1].0, Cause::Preprocessing, "{both}");
    // A camera has moved under a protocol that names its data differently.
    let renamed = report_of(
        |now| {
            set_preset(now, |preset| preset.dataset = "yards".to_owned());
            move_camera(now);
        },
        false,
    );
    let causes: Vec<Cause> = found(&renamed).into_iter().map(|(cause, _)| cause).collect();
    assert_eq!(causes, [Cause::Cameras, Cause::Protocol], "{renamed}");
}

/// It has neither the context frames nor the data of a trial.
#[test]
fn a_baseline_of_an_older_version_tells_what_it_can() {
    let causes = |change: fn(&mut Results)| {
        let report = report_of(change, true);
        report.changes.into_iter().map(|change| (change.stage, change.detail)).collect::<Vec<_>>()
    };
    let at = "sampled, scene scene 002, entry 0";
    assert_eq!(causes(move_camera), [(Cause::Cameras, at.to_owned())]);
    let unclear = format!("{at}: other context frames, or other cameras");
    assert_eq!(causes(other_entry), [(Cause::Index, unclear)]);
    let cropped = causes(crop);
    assert_eq!(cropped.iter().map(|(cause, _)| *cause).collect::<Vec<_>>(), [Cause::Preprocessing], "{cropped:?}");
}

/// A change, and what it is blamed on.
type Blamed = (fn(&mut Results), Cause);

/// The index is rewritten, and the preset explains the other trials; which entries they have is unknown.
#[test]
fn an_older_baseline_blames_no_index_for_what_the_preset_changed() {
    let changes: [Blamed; 2] = [
        (crop, Cause::Preprocessing),
        (
            |now| {
                set_preset(now, |preset| preset.near_far.near = 0.02);
                now.trials.iter_mut().for_each(|trial| trial.trial_hash.push_str(" nearer"));
            },
            Cause::Protocol,
        ),
    ];
    for (change, cause) in changes {
        let mut baseline = baseline_of(&base());
        baseline.trials.iter_mut().for_each(|trial| (trial.context, trial.data_hash) = (None, None));
        let mut now = base();
        change(&mut now);
        now.provenance.presets[0].index_sha256 = "another".to_owned();
        let report = compare(&now, &baseline);
        assert_eq!(found(&report).iter().map(|(cause, _)| *cause).collect::<Vec<_>>(), [cause], "{report}");
        let of_index = [FindingKind::Index, FindingKind::RewrittenIndex];
        assert!(report.findings.iter().all(|finding| !of_index.contains(&finding.kind)), "{report}");
    }
}

/// A run with `--limit` of 3 of 6 scenes, under another file of the index.
#[test]
fn entries_that_were_not_run_are_not_missing_from_the_index() {
    let with = |entries: u64| {
        let mut results = base();
        let record = &mut results.provenance.presets[0];
        (record.entries, record.entries_of_index) = (entries, 6);
        results
    };
    let baseline = baseline_of(&with(6));
    let under_another_file = |entries: u64| {
        let mut now = with(entries);
        now.provenance.presets[0].index_sha256 = "another".to_owned();
        now.trials.truncate(3);
        now.targets.truncate(9);
        compare(&now, &baseline)
    };
    let limited = under_another_file(3);
    let expected =
        [(FindingKind::RewrittenIndex, DriftVerdict::Same, 1), (FindingKind::Missing, DriftVerdict::Drifted, 9)];
    assert_eq!((kinds(&limited), limited.first_change()), (expected.to_vec(), None), "{limited}");
    let whole = under_another_file(6);
    assert_eq!((kinds(&whole)[0].0, whole.first_change()), (FindingKind::Index, Some(Cause::Index)), "{whole}");
}

/// Runs of the first six of 24 scenes, in one of which two scenes have left the index.
#[test]
fn an_index_of_another_length_names_the_first_entry_of_one_run_alone() {
    let mut long = base();
    (long.provenance.presets[0].entries, long.provenance.presets[0].entries_of_index) = (6, 24);
    let mut short = long.clone();
    let record = &mut short.provenance.presets[0];
    (record.entries, record.entries_of_index, record.index_sha256) = (4, 22, "another".to_owned());
    short.trials.retain(|row| !["scene 002", "scene 004"].contains(&row.key.scene.as_str()));
    short.targets.retain(|row| !["scene 002", "scene 004"].contains(&row.key.scene.as_str()));
    let cases = [
        (&long, &short, "22 entries of the index instead of 24; of those that were run, scene 002 0 is missing"),
        (&short, &long, "24 entries of the index instead of 22; of those that were run, scene 002 0 is new"),
    ];
    for (then, now, example) in cases {
        let report = compare(now, &baseline_of(then));
        let finding = report.findings.iter().find(|finding| finding.kind == FindingKind::Index).unwrap();
        assert_eq!((finding.count, finding.example.as_str()), (2, example), "{report}");
        assert_eq!(found(&report), [(Cause::Index, format!("sampled, {example}").as_str())], "{report}");
    }
}

/// A change of an index, and what is said of it.
type IndexChange = (fn(&mut Results), &'static str);

#[test]
fn a_new_file_of_the_same_entries_is_not_drift() {
    let baseline = baseline_of(&base());
    let against = |change: fn(&mut Results)| {
        let mut now = base();
        now.provenance.presets[0].index_sha256 = "another".to_owned();
        change(&mut now);
        compare(&now, &baseline)
    };
    let rewritten = against(|_| ());
    assert_eq!(kinds(&rewritten), [(FindingKind::RewrittenIndex, DriftVerdict::Same, 1)]);
    assert_eq!((rewritten.verdict, rewritten.changes.len()), (DriftVerdict::Same, 0), "{rewritten}");
    let said = "same          sampled: another index file with the same entries\n";
    assert!(rewritten.to_string().contains(said), "{rewritten}");
    let cases: [IndexChange; 3] = [
        (|now| now.targets[4].overlap = Some(0.25), "scene 001 0: overlap was none, is now 0.25"),
        (|now| now.provenance.presets[0].entries_of_index = 7, "7 entries of the index instead of 0"),
        (
            |now| {
                let mut row = now.trials[5].clone();
                row.key.entry = 1;
                now.trials.push(row);
            },
            "scene 005 1: new",
        ),
    ];
    for (change, example) in cases {
        let other = against(change);
        let finding = other.findings.iter().find(|finding| finding.kind == FindingKind::Index).unwrap();
        assert_eq!((finding.verdict, finding.example.as_str()), (DriftVerdict::Drifted, example), "{other}");
        assert_eq!(other.first_change(), Some(Cause::Index), "{other}");
    }
    // A camera has moved as well.
    let moved = against(move_camera);
    assert_eq!(found(&moved), [(Cause::Cameras, "sampled, scene scene 002, entry 0")], "{moved}");
}

/// The baseline of another preset, and of another method.
#[test]
fn without_a_common_target_nothing_was_compared() {
    let baseline = baseline_of(&base());
    let renames: [fn(&mut Results, &str); 2] = [
        |now, name| {
            now.provenance.presets[0].name = name.to_owned();
            keys(now).for_each(|key| key.preset = name.to_owned());
        },
        |now, name| {
            now.provenance.methods[0].name = name.to_owned();
            keys(now).for_each(|key| key.method = name.to_owned());
        },
    ];
    for rename in renames {
        let mut now = base();
        rename(&mut now, "other");
        let report = compare(&now, &baseline);
        assert_eq!(report.verdict, DriftVerdict::Nothing, "{report}");
        assert!(report.to_string().contains("\nNothing could be compared: "), "{report}");
        // Nor does a probe say anything about another run's numbers.
        let probed = report.clone().with_attribution(data::probed(&[Stage::Renderer]));
        assert_eq!((probed.verdict, probed.first_change()), (DriftVerdict::Nothing, Some(Cause::Renderer)), "{probed}");
        let said = probed.to_string();
        assert!(said.contains("may be that of another run. The first change is in the renderer: "), "{said}");
        let error = DriftError::Unacceptable { expected: "a probe", found: "none".to_owned() };
        assert_eq!(report.with_failed_stage(&error).verdict, DriftVerdict::Nothing);
    }
    let same = compare(&base(), &baseline).with_attribution(data::probed(&[Stage::Renderer]));
    assert_eq!(same.verdict, DriftVerdict::Drifted, "{same}");
    // A method that fails everywhere has drifted.
    let mut failed = base();
    for row in &mut failed.targets {
        row.status = TargetStatus::Failed;
        row.scores.clear();
    }
    assert_eq!(compare(&failed, &baseline).verdict, DriftVerdict::Drifted);
}

#[test]
fn a_method_of_one_run_alone_is_one_difference() {
    let one = base();
    let mut two = base();
    let parameters = ["depth", "width"].map(|name| (name.to_owned(), serde_json::json!({ "first": 1, "last": 2 })));
    let method = MethodRecord { name: "n".to_owned(), parameters: parameters.into(), ..MethodRecord::default() };
    two.provenance.methods.push(method);
    let differences = |then: &Results, now: &Results| {
        let report = compare(now, &baseline_of(then));
        report.differences.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    assert_eq!(differences(&one, &two), ["method n: was absent, is now present"]);
    assert_eq!(differences(&two, &one), ["method n: was present, is now absent"]);
}

/// Only the fields that mean something else are different.
#[test]
fn a_protocol_in_the_words_of_an_older_version_has_the_fields_of_this_one() {
    let mut then = base();
    let record = &mut then.provenance.presets[0];
    let words = "psnr = \"clipped\"\nssim = \"skimage-gaussian\"\nlpips = \"vgg-v01\"\npixels = \"float\"\n\
                 clip-before-ssim-and-lpips = false";
    for (now, older) in [
        ("psnr = \"psnr\"\nssim = \"ssim\"\nlpips = \"lpips\"", words),
        ("extent = \"three-sigma-tiles\"\nmax-sh-degree = 3", "extent-sigmas = 3.0"),
    ] {
        assert!(record.toml.contains(now), "{}", record.toml);
        record.toml = record.toml.replace(now, older);
    }
    let mut now = base();
    set_preset(&mut now, |preset| preset.renderer.dilation = 0.1);
    let report = compare(&now, &baseline_of(&then));
    let whats: Vec<String> = report.differences.iter().map(Difference::what).collect();
    assert_eq!(whats, ["hash", "renderer.dilation"].map(|field| format!("preset {PRESET}, {field}")));
}

/// Its fields are unknown; they are not all different.
#[test]
fn a_protocol_that_is_no_toml_is_the_difference() {
    let baseline = baseline_of(&base());
    let mut now = base();
    let record = &mut now.provenance.presets[0];
    (record.hash, record.toml) = ("other".to_owned(), "views = [".to_owned());
    let report = compare(&now, &baseline);
    let whats: Vec<String> = report.differences.iter().map(Difference::what).collect();
    assert_eq!(whats, ["hash", "toml"].map(|field| format!("preset {PRESET}, {field}")));
    let [finding] = &report.findings[..] else { panic!("{report}") };
    let example = "toml: was readable, is now unreadable: ";
    assert!(finding.kind == FindingKind::Protocol && finding.example.starts_with(example), "{report}");
    assert_eq!(report.data.compared, 0, "the preset may crop images differently");
    let json = serde_json::to_value(&report.differences[0]).unwrap();
    let hash = &baseline.provenance.presets[0].hash;
    assert_eq!(json, serde_json::json!({ "what": whats[0], "baseline": hash, "now": "other" }));
}

#[test]
fn the_counts_that_differ_are_named_with_both_values() {
    let mut base = store(true, 4, 0.0, 1);
    (base.trials[1].gaussians, base.trials[1].final_tokens) = (Some(23_040), Some(1440));
    let baseline = baseline_of(&base);
    let example = |gaussians: Option<u64>, final_tokens: Option<u64>| {
        let mut now = base.clone();
        (now.trials[1].gaussians, now.trials[1].final_tokens) = (gaussians, final_tokens);
        let report = compare(&now, &baseline);
        assert_eq!(kinds(&report), [(FindingKind::Count, DriftVerdict::Drifted, 1)], "{report}");
        report.findings[0].example.clone()
    };
    let tokens = "final tokens were 1440, are now 1441";
    assert_eq!(example(Some(23_040), Some(1441)), format!("scene 001 0: {tokens}"));
    assert_eq!(example(None, Some(1440)), "scene 001 0: Gaussians were 23040, are now none");
    let gaussians = "Gaussians were 23040, are now 23041";
    assert_eq!(example(Some(23_041), Some(1441)), format!("scene 001 0: {gaussians}; {tokens}"));
}

/// Scores alone do not show that a method needs more Gaussians: 23000 by 200 in one of four trials is a mean of 0.2 %.
#[test]
fn a_mean_number_of_gaussians_beyond_its_limit_is_drift_on_every_basis() {
    for (basis, more, expected) in [
        (Basis::Exact, 1, DriftVerdict::Drifted),
        (Basis::Bound, 200, DriftVerdict::Within),
        (Basis::Bound, 2000, DriftVerdict::Drifted),
        (Basis::Interval, 2000, DriftVerdict::Within),
        (Basis::Interval, 10_000, DriftVerdict::Drifted),
        (Basis::Interval, -10_000, DriftVerdict::Drifted),
    ] {
        let mut base = store(basis != Basis::Interval, 4, 0.0, 1);
        base.trials.iter_mut().for_each(|trial| trial.gaussians = Some(23_000));
        let mut now = base.clone();
        now.trials[1].gaussians = Some(23_000_u64.saturating_add_signed(more));
        if basis == Basis::Bound {
            now.provenance.processor = "another".to_owned();
        }
        let report = compare(&now, &baseline_of(&base));
        assert_eq!(kinds(&report), [(FindingKind::Count, expected, 1)], "{basis:?} by {more}: {report}");
        let says_mean = report.findings[0].example.contains("; their mean number of Gaussians was 23000, is now ");
        assert_eq!(says_mean, basis != Basis::Exact && expected == DriftVerdict::Drifted, "{report}");
    }
}

/// One of 80 scenes is 0.6 dB better: the mean moves by 0.0075 dB, and may by 0.01. If another is 0.6 dB worse, it does not move.
#[test]
fn a_history_says_that_scenes_moved_where_the_mean_is_within_limits() {
    let base = store(false, 80, 0.0, 1);
    for opposite in [0.0, -0.6] {
        let mut now = base.clone();
        for (row, at) in now.targets.iter_mut().zip(0..6) {
            let by = if at < 3 { 0.6 } else { opposite };
            row.scores.values_mut().for_each(|score| *score += by);
        }
        let baseline = baseline_of(&base);
        let found = histories(&baseline, &compare(&now, &baseline)).remove(0);
        assert_eq!(found.verdict, DriftVerdict::Drifted);
        let why = found.runs[1].why.as_deref().unwrap();
        assert!(why.starts_with("at least one scene moved"), "{why}");
        let accepted = baseline.accept(&now, &[], acceptance("a fix"));
        let found = histories(&accepted, &compare(&now, &accepted)).remove(0);
        let whys: Vec<_> = found.runs.iter().map(|run| run.why.as_deref()).collect();
        assert_eq!(whys, [Some("first"), Some("at least one scene moved: a fix"), None]);
    }
}
