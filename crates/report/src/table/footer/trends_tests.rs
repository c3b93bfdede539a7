//! The slope over budgets, in the table and in its plot.

use atsplat_results::TargetStatus;

use crate::definition::TableDefinition;
use crate::plot_data::table_plots;
use crate::sample::{SCENES, atsplat, preset, results_over};
use crate::table::test_tables::{measured, notes_as_text, table_of};
use crate::table::{NoteKind, Source};

#[test]
fn thresholds_by_quantile_say_so_and_budgets_have_a_trend() {
    let by_quantile = |published: [f64; 3], at: f64, gaussians: u64| {
        let mut method =
            atsplat(&format!("quantiles {at}"), |config| *config = config.with_thresholds(&[at; 3]).unwrap());
        method.title = format!("ATSplat at {at}");
        method.record_threshold_quantiles(&[0.8, 0.8, 0.9], &published);
        (method, gaussians)
    };
    let methods = [by_quantile([0.1, 0.1, 0.4], 0.3, 16_384), by_quantile([0.01, 0.01, 0.04], 0.2, 4_096)];
    let records = methods.iter().map(|(method, _)| method.clone()).collect();
    let mut results = results_over(vec![preset("rooms-2v-128")], records, 8);
    for trial in &mut results.trials {
        let method = methods.iter().find(|(method, _)| method.name == trial.key.method);
        trial.gaussians = method.map(|(_, gaussians)| *gaussians);
    }
    let table = table_of("dynamic_budget", &results);
    let labels: Vec<String> =
        measured(&table).filter(|row| !row.without_leaked).map(|row| row.printed_labels().concat()).collect();
    let expected = "0.1 / 0.1 / 0.4, thresholds by quantile 0.8 / 0.8 / 0.9 of its own scores: 0.3 / 0.3 / 0.3";
    assert_eq!(labels[0], expected);
    assert_eq!(labels.len(), 2);
    // The second method is 3 dB worse with a quarter of the Gaussians, in the seven scenes where it does not fail.
    let trend = notes_as_text(&table, NoteKind::Trend);
    assert!(trend.starts_with("trend: PSNR changes by +1.500 [+1.500, +1.500] per doubling"), "{trend}");
    assert!(trend.contains("over 2 settings and 7 scenes"), "{trend}");

    // The plot needs counts that differ between scenes; its rows are named like the table's.
    for (at, trial) in results.trials.iter_mut().enumerate() {
        trial.gaussians = trial.gaussians.map(|gaussians| gaussians + at as u64);
    }
    let table = table_of("dynamic_budget", &results);
    let plots = table_plots(
        &TableDefinition::named("dynamic_budget").unwrap(),
        &table,
        &[Source { label: "run", results: &results }],
    );
    let text: Vec<&str> = plots[0].1.texts().collect();
    assert!(text.join(" ").contains("thresholds by quantile 0.8 / 0.8 / 0.9 of its own"), "{text:?}");
}

/// Without its easiest target, the setting with fewer Gaussians would seem an eighth of a decibel worse in the first scene, and
/// without its hardest the other one an eighth better in the second.
#[test]
fn a_lost_target_does_not_move_a_trend() {
    let budget = |at: f64, published: [f64; 3]| {
        let mut method = atsplat(&format!("budget {at}"), |config| *config = config.with_thresholds(&[at; 3]).unwrap());
        method.title = format!("ATSplat at {at}");
        method.record_threshold_quantiles(&[0.8, 0.8, 0.9], &published);
        method
    };
    let methods = vec![budget(0.3, [0.1, 0.1, 0.4]), budget(0.2, [0.01, 0.01, 0.04])];
    let more = methods[0].name.clone();
    let mut results = results_over(vec![preset("rooms-2v-128")], methods, 8);
    for trial in &mut results.trials {
        trial.gaussians = Some(if trial.key.method == more { 16_384 } else { 4_096 });
    }
    for row in &mut results.targets {
        let has_more = row.key.method == more;
        let place = (row.key.scene.as_str(), row.target);
        if (!has_more && place == (SCENES[0], 2)) || (has_more && place == (SCENES[1], 0)) {
            row.status = TargetStatus::NonFinite;
            row.scores.clear();
        }
    }
    let trend = notes_as_text(&table_of("dynamic_budget", &results), NoteKind::Trend);
    assert!(trend.starts_with("trend: PSNR changes by +1.500 [+1.500, +1.500] per doubling"), "{trend}");
    assert!(trend.contains("over 2 settings and 7 scenes"), "{trend}");
}

/// A third budget has random weights, whose PSNR is 6 dB lower with the most Gaussians.
#[test]
fn random_weights_have_no_part_in_a_trend() {
    let budget = |at: f64, untrained: bool| {
        let mut method = atsplat(&format!("budget {at}"), |config| *config = config.with_thresholds(&[at; 3]).unwrap());
        (method.title, method.untrained) = (format!("ATSplat at {at}"), untrained);
        method
            .record_threshold_quantiles(&[0.8, 0.8, 0.9], &if untrained { [0.05, 0.05, 0.2] } else { [0.1, 0.1, 0.4] });
        method
    };
    let mut second = budget(0.2, false);
    second.record_threshold_quantiles(&[0.8, 0.8, 0.9], &[0.01, 0.01, 0.04]);
    let methods = vec![budget(0.3, false), second, budget(0.1, true)];
    let counts: Vec<(String, u64)> =
        methods.iter().map(|method| method.name.clone()).zip([16_384, 4_096, 65_536]).collect();
    let mut results = results_over(vec![preset("rooms-2v-128")], methods, 8);
    for trial in &mut results.trials {
        let count = counts.iter().find(|(name, _)| *name == trial.key.method).unwrap().1;
        trial.gaussians = Some(count);
    }
    let trend = notes_as_text(&table_of("dynamic_budget", &results), NoteKind::Trend);
    assert!(trend.starts_with("trend: PSNR changes by +1.500 [+1.500, +1.500] per doubling"), "{trend}");
    assert!(trend.contains("over 2 settings and 7 scenes, without random weights"), "{trend}");
}
