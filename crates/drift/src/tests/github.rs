//! What GitHub Actions shows of a report.

use super::*;

#[test]
fn a_summary_lists_what_is_not_the_same() {
    let baseline = Baseline::new(&moved(0.0), &[], acceptance("first"));
    let mut now = moved(0.0);
    now.targets[30].scores.values_mut().for_each(|score| *score -= 1.5);
    let text = compare(&now, &baseline).markdown();
    assert!(text.starts_with("### Drift: DRIFTED\n\n") && text.ends_with('\n'), "{text}");
    let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("| sampled")).collect();
    let [row] = &rows[..] else { panic!("{text}") };
    // 1.5 dB of one of 36 targets, in one of 12 scenes.
    assert!(row.starts_with("| sampled | m | psnr | ") && row.contains(" | -0.042 dB | "), "{row}");
    assert!(row.ends_with(" | DRIFTED, worse |"), "{row}");
    let calm = compare(&moved(0.0), &baseline).markdown();
    assert!(!calm.contains('|') && calm.contains("\nNumbers that are the same: 1.\n"), "{calm}");
}

#[test]
fn an_annotation_names_the_file_and_what_moved_in_one_line() {
    let mut then = moved(0.0);
    then.targets[4].truth_hash = Some("100 %".to_owned());
    let baseline = Baseline::new(&then, &[], acceptance("first"));
    assert_eq!(compare(&then, &baseline).annotation("b.json"), None);
    let mut now = moved(-0.25);
    now.targets[4].overlap = Some(0.5);
    let text = compare(&now, &baseline).annotation("ci/a,b:50%.json").unwrap();
    let head =
        "::error file=ci/a%2Cb%3A50%25.json,title=Numbers or their data drifted::The first change is in the data: ";
    assert!(text.starts_with(head) && !text.contains('\n'), "{text}");
    for part in ["%0Apsnr of m under sampled: was ", " (-0.250 dB)", "%0Asampled, m: targets have another mark"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let nothing = compare(&Results::default(), &baseline).annotation("b.json").unwrap();
    assert!(
        nothing.starts_with("::error file=b.json,title=Nothing was compared::Nothing could be compared"),
        "{nothing}"
    );
}
