//! Numbers that no method can have.

use super::*;

type Change = fn(&mut TrialRow, &mut Vec<TargetRow>);

/// What is changed, the file, and what its error says.
const CASES: [(Change, &str, &str); 6] = [
    (
        |_, rows| _ = rows[0].scores.insert("ssim".to_owned(), 5.0),
        TARGETS,
        "column ssim, row 0: expected -1 to 1, found 5",
    ),
    (
        |_, rows| _ = rows[0].scores.insert("l1".to_owned(), -0.5),
        TARGETS,
        "column l1, row 0: expected 0 to 1, found -0.5",
    ),
    (|_, rows| rows[1].overlap = Some(2.0), TARGETS, "column overlap, row 1: expected 0 to 1, found 2"),
    (
        |_, rows| _ = rows[1].scores.insert("psnr".to_owned(), 20.5),
        TARGETS,
        "column psnr, row 1: expected no score of a target whose status is failed, found 20.5",
    ),
    (|trial, _| trial.overlap = Some(-0.25), TRIALS, "column overlap, row 0: expected 0 to 1, found -0.25"),
    (
        |trial, _| trial.gaussians_drawn = Some(-1.0),
        TRIALS,
        "column gaussians-drawn, row 0: expected at least 0, found -1",
    ),
];

#[test]
fn impossible_numbers_in_tables_are_rejected_by_file_column_and_row() {
    for (change, file, expected) in CASES {
        let folder = tempfile::tempdir().unwrap();
        filled(folder.path(), &["a"]).finish().unwrap();
        let (mut changed, mut rows) = (trial("a"), targets("a"));
        change(&mut changed, &mut rows);
        put_table(folder.path(), TARGETS, targets::columns(&rows).frame());
        put_table(folder.path(), TRIALS, trials::columns(&[changed]).frame());
        let error = Results::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains(file), "{expected}: {error}");
    }
}

#[test]
fn impossible_numbers_are_neither_written_to_parts_nor_read_from_them() {
    for (change, _, expected) in CASES {
        let folder = tempfile::tempdir().unwrap();
        let store = filled(folder.path(), &["b"]);
        let (mut changed, mut rows) = (trial("a"), targets("a"));
        change(&mut changed, &mut rows);
        let (column, why) = expected.trim_start_matches("column ").split_once(", row ").unwrap();
        let (_, why) = why.split_once(": ").unwrap();
        let rejected = store.append(&changed, &rows).unwrap_err().to_string();
        assert!(rejected.ends_with(&format!("entry 0: {column}: {why}")), "{rejected}");
        assert_eq!(Results::read(folder.path()).unwrap().trials.len(), 1, "nothing was written");
        parts::write(folder.path(), &changed, &rows).unwrap();
        let error = Results::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains(&format!("field {column} of t")) && error.contains(why), "{error}");
    }
}

/// Rounding, and numbers that are not finite, which are counted as broken renders.
#[test]
fn numbers_at_the_border_and_broken_ones_are_read() {
    let folder = tempfile::tempdir().unwrap();
    filled(folder.path(), &["a"]).finish().unwrap();
    let mut rows = targets("a");
    rows[0].scores = [("ssim".to_owned(), 1.0 + 1e-9), ("psnr".to_owned(), f64::INFINITY)].into();
    rows[0].scores.insert("psnr-unclipped".to_owned(), -12.5);
    put_table(folder.path(), TARGETS, targets::columns(&rows).frame());
    assert_eq!(Results::read(folder.path()).unwrap().targets, rows);
    let mut custom = targets("a");
    custom[0].scores = [("a-metric-of-another-toolkit".to_owned(), -7.0)].into();
    custom[0].check().unwrap();
}
