//! Changed images are reported by scene and frame.

use super::*;
use crate::probe::{Attribution, StageChange, StageVerdict};

fn roles(image: &ChangedImage) -> Vec<&'static str> {
    image.roles.iter().copied().map(ImageRole::name).collect()
}

#[test]
fn a_changed_context_image_is_named_by_scene_and_frame() {
    let base = store(true, 6, 0.0, 1);
    let baseline = baseline_of(&base);
    // Per scene: context frames 0 and 9, targets 0, 1 and 2; frame 0 has both roles.
    assert_eq!(compare(&base, &baseline).data, DataComparison { compared: 6 * 4, ..DataComparison::default() });
    let mut now = base.clone();
    now.trials[3].context_hashes[1] = "blurred".to_owned();
    now.targets[3 * 3 + 2].truth_hash = Some("sharpened".to_owned());
    let report = compare(&now, &baseline);
    let changed: Vec<_> = report.data.changed.iter().map(|p| (p.scene.as_str(), p.frame, roles(p))).collect();
    assert_eq!(changed, [("scene 003", 2, vec!["target"]), ("scene 003", 9, vec!["context"])]);
    assert_eq!(kinds(&report), [(FindingKind::Data, DriftVerdict::Drifted, 2)]);
    assert_eq!((report.verdict, report.first_change()), (DriftVerdict::Drifted, Some(Cause::Data)), "{report}");
    let text = report.to_string();
    for part in [
        "images have changed: 2, such as scene scene 003, frame 2 (target)",
        "sampled: scene scene 003, frame 9 (context)",
        "The first change is in the data: sampled, scene scene 003, frame 2 (target), and 1 more.",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn an_image_of_two_roles_and_several_methods_is_one_image() {
    let mut base = store(true, 2, 0.0, 1);
    let other = base.clone();
    add_rows(&mut base, other, "n");
    let baseline = baseline_of(&base);
    assert_eq!(baseline.images.len(), 2 * 4);
    let mut now = base.clone();
    for row in now.trials.iter_mut().filter(|row| row.key.scene == "scene 001") {
        row.context_hashes[0] = "other".to_owned();
    }
    for row in now.targets.iter_mut().filter(|row| row.key.scene == "scene 001" && row.frame == 0) {
        row.truth_hash = Some("other".to_owned());
    }
    let [image] = &compare(&now, &baseline).data.changed[..] else { panic!("one image") };
    assert_eq!((image.frame, roles(image)), (0, vec!["context", "target"]));
    // Methods run before and after the change in one store still count as a change.
    let mut mixed = base.clone();
    mixed.trials[1].context_hashes[1] = "other".to_owned();
    assert_eq!(compare(&mixed, &baseline).data.changed.len(), 1);
}

#[test]
fn scenes_missing_on_one_side_are_not_changed_data() {
    let all = store(true, 6, 0.0, 1);
    let mut fewer = all.clone();
    fewer.trials.truncate(4);
    fewer.targets.truncate(4 * 3);
    for (then, now) in [(&all, &fewer), (&fewer, &all)] {
        let found = compare(now, &baseline_of(then)).data;
        assert_eq!(found, DataComparison { compared: 4 * 4, ..DataComparison::default() });
    }
}

/// Rows without digests of context images, on either side.
#[test]
fn images_without_a_digest_are_counted_as_unknown() {
    let base = store(true, 3, 0.0, 1);
    let mut old = base.clone();
    old.trials.iter_mut().for_each(|row| row.context_hashes.clear());
    for (then, now) in [(&base, &old), (&old, &base)] {
        let report = compare(now, &baseline_of(then));
        assert_eq!(
            report.data,
            DataComparison { compared: 3 * 3, unknown: 3, ..DataComparison::default() },
            "frame 9 of each"
        );
        assert!(report.to_string().contains("3 images have a digest on one side only"), "{report}");
    }
    let mut unknown = old.clone();
    unknown.targets.iter_mut().for_each(|row| row.truth_hash = None);
    let report = compare(&unknown, &baseline_of(&unknown));
    assert_eq!((report.data.verdict(), report.first_change()), (StageVerdict::Empty, None));
    assert!(report.to_string().contains("No image of the dataset could be compared; no probe was run."), "{report}");
}

#[test]
fn an_older_format_without_images_has_those_of_its_targets() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.json");
    let base = store(true, 3, 0.0, 1);
    baseline_of(&base).write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap().replace("\"format\": 3", "\"format\": 2");
    let (head, rest) = text.split_once("  \"images\": [").unwrap();
    let (_, tail) = rest.split_once("],\n").unwrap();
    std::fs::write(&path, format!("{head}{tail}")).unwrap();
    let old = Baseline::read(&path).unwrap();
    assert_eq!(old.images.len(), 3 * 3);
    let mut now = base.clone();
    now.targets[4].truth_hash = Some("other".to_owned());
    let data = compare(&now, &old).data;
    assert_eq!((data.compared, data.changed.len(), data.unknown), (9, 1, 3));
    assert_eq!((data.changed[0].scene.as_str(), data.changed[0].frame), ("scene 001", 1));
}

/// A probe of which these stages changed.
pub(super) fn probed(changed: &[Stage]) -> Attribution {
    let stages = Stage::PROBED.into_iter().map(|stage| StageChange {
        stage,
        verdict: if changed.contains(&stage) { StageVerdict::Changed } else { StageVerdict::Same },
        differing: 0,
        values: 1,
        values_now: 1,
        largest: 0.0,
    });
    Attribution { stages: stages.collect(), metrics: Vec::new() }
}

/// Images are compared after decoding and resizing, so a change of those stages may explain changed images; later stages
/// cannot.
#[test]
fn changed_images_are_attributed_to_data_unless_decoding_or_resizing_changed() {
    let base = store(true, 3, 0.0, 1);
    let baseline = baseline_of(&base);
    let mut now = base.clone();
    now.trials[0].context_hashes[1] = "other".to_owned();
    let first = |now: &Results, changed: &[Stage]| {
        let report = compare(now, &baseline).with_attribution(probed(changed));
        assert_eq!(report.verdict == DriftVerdict::Same, changed.is_empty() && report.data.changed.is_empty());
        report.first_change()
    };
    for (changed, expected) in [
        (&[][..], Cause::Data),
        (&[Stage::Decode], Cause::Decode),
        (&[Stage::Resize, Stage::Metric], Cause::Resize),
        (&[Stage::Model], Cause::Data),
        (&[Stage::Renderer, Stage::Metric], Cause::Data),
    ] {
        assert_eq!(first(&now, changed), Some(expected), "{changed:?}");
    }
    assert_eq!((first(&base, &[]), first(&base, &[Stage::Metric])), (None, Some(Cause::Metric)));
}

#[test]
fn a_stage_without_values_is_not_the_same() {
    let base = store(true, 3, 0.0, 1);
    let mut attribution = probed(&[]);
    attribution.stages[4].verdict = StageVerdict::Empty;
    let baseline = baseline_of(&base);
    let report = compare(&base, &baseline).with_attribution(attribution);
    assert_eq!((report.verdict, report.first_change()), (DriftVerdict::Nothing, None));
    assert!(report.to_string().contains("the probe had nothing to compare for: metric."), "{report}");
}
