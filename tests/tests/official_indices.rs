//! The figures of every official evaluation index, on the real files.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::PathBuf;

use atsplat_protocol::extrapolation::Extrapolation;
use atsplat_protocol::{
    IndexFile, IndexLayout, IndexMatch, IndexNotices, KNOWN_INDICES, KnownIndex, LintOptions, LintReport, Preset,
    TableSharing, compare, lint_file,
};
use atsplat_scene::Warnings;
use atsplat_tests::shared_data;

const FILES: [(&str, &str); 12] = [
    ("pixelsplat-re10k", "pixelsplat/evaluation_index_re10k.json"),
    ("pixelsplat-acid", "pixelsplat/evaluation_index_acid.json"),
    ("noposplat-re10k", "noposplat/evaluation_index_re10k.json"),
    ("noposplat-acid", "noposplat/evaluation_index_acid.json"),
    ("depthsplat-dl3dv-2v", "depthsplat/dl3dv_start_0_distance_50_ctx_2v_video_0_50.json"),
    ("depthsplat-dl3dv-4v", "depthsplat/dl3dv_start_0_distance_50_ctx_4v_video_0_50.json"),
    ("depthsplat-dl3dv-6v", "depthsplat/dl3dv_start_0_distance_50_ctx_6v_video_0_50.json"),
    ("depthsplat-dl3dv-12v", "depthsplat/dl3dv_start_0_distance_100_ctx_12v_video.json"),
    ("depthsplat-dl3dv-2v-10", "depthsplat/dl3dv_start_0_distance_10_ctx_2v_tgt_4v.json"),
    ("yonosplat-dl3dv-6v", "yonosplat/dl3dv_start_0_distance_50_ctx_6v_tgt_8v.json"),
    ("yonosplat-dl3dv-12v", "yonosplat/dl3dv_start_0_distance_100_ctx_12v_tgt_8v.json"),
    ("latentsplat-re10k-extra", "latentsplat/re10k_extra.json"),
];

/// Those whose files are not among the shared data: their hashes were taken from the published files.
const NOT_AT_HAND: [&str; 10] = [
    "latentsplat-re10k-intra",
    "mvsplat360-dl3dv-5v",
    "mvsplat360-dl3dv-5v-n150",
    "zpressor-dl3dv-12v",
    "zpressor-dl3dv-16v",
    "zpressor-dl3dv-24v",
    "zpressor-dl3dv-36v",
    "volsplat-re10k-6v",
    "volsplat-acid-6v",
    "spfsplatv2-dl3dv-2v",
];

struct Official(PathBuf);

impl Official {
    fn of(test: &str) -> Option<Self> {
        Some(Self(shared_data(test)?.join("index")))
    }

    fn path(&self, name: &str) -> PathBuf {
        let (_, path) = FILES.iter().find(|(known, _)| *known == name).unwrap();
        self.0.join(path)
    }

    fn file(&self, name: &str) -> IndexFile {
        IndexFile::read(&self.path(name)).unwrap()
    }

    fn lint(&self, name: &str) -> LintReport {
        lint_file(&self.file(name), &LintOptions::default(), &mut Warnings::new())
    }
}

#[test]
fn every_official_file_is_recognised_and_written_back_byte_for_byte() {
    let Some(official) = Official::of("every_official_file_is_recognised") else { return };
    assert_eq!(FILES.len() + NOT_AT_HAND.len(), KNOWN_INDICES.len());
    for known in KNOWN_INDICES.iter().filter(|known| !NOT_AT_HAND.contains(&known.name)) {
        let bytes = std::fs::read(official.path(known.name)).unwrap();
        let file = IndexFile::parse(&bytes).unwrap();
        assert_eq!(file.sha256, known.sha256, "{}", known.name);
        assert_eq!(file.index.content_hash(), known.content, "{}", known.name);
        assert_eq!(file.recognised(), Some(known));
        assert!(file.index.to_json(&file.layout).as_bytes() == bytes, "{} is written back", known.name);
        assert_eq!(file.notices, IndexNotices::default(), "{}", known.name);
    }
}

#[test]
fn a_copy_in_another_layout_is_recognised_by_its_content() {
    let Some(official) = Official::of("a_copy_in_another_layout") else { return };
    let layout = official.file("noposplat-re10k").layout;
    let file = official.file("pixelsplat-re10k");
    let copy = IndexFile::parse(file.index.to_json(&layout).as_bytes()).unwrap();
    assert_ne!(copy.sha256, file.sha256);
    assert_eq!(copy.recognised(), KnownIndex::by_name("pixelsplat-re10k"));
    let report = lint_file(&copy, &LintOptions::default(), &mut Warnings::new());
    assert!(report.to_string().contains("same content in other bytes"), "{report}");
}

#[test]
fn pixelsplat_re10k_and_acid() {
    let Some(official) = Official::of("pixelsplat_re10k_and_acid") else { return };
    let report = official.lint("pixelsplat-re10k");
    assert_eq!((report.keys, report.null, report.scenes, report.targets), (7194, 720, 6474, 19422));
    assert_eq!((report.leaked.targets, report.leaked.scenes), (583, 575));
    assert_eq!(report.outside_window.targets, 0);
    let gap = report.context_gap.unwrap();
    assert_eq!((gap.min, format!("{:.1}", gap.median), gap.max), (45, "58.0".to_owned(), 136));
    assert!(report.overlap.is_none());
    let report = official.lint("pixelsplat-acid");
    assert_eq!((report.keys, report.null, report.scenes, report.targets), (1848, 253, 1595, 4785));
    assert_eq!((report.leaked.targets, report.leaked.scenes), (135, 132));
}

#[test]
fn noposplat_bins_by_both_rules() {
    let Some(official) = Official::of("noposplat_bins_by_both_rules") else { return };
    let report = official.lint("noposplat-re10k");
    assert_eq!((report.keys, report.scenes, report.targets, report.leaked.targets), (7194, 5601, 16803, 447));
    let overlap = report.overlap.unwrap();
    assert_eq!((overlap.min.to_string(), overlap.max.to_string()), ("0.04031".to_owned(), "0.79976".to_owned()));
    assert_eq!(overlap.published.to_string(), "small 1403, medium 2568, large 1630");
    assert_eq!(overlap.strict.to_string(), "small 1403, medium 2565, large 1630, below range 3");
    let gap = report.context_gap.unwrap();
    assert_eq!((gap.min, format!("{:.1}", gap.median), gap.max), (50, "83.0".to_owned(), 276));
    let overlap = official.lint("noposplat-acid").overlap.unwrap();
    assert_eq!(overlap.published.to_string(), "small 249, medium 644, large 448");
    assert_eq!(overlap.strict.to_string(), "small 249, medium 640, large 448, below range 4");
}

#[test]
fn depthsplat_counts_its_context_frames_among_the_targets() {
    let Some(official) = Official::of("depthsplat_counts_its_context_frames") else { return };
    let expected = [("2v", 280, (172, 36), 107), ("4v", 560, (147, 34), 109), ("6v", 840, (147, 34), 109)];
    for (views, leaked, outside, at_zero) in expected {
        let report = official.lint(&format!("depthsplat-dl3dv-{views}"));
        assert_eq!((report.scenes, report.null, report.targets), (140, 0, 7000), "{views}");
        assert_eq!((report.leaked.targets, report.leaked.scenes), (leaked, 140), "{views}");
        assert_eq!((report.outside_window.targets, report.outside_window.scenes), outside, "{views}");
        assert_eq!(report.windows_at_zero, at_zero, "{views}");
    }
    let report = official.lint("depthsplat-dl3dv-12v");
    let targets = report.targets_per_scene.unwrap();
    assert_eq!((report.targets, targets.min, targets.max), (13734, 87, 100));
    assert_eq!((report.leaked.targets, report.outside_window.targets), (1680, 0));
}

#[test]
fn yonosplat_and_latentsplat() {
    let Some(official) = Official::of("yonosplat_and_latentsplat") else { return };
    let six = official.lint("yonosplat-dl3dv-6v");
    assert_eq!((six.targets, six.leaked.targets, six.outside_window.targets), (1120, 0, 40));
    let twelve = official.lint("yonosplat-dl3dv-12v");
    assert_eq!((twelve.targets, twelve.leaked.targets, twelve.leaked.scenes), (1120, 137, 87));
    let extra = official.lint("latentsplat-re10k-extra");
    assert_eq!((extra.keys, extra.null, extra.scenes, extra.targets), (7194, 770, 6424, 19272));
    assert_eq!((extra.outside_window.targets, extra.outside_window.scenes, extra.leaked.targets), (19272, 6424, 0));
}

#[test]
fn which_indices_may_share_a_table() {
    let Some(official) = Official::of("which_indices_may_share_a_table") else { return };
    let index = |name| official.file(name).index;
    let (pixelsplat, noposplat) = (index("pixelsplat-re10k"), index("noposplat-re10k"));
    let found = compare(&pixelsplat, &noposplat);
    assert_eq!(
        (found.common_keys, found.identical_scenes, found.table_sharing),
        (7194, 0, TableSharing::Different),
        "{found}"
    );
    assert_eq!(compare(&pixelsplat, &pixelsplat).table_sharing, TableSharing::Same);
    let found = compare(&index("depthsplat-dl3dv-6v"), &index("yonosplat-dl3dv-6v"));
    assert_eq!(
        (found.same_context, found.same_targets, found.table_sharing),
        (140, 0, TableSharing::Different),
        "{found}"
    );
    let mut half = pixelsplat.clone();
    half.scenes.truncate(3000);
    assert_eq!(compare(&pixelsplat, &half).table_sharing, TableSharing::OnCommonScenes);
}

/// Presets on files that others published, not on ones that are carried.
fn published() -> impl Iterator<Item = Preset> {
    let presets = Preset::names().map(|name| Preset::named(name).unwrap());
    let is_published = |name: &str| IndexFile::embedded(name).is_none();
    presets.filter(move |preset| preset.index.accepted.first().is_some_and(|accepted| is_published(&accepted.name)))
}

/// What each preset states about its default index is what the file says.
#[test]
fn presets_describe_the_files_that_they_accept() {
    let Some(official) = Official::of("presets_describe_the_files") else { return };
    for preset in published() {
        let name = &*preset.name;
        let (default, alternatives) = preset.index.accepted.split_first().unwrap();
        let mut file = official.file(&default.name);
        let name_of_default = &*default.name;
        let mut report = lint_file(&file, &LintOptions::default(), &mut Warnings::new());
        let mut expected = IndexMatch::Default { name: name_of_default };
        if let Some(derivation) = preset.index.derivation {
            let underived = IndexMatch::Underived { name: name_of_default };
            assert_eq!(preset.index.recognise(&file), underived, "{name}");
            let lengths = file.index.scenes.keys().map(|key| (key.clone(), 300)).collect();
            let split = Extrapolation::from(derivation).split(&file.index, &lengths).index;
            file = IndexFile::parse(split.to_json(&IndexLayout::PIXELSPLAT).as_bytes()).unwrap();
            report = lint_file(&file, &LintOptions::default(), &mut Warnings::new());
            expected = IndexMatch::Derived { name: name_of_default };
        }
        assert_eq!(preset.index.recognise(&file), expected, "{name}");
        assert_eq!(report.scenes, preset.index.scenes, "{name}");
        let views = report.context_per_entry.unwrap();
        assert_eq!((views.min, views.max), (preset.index.context_views as u64, views.min), "{name}");
        let targets = report.targets_per_scene.unwrap();
        let (fewest, most) = preset.index.targets;
        assert_eq!((targets.min, targets.max), (fewest as u64, most as u64), "{name}");
        assert_eq!(
            (preset.misplaced_targets(&file.index), preset.unusual_target_counts(&file.index)),
            (vec![], None),
            "{name}"
        );
        for alternative in alternatives {
            let file = official.file(&alternative.name);
            assert!(matches!(preset.index.recognise(&file), IndexMatch::Alternative { .. }), "{name}");
        }
    }
}

/// A split that lost a scene, or was made from other context frames, says so.
#[test]
fn a_split_of_part_of_the_index_is_told_from_the_whole() {
    let Some(official) = Official::of("a_split_of_part_of_the_index") else { return };
    let preset = Preset::named("dl3dv-6v-extrapolation").unwrap();
    let derivation = preset.index.derivation.unwrap();
    let mut index = official.file("depthsplat-dl3dv-6v").index;
    index.scenes.values_mut().next_back().unwrap().clear();
    let lengths = index.scenes.keys().map(|key| (key.clone(), 300)).collect();
    let split = Extrapolation::from(derivation).split(&index, &lengths);
    assert_eq!(split.targets_by_distance.to_string(), "-10 to -1: 139 each, 1 to 10: 139 each");
    let file = IndexFile::parse(split.index.to_json(&IndexLayout::PIXELSPLAT).as_bytes()).unwrap();
    let name = "depthsplat-dl3dv-6v";
    assert_eq!(preset.index.recognise(&file), IndexMatch::DerivedFromOther { name });
}

/// Prose cannot drift from the files: the counts that notes quote are the counted ones.
#[test]
fn notes_quote_the_figures_of_the_files() {
    let Some(official) = Official::of("notes_quote_the_figures") else { return };
    for preset in published() {
        let name = &*preset.name;
        if preset.index.derivation.is_some() {
            continue;
        }
        let report = official.lint(&preset.index.accepted[0].name);
        let notes = preset.notes.join("\n");
        let (leaked, outside) = (report.leaked.targets, report.outside_window);
        assert!(leaked == 0 || notes.contains(&leaked.to_string()), "{name} quotes {leaked} leaked targets");
        let quote = format!("{} targets in {} scenes", outside.targets, outside.scenes);
        let all_or_none = outside.targets == 0 || outside.targets == report.targets;
        assert!(all_or_none || notes.contains(&quote), "{name} quotes {quote}");
    }
}

/// No prefix of a real file is an index.
#[test]
fn truncated_files_are_errors() {
    let Some(official) = Official::of("truncated_files_are_errors") else { return };
    let bytes = std::fs::read(official.path("depthsplat-dl3dv-2v-10")).unwrap();
    for length in (0..bytes.len()).step_by(97) {
        assert!(IndexFile::parse(&bytes[..length]).is_err(), "{length} bytes");
    }
}
