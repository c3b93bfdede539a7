//! The fields that tables group or leave out targets by.

use atsplat_results::TargetRow;

use super::*;

type Change = fn(&mut TargetRow);

#[test]
fn targets_that_tables_group_differently_are_drift() {
    let base = store(true, 4, 0.0, 1);
    let baseline = baseline_of(&base);
    let cases: [(Change, &str); 3] = [
        (|row| row.leaked = true, "leaked was false, is now true"),
        (|row| row.signed_distance = -2, "distance was 0, is now -2"),
        (|row| row.overlap = Some(0.25), "overlap was none, is now 0.25"),
    ];
    for (change, expected) in cases {
        let mut now = base.clone();
        change(&mut now.targets[4]);
        let report = compare(&now, &baseline);
        assert_eq!(kinds(&report), [(FindingKind::Grouping, DriftVerdict::Drifted, 1)], "{report}");
        assert_eq!(report.findings[0].example, format!("scene 001 0 frame 1: {expected}"));
        assert_eq!(
            (report.verdict, report.comparisons[0].verdict),
            (DriftVerdict::Drifted, DriftVerdict::Same),
            "{report}"
        );
        let back = compare(&base, &baseline_of(&now));
        assert_eq!(kinds(&back), [(FindingKind::Grouping, DriftVerdict::Drifted, 1)], "the other way round: {back}");
    }
}

#[test]
fn a_baseline_that_does_not_know_them_compares_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.json");
    let mut base = store(true, 4, 0.0, 1);
    baseline_of(&base).write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let grouping = ",\"grouping\":{\"leaked\":false,\"signed_distance\":0,\"overlap\":null}";
    assert_eq!(text.matches(grouping).count(), 12, "{text}");
    std::fs::write(&path, text.replace(grouping, "")).unwrap();
    let old = Baseline::read(&path).unwrap();
    assert!(old.targets.iter().all(|row| row.grouping.is_none()));
    (base.targets[4].leaked, base.targets[5].overlap) = (true, Some(0.25));
    let report = compare(&base, &old);
    assert_eq!((report.verdict, report.findings.len()), (DriftVerdict::Same, 0), "{report}");
}
