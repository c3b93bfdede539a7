//! What a table says of scenes and targets, and of suspicious trials.

use atsplat_results::{Results, TargetRow, TargetStatus, TrialRow, TrialStatus};

use crate::emit::TableFormat;
use crate::sample::{atsplat, nearest_view, preset, results, results_over, store};
use crate::table::test_tables::{measured, notes, notes_as_text, row_of, table_of, table_of_stores};
use crate::table::{CellIndex, NoteKind};

/// Two of the network's four trials show nothing, one had broken Gaussians, and one was rendered in the classic mode because none was
/// chosen; a trial of the other protocol does not count.
#[test]
fn trials_without_a_rendered_gaussian_or_with_broken_ones_have_a_line() {
    let lines = |store: &Results| -> Vec<String> {
        let table = table_of("re10k", store);
        let suspicious = |text: &&str| ["rendered", "drawn", "broken"].into_iter().any(|word| text.contains(word));
        notes(&table, NoteKind::Counts).into_iter().filter(suspicious).map(str::to_owned).collect()
    };
    let mut store = store();
    assert_eq!(lines(&store), [""; 0]);
    for (preset, rendered) in [("re10k-2v-256", [0.0, 7.5, 0.0, 0.25]), ("re10k-overlap", [0.0; 4])] {
        let trials = store.trials.iter_mut().filter(|trial| trial.key.is_of(preset, "atsplat"));
        for (trial, rendered) in trials.zip(rendered) {
            trial.gaussians_drawn = Some(rendered);
        }
    }
    let undrawn = "ATSplat: no Gaussian is rendered in 2 of 4 trials, whose images show the background";
    assert_eq!(lines(&store), [format!("{undrawn}; not left out of the mean")]);
    let is_of_network = |trial: &&mut TrialRow| trial.key.is_of("re10k-2v-256", "atsplat");
    let trial = store.trials.iter_mut().find(is_of_network).unwrap();
    trial.notes.push("broken Gaussians: 3 of 9 (2 with NaN not drawn, 1 repaired)".to_owned());
    let broken = "broken Gaussians were repaired or not drawn in 1 of 4 trials";
    assert_eq!(lines(&store), [format!("{undrawn}; {broken}; not left out of the mean")]);
    let trial = store.trials.iter_mut().rfind(is_of_network).unwrap();
    trial.notes.push("drawn in the classic mode: the Gaussians have 3D filters".to_owned());
    let classic =
        "Gaussians of antialiased training or with 3D filters were drawn in the classic mode in 1 of 4 trials";
    assert_eq!(lines(&store), [format!("{undrawn}; {broken}; {classic}; not left out of the mean")]);
}

#[test]
fn identical_targets_are_left_out_and_counted() {
    let mut results = results_over(vec![preset("rooms-2v-128")], vec![nearest_view()], 7);
    let before = table_of("re10k", &results);
    let mut copy = results.targets[0].clone();
    (copy.target, copy.status, copy.scores) = (9, TargetStatus::Identical, [("ssim".to_owned(), 1.0)].into());
    results.targets.push(copy);
    let after = table_of("re10k", &results);
    let [before, with] = [&before, &after].map(|table| measured(table).next().unwrap().cells[0][..2].to_vec());
    for (one, other) in before.iter().zip(&with) {
        assert_eq!((&one.value, one.interval), (&other.value, other.interval), "100 dB and SSIM 1 move no mean");
    }
    assert_eq!(with[0].counts.unwrap().identical, 1);
    assert!(notes_as_text(&after, NoteKind::Counts).contains("21 targets, 1 more identical to the truth and left out"));
    assert!(notes_as_text(&after, NoteKind::LeftOut).contains("left out of all means"));
    assert!(TableFormat::Latex.write(&after).unwrap().contains("{\\footnotesize"), "printed below the table");
}

#[test]
fn targets_that_a_method_does_not_support_have_not_failed() {
    let mut results = results_over(vec![preset("rooms-2v-128")], vec![nearest_view(), atsplat("atsplat", |_| ())], 7);
    let broken = results.trials.iter_mut().find(|trial| trial.status == TrialStatus::Failed).unwrap();
    broken.status = TrialStatus::NotApplicable;
    let table = table_of("re10k", &results);
    let row = measured(&table).find(|row| row.cells[0][0].counts.is_some_and(|counts| counts.targets == 18)).unwrap();
    let counts = row.cells[0][0].counts.unwrap();
    assert_eq!((counts.failed, counts.not_applicable), (0, 3));
    assert!(!row.cells[0][0].is_rankable(), "its mean lacks targets all the same");
    assert!(row.measured_on.as_ref().unwrap().text.contains("3 of 21 targets not applicable"), "{:?}", row.measured_on);
    let said = notes_as_text(&table, NoteKind::Counts);
    assert!(said.contains("3 not applicable and not in the mean") && !said.contains("failed"), "{said}");
}

/// The overlaps of the third scene are too large, and one of the fourth is unknown, in the rows of one method. Renders that are not
/// finite or identical to the truth are in no mean.
#[test]
fn targets_outside_all_bins_are_counted() {
    let mut results = results(vec![preset("re10k-overlap")], vec![atsplat("a", |_| ()), nearest_view()]);
    let mut rows = results.targets.iter_mut().filter(|row| row.key.method == "a").collect::<Vec<&mut TargetRow>>();
    rows[6..9].iter_mut().for_each(|row| row.overlap = Some(0.9));
    rows[11].overlap = None;
    let table = table_of_stores("re10k_overlap", &[&results]);
    let said = notes(&table, NoteKind::Counts);
    let outside: Vec<&&str> = said.iter().filter(|text| text.contains("outside all bins")).collect();
    assert_eq!(outside.len(), 2, "with and without leaked targets: {said:?}");
    let expected = "ATSplat: Small: 2 scenes, 6 targets; Medium: 0 scenes, 0 targets; Large: 1 scene, 2 targets; \
                    Average: 3 scenes, 8 targets; 4 targets outside all bins of overlap: in the mean over all \
                    targets, not in Average";
    assert_eq!(*outside[0], expected);
    let outside = |results: &Results| {
        let table = table_of_stores("re10k_overlap", &[results]);
        row_of(&table, "a").cell(CellIndex { group: 3, column: 0 }).counts.unwrap().outside_bins
    };
    assert_eq!(outside(&results), 4);
    let mut rows = results.targets.iter_mut().filter(|row| row.key.method == "a").collect::<Vec<&mut TargetRow>>();
    for (at, status) in [(6, TargetStatus::NonFinite), (8, TargetStatus::Identical), (11, TargetStatus::NonFinite)] {
        rows[at].status = status;
        rows[at].scores.clear();
    }
    assert_eq!(outside(&results), 1, "not more than are in the mean over all targets");
}

/// A network at another resolution has other tokens and Gaussians: the table says at which, in words of older stores too.
#[test]
fn a_network_that_saw_resized_images_says_so() {
    let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), nearest_view()]);
    let resized = |results: &Results| {
        let table = table_of("re10k", results);
        notes_as_text(&table, NoteKind::Setting)
            .lines()
            .filter(|line| line.contains("saw"))
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    assert!(resized(&results).is_empty());
    for (trial, note) in results.trials.iter_mut().zip([
        "the network saw context images of 112x112 at 128x128",
        "the network saw context pictures of 112x112 at 128x128",
        "the network saw context images of 64x112 at 128x224",
    ]) {
        trial.notes.push(note.to_owned());
    }
    let expected = "ATSplat: the network saw 112x112 at 128x128 in 2 of 4 trials, 64x112 at 128x224 in 1 of 4 trials";
    assert_eq!(resized(&results), [expected]);
}
