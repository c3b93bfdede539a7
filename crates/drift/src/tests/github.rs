//! What GitHub Actions shows of a report.

use super::*;

#[test]
fn a_summary_lists_what_is_not_the_same() {
    let baseline = baseline_of(&moved(0.0));
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
    let baseline = baseline_of(&then);
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

#[test]
fn names_are_no_markup_in_a_summary() {
    let renamed = |status: TargetStatus| {
        let mut results = store(true, 2, 0.0, 1);
        for key in keys(&mut results) {
            key.scene = key.scene.replace("scene 000", "<b>a*b|c\nd");
        }
        results.targets[0].status = status;
        results
    };
    let baseline = baseline_of(&renamed(TargetStatus::Scored));
    let text = compare(&renamed(TargetStatus::Failed), &baseline).markdown();
    let item =
        "- DRIFTED: sampled, m: targets have another status: 1, such as &lt;b&gt;a\\*b\\|c d 0 frame 0: was scored";
    assert!(text.lines().any(|line| line.starts_with(item)), "{text}");
}

/// Eleven methods, each with other trials and a lower score.
#[test]
fn an_annotation_lists_ten_numbers_and_ten_changes() {
    let mut then = Results::default();
    for at in 0..11 {
        let run = store(true, 1, 0.0, 1);
        then.provenance = run.provenance.clone();
        add_rows(&mut then, run, &format!("m{at:02}"));
    }
    let baseline = baseline_of(&then);
    let mut now = then.clone();
    for trial in &mut now.trials {
        trial.trial_hash = "another".to_owned();
    }
    for score in now.targets.iter_mut().flat_map(|row| row.scores.values_mut()) {
        *score -= 1.0;
    }
    let text = compare(&now, &baseline).annotation("b.json").unwrap();
    assert!(text.contains("psnr of m09") && !text.contains("psnr of m10"), "{text}");
    assert!(text.contains("%0Aand 1 more number%0A") && text.ends_with("%0Aand 1 more change"), "{text}");
}
