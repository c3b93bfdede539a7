//! What a table says where it is pasted: data, sizes, scenes, agreement with the paper, orders, trends.

use atsplat_numeric::Tolerance;
use atsplat_results::{MethodRecord, Results, SkippedEntry, TargetStatus, TrainingRecord, TrialStatus};
use serde_json::json;

use super::*;
use crate::csv_text;
use crate::definition::TableDefinition;
use crate::emit::{TableFormat, Terminal, orders_as_markdown};
use crate::plot_data::table_plots;
use crate::sample::{atsplat, floor, preset, random, results, results_over, store};

pub(super) fn built(name: &str, results: &Results) -> Table {
    let source = Source { label: "run", results };
    tables(&TableDefinition::named(name).unwrap(), &[source], Mixing::Apart).unwrap().swap_remove(0)
}

pub(super) fn protocols(results: &Results) -> Vec<Table> {
    protocol_tables(&[Source { label: "run", results }], Mixing::Apart).unwrap()
}

pub(super) fn notes(table: &Table, kind: NoteKind) -> String {
    let notes = table.footer.iter().filter(|note| note.kind == kind);
    notes.map(|note| format!("{}\n", note.text)).collect()
}

pub(super) fn measured(table: &Table) -> impl Iterator<Item = &Row> {
    table.rows.iter().filter(|row| row.origin == Origin::Measured)
}

pub(super) fn trained(name: &str, seed: &str, data: &str) -> MethodRecord {
    let training = Some(TrainingRecord { data: data.to_owned(), seed: Some(seed.to_owned()) });
    MethodRecord { weights_sha256: Some(format!("weights of {name}")), training, ..atsplat(name, |_| ()) }
}

/// Every method that a table of the paper has a row for.
fn methods() -> Vec<MethodRecord> {
    use atsplat_model::config::{AnchorDesign, Selection};
    let thresholds = |values: [f64; 3]| {
        atsplat(&format!("thresholds {values:?}"), |config| *config = config.with_thresholds(&values).unwrap())
    };
    let k = |k| atsplat(&format!("k {k}"), |config| config.head.gaussians_per_token = k);
    vec![
        atsplat("atsplat", |_| ()),
        random(),
        floor(),
        atsplat("farthest", |config| config.expansion.selection = Selection::FarthestPoint {}),
        atsplat("none", |config| *config = config.with_expansion_in_first(0)),
        atsplat("rays", |config| config.anchors.design = AnchorDesign::RayDepth {}),
        thresholds([0.1, 0.1, 0.4]),
        thresholds([0.01, 0.01, 0.04]),
        k(8),
        k(32),
        trained("joint", "1", "rooms train 0 to 9, yards train 0 to 9"),
    ]
}

/// All tables of the paper and of protocols, of stand-ins or of part of the published data: each measured row says so in
/// the visible text of each format, and LaTeX in more than its comments.
#[test]
fn every_row_that_is_not_the_published_setting_says_so() {
    let all = atsplat_protocol::Preset::names().map(preset);
    let (stand_ins, published): (Vec<_>, Vec<_>) = all.partition(|preset| preset.stands_for.is_some());
    for (presets, expected) in [(stand_ins, "simulated"), (published, " scene")] {
        let results = results(presets, methods());
        let mut tables: Vec<Table> = TableDefinition::names().map(|name| built(name, &results)).collect();
        assert!(tables.iter().all(Table::is_measured), "every table has a measured row");
        tables.extend(protocols(&results));
        for table in &tables {
            let name = &table.name;
            let says = |text: &str| text.contains(expected) && text.contains("16");
            let latex = TableFormat::Latex.write(table).unwrap();
            let rows = latex.lines().filter(|line| line.ends_with("\\tabularnewline") && !line.contains("& paper &"));
            let rows: Vec<&str> = rows.skip_while(|line| !line.contains("scriptsize")).collect();
            assert_eq!(rows.len(), measured(table).count(), "{name}:\n{latex}");
            assert!(rows.iter().all(|row| says(row)), "{name}:\n{latex}");
            assert!(!latex.contains("Ours"), "{name}");

            let markdown = TableFormat::Markdown.write(table).unwrap();
            let lines = markdown.lines().filter(|line| line.starts_with("| ")).skip(2);
            let rows: Vec<&str> = lines.filter(|line| !line.contains("| paper |")).collect();
            assert_eq!(rows.len(), measured(table).count(), "{name}:\n{markdown}");
            assert!(rows.iter().all(|row| says(row)), "{name}:\n{markdown}");

            let records = csv_text::parse(&TableFormat::Csv.write(table).unwrap()).unwrap();
            let at = |field: &str| records[0].iter().position(|head| head == field).unwrap();
            let rows = records.iter().skip(1).filter(|record| record[at("from")] == "measured");
            for record in rows {
                assert!(says(&record[at("measured_on")]), "{name}: {record:?}");
                assert_eq!(record[at("published_setting")], "false", "{name}");
            }

            for (width, widest) in [(80, 100), (120, 120)] {
                use unicode_width::UnicodeWidthStr as _;
                let text = Terminal { width, styled: false }.write(table);
                let boxes: Vec<&str> = text.lines().filter(|line| line.starts_with(['│', '┌', '├', '└'])).collect();
                assert!(boxes.iter().all(|line| line.width() <= widest), "{name} at {width}:\n{text}");
                assert!(boxes.iter().any(|line| line.contains(expected)), "{name}:\n{text}");
            }
        }
    }
}

#[test]
fn captions_say_that_stand_ins_are_not_comparable() {
    let table = built("re10k", &results(vec![preset("rooms-2v-128")], vec![atsplat("atsplat", |_| ())]));
    let said = "Measured on simulated rooms, 16×16, 4 of 24 scenes: not comparable with the paper's numbers.";
    assert!(table.caption.ends_with(said), "{}", table.caption);
    let mut whole = preset("re10k-2v-256");
    whole.entries_of_index = whole.entries;
    let mut results = results(vec![whole], vec![atsplat("atsplat", |_| ())]);
    results.provenance.skipped.clear();
    let table = built("re10k", &results);
    assert!(table.caption.ends_with("Measured on RE10K, 16×16, 4 of 6474 scenes."), "{}", table.caption);
}

/// One vote for PSNR and SSIM together: the sample's methods are 3 dB apart in their order.
#[test]
fn orders_are_kept_reversed_or_undecided_by_paired_intervals() {
    let presets = || vec![preset("rooms-2v-128")];
    let with_weights =
        |weights: &str, method: MethodRecord| MethodRecord { weights_sha256: Some(weights.to_owned()), ..method };
    let votes = |results: &Results| {
        let found = agreement(&built("ablation_ate", results));
        [found.kept, found.reversed, found.undecided]
    };
    let (full, other) = (atsplat("atsplat", |_| ()), with_weights("of its own", random()));
    assert_eq!(votes(&results_over(presets(), vec![full.clone(), other.clone()], 7)), [1, 0, 0]);
    assert_eq!(votes(&results_over(presets(), vec![other.clone(), full.clone()], 7)), [0, 1, 0]);
    assert_eq!(votes(&results_over(presets(), vec![full.clone(), other.clone()], 5)), [0, 0, 1], "five scenes");
    // Better by 3 dB on average, and by −9 to 15 from scene to scene.
    let mut noisy = results_over(presets(), vec![full, other], 7);
    for (at, row) in noisy.targets.iter_mut().enumerate() {
        let sign = if at / 3 % 2 == 0 { 1.0 } else { -1.0 };
        row.scores.entry("psnr".to_owned()).and_modify(|psnr| *psnr += 12.0 * sign);
    }
    assert_eq!(votes(&noisy), [0, 0, 1], "signs alone would say kept");
    let said = agreement(&built("ablation_ate", &noisy)).to_string();
    let expected = "not comparable: measured on simulated rooms, 16×16, 6 of 24 scenes, 3 of 21 targets failed; simulated rooms, 16×16, 7 of 24 \
         scenes; orders: 0 kept, 0 reversed, 1 undecided";
    assert_eq!(said, expected);
}

#[test]
fn identical_targets_are_left_out_and_counted() {
    let mut results = results_over(vec![preset("rooms-2v-128")], vec![floor()], 7);
    let before = built("re10k", &results);
    let mut copy = results.targets[0].clone();
    (copy.target, copy.status, copy.scores) = (9, TargetStatus::Identical, [("ssim".to_owned(), 1.0)].into());
    results.targets.push(copy);
    let after = built("re10k", &results);
    let [before, with] = [&before, &after].map(|table| measured(table).next().unwrap().cells[0][..2].to_vec());
    for (one, other) in before.iter().zip(&with) {
        assert_eq!((&one.value, one.interval), (&other.value, other.interval), "100 dB and SSIM 1 move no mean");
    }
    assert_eq!(with[0].counts.unwrap().identical, 1);
    assert!(notes(&after, NoteKind::Counts).contains("21 targets, 1 more identical to the truth and left out"));
    assert!(notes(&after, NoteKind::LeftOut).contains("left out of all means"));
    assert!(TableFormat::Latex.write(&after).unwrap().contains("{\\footnotesize"), "printed below the table");
}

#[test]
fn targets_that_a_method_does_not_support_have_not_failed() {
    let mut results = results_over(vec![preset("rooms-2v-128")], vec![floor(), atsplat("atsplat", |_| ())], 7);
    let broken = results.trials.iter_mut().find(|trial| trial.status == TrialStatus::Failed).unwrap();
    broken.status = TrialStatus::NotApplicable;
    let table = built("re10k", &results);
    let row = measured(&table).find(|row| row.cells[0][0].counts.is_some_and(|counts| counts.targets == 18)).unwrap();
    let counts = row.cells[0][0].counts.unwrap();
    assert_eq!((counts.failed, counts.not_applicable), (0, 3));
    assert!(!row.cells[0][0].is_rankable(), "its mean lacks targets all the same");
    assert!(row.measured_on.as_ref().unwrap().text.contains("3 of 21 targets not applicable"), "{:?}", row.measured_on);
    let said = notes(&table, NoteKind::Counts);
    assert!(said.contains("3 not applicable and not in the mean") && !said.contains("failed"), "{said}");
}

#[test]
fn an_entry_that_is_skipped_for_two_reasons_counts_once() {
    let mut results = store();
    let other = results.provenance.skipped[0].clone();
    results.provenance.skipped.push(SkippedEntry { reason: "baseline".to_owned(), ..other });
    let said = notes(&built("re10k", &results), NoteKind::Counts);
    assert!(said.contains("1 index entry skipped (missing-frame 1, baseline 1)"), "{said}");
}

/// The paper has uncertainty 0.49 dB above random selection; the sample's random selection is 3 dB below, or above.
#[test]
fn orders_are_listed_with_what_the_paper_measured() {
    let listed = |name: &str, weights: Option<&str>| {
        let mut all = vec![trained("first", "1", "simulated rooms"), random()];
        all[1].weights_sha256 = weights.map(str::to_owned).or_else(|| all[0].weights_sha256.clone());
        if name == "second" {
            all.swap(0, 1);
        }
        orders_as_markdown(&[built("ablation_ate", &results_over(vec![preset("rooms-2v-128")], all, 7))]).unwrap()
    };
    let line = |text: &str| text.lines().find(|line| line.starts_with("| Random | Uncertainty")).unwrap().to_owned();
    let kept = line(&listed("first", Some("of its own")));
    assert_eq!(kept, "| Random | Uncertainty | PSNR | -0.490 | -3.000 | \\[-3.000, -3.000\\] | 6 | 1 and 1 | kept |",);
    let reversed = line(&listed("second", Some("of its own")));
    assert!(reversed.contains("| -0.490 | +3.000 |") && reversed.ends_with("| **reversed** |"), "{reversed}");
    assert!(line(&listed("first", None)).ends_with("| kept, changed at inference only |"));
    assert_eq!(orders_as_markdown(&[built("re10k", &results(vec![], vec![]))]), None);
}

/// A capture has a table in every format; with six of them also intervals.
#[test]
fn a_capture_has_a_protocol_table_in_every_format() {
    let mut capture = preset("photos-3v-256");
    (capture.dataset, capture.index_name) = ("/home/me/fox".to_owned(), None);
    let methods = || vec![trained("atsplat", "1", "simulated rooms"), floor()];
    for (scenes, intervals) in [(4, false), (7, true)] {
        let found = protocols(&results_over(vec![capture.clone()], methods(), scenes));
        let [table] = found.as_slice() else { panic!("one table: {}", found.len()) };
        assert_eq!(table.name, "protocol-photos-3v-256");
        for format in TableFormat::ALL {
            let text = format.write(table).unwrap().replace("$\\times$", "×");
            assert!(text.contains("capture fox, 16×16") && text.contains("zero-shot:"), "{text}");
            assert_eq!(
                text.contains("no interval with fewer than 6"),
                !intervals && format != TableFormat::Csv,
                "{text}"
            );
        }
        let printed = TableFormat::Markdown.write(table).unwrap().replace('\\', "");
        let brackets = |line: &str| line.starts_with("| ATSplat") && line.contains(" [");
        assert_eq!(printed.lines().any(brackets), intervals, "{printed}");
        assert!(printed.contains("#Gauss.") && printed.contains("Time (s)") && printed.contains("0.260"), "{printed}");
    }
}

#[test]
fn protocol_tables_have_bins_and_distances_with_their_slopes() {
    let mut results = results_over(vec![preset("rooms-overlap-128"), preset("rooms-extrapolation-128")], methods(), 8);
    for row in results.targets.iter_mut().filter(|row| row.key.preset == "rooms-extrapolation-128") {
        // 4 dB per frame, and 5 dB with the nearest view.
        row.signed_distance = [0, -1, 3][row.target as usize];
        if row.signed_distance != 0 {
            let per_frame = if row.key.method == floor().name { 5.0 } else { 4.0 };
            row.scores.insert("psnr".to_owned(), 30.0 - per_frame * row.signed_distance.unsigned_abs() as f64);
        }
    }
    for row in results.targets.iter_mut().filter(|row| row.key.preset == "rooms-overlap-128") {
        row.signed_distance = 0;
    }
    let tables = protocols(&results);
    assert_eq!(tables.len(), 2);
    let titles: Vec<&str> = tables[0].groups.iter().map(|group| group.title.as_str()).collect();
    assert_eq!(titles, ["", "small overlap", "medium overlap", "large overlap", "Trend of PSNR"]);
    let titles: Vec<&str> = tables[1].groups.iter().map(|group| group.title.as_str()).collect();
    assert_eq!(titles, ["", "inside the window", "1 outside", "3 outside", "Trend of PSNR"]);
    let row = measured(&tables[1]).next().unwrap();
    let numbers: Vec<f64> = (2..5).map(|group| row.cells[group][0].value.number().unwrap()).collect();
    Tolerance::absolute(1e-9).assert(numbers, [26.0, 18.0, -4.0], "1 and 3 frames outside, and the slope");
    assert_eq!(row.cells[4][0].print(tables[1].column(CellIndex { group: 4, column: 0 })), "-4.000 [-4.000, -4.000]");
    let trends = notes(&tables[1], NoteKind::Trend);
    // A target of the first scene is a context frame, and one distance alone says nothing.
    let expected = "minus that of Nearest view changes by +1.000 [+1.000, +1.000] per frame outside, over 7 scenes";
    assert!(trends.contains(expected), "{trends}");
    let counts = row.cells[4][0].counts.unwrap();
    assert_eq!((counts.scenes, counts.targets), (8, 16), "without the targets inside the window");
    // Files have the scenes of slopes; footers list those of means.
    for (table, column) in tables.iter().zip(["slope-over-overlap_scenes", "slope-over-distance_scenes"]) {
        let records = csv_text::parse(&TableFormat::Csv.write(table).unwrap()).unwrap();
        let at = records[0].iter().position(|name| name == column).unwrap();
        let position = table.rows.iter().position(|row| row.method.as_deref() == Some("atsplat")).unwrap();
        assert_eq!(records[position + 1][at], "8", "{column}");
        let listed = notes(table, NoteKind::Counts);
        assert!(listed.contains("8 scenes, ") && !listed.contains("Trend of PSNR"), "{listed}");
    }
    // Ablations have rows too, and say what they are.
    let labels: Vec<String> = measured(&tables[0]).map(|row| row.printed_labels().concat()).collect();
    assert!(labels.iter().any(|label| label == "ATSplat, random, changed at inference only"), "{labels:?}");
}

/// Eight scenes with overlaps of 0.1 to 0.7, four, and eight with overlaps that are almost equal.
#[test]
fn a_trend_of_few_scenes_or_close_overlaps_is_not_computed() {
    let said = |scenes: usize, step: Option<f64>| {
        let mut results = results_over(vec![preset("rooms-overlap-128")], vec![floor()], scenes);
        for (row, at) in results.targets.iter_mut().zip(0u8..) {
            row.signed_distance = 0;
            row.overlap = step.map_or(row.overlap, |step| Some(0.5 + step * f64::from(at)));
        }
        let table = protocols(&results).swap_remove(0);
        let trend = CellIndex { group: 4, column: 0 };
        let printed = measured(&table).next().unwrap().cell(trend).print(table.column(trend));
        let why = notes(&table, NoteKind::NotComputed);
        (printed, why.lines().find(|note| note.contains("per 0.1 of overlap")).map(str::to_owned))
    };
    let (printed, why) = said(8, None);
    assert!(printed.contains(" [") && why.is_none(), "{printed} {why:?}");
    for (scenes, step, expected) in [
        (4, None, "expected at least 6 scenes, found 4"),
        (8, Some(0.001), "expected overlaps that differ by at least 0.1, found 0.023"),
    ] {
        let why = Some(format!("n/c per 0.1 of overlap: not computed: {expected}"));
        assert_eq!(said(scenes, step), ("n/c".to_owned(), why));
    }
}

#[test]
fn thresholds_by_quantile_say_so_and_budgets_have_a_trend() {
    let by_quantile = |published: [f64; 3], at: f64, gaussians: u64| {
        let mut method =
            atsplat(&format!("quantiles {at}"), |config| *config = config.with_thresholds(&[at; 3]).unwrap());
        method.title = format!("ATSplat at {at}");
        method.parameters.insert("threshold-quantiles".to_owned(), json!([0.8, 0.8, 0.9]));
        method.parameters.insert("published-thresholds".to_owned(), json!(published));
        (method, gaussians)
    };
    let methods = [by_quantile([0.1, 0.1, 0.4], 0.3, 16_384), by_quantile([0.01, 0.01, 0.04], 0.2, 4_096)];
    let records = methods.iter().map(|(method, _)| method.clone()).collect();
    let mut results = results_over(vec![preset("rooms-2v-128")], records, 8);
    for trial in &mut results.trials {
        let method = methods.iter().find(|(method, _)| method.name == trial.key.method);
        trial.gaussians = method.map(|(_, gaussians)| *gaussians);
    }
    let table = built("dynamic_budget", &results);
    let labels: Vec<String> =
        measured(&table).filter(|row| !row.without_leaked).map(|row| row.printed_labels().concat()).collect();
    let expected = "0.1 / 0.1 / 0.4, thresholds by quantile 0.8 / 0.8 / 0.9 of its own scores: 0.3 / 0.3 / 0.3";
    assert_eq!(labels[0], expected);
    assert_eq!(labels.len(), 2);
    // The second method is 3 dB worse with a quarter of the Gaussians, in the seven scenes where it does not fail.
    let trend = notes(&table, NoteKind::Trend);
    assert!(trend.starts_with("trend: PSNR changes by +1.500 [+1.500, +1.500] per doubling"), "{trend}");
    assert!(trend.contains("over 2 settings and 7 scenes"), "{trend}");

    // The plot needs counts that differ between scenes; its rows are named like the table's.
    for (at, trial) in results.trials.iter_mut().enumerate() {
        trial.gaussians = trial.gaussians.map(|gaussians| gaussians + at as u64);
    }
    let table = built("dynamic_budget", &results);
    let plots = table_plots(
        &TableDefinition::named("dynamic_budget").unwrap(),
        &table,
        &[Source { label: "run", results: &results }],
    );
    let text: Vec<&str> = plots[0].1.texts().collect();
    assert!(text.join(" ").contains("thresholds by quantile 0.8 / 0.8 / 0.9 of its own"), "{text:?}");
}
