//! Tables of protocols: every format, bins of overlap and distances with their slopes.

use atsplat_files::csv;
use atsplat_numeric::Tolerance;
use atsplat_protocol::{BinRule, OverlapBins};

use crate::definition::Choice;
use crate::emit::TableFormat;
use crate::sample::{nearest_view, preset, results, results_over};
use crate::table::test_tables::{measured, notes_as_text, paper_methods, protocols, row_of, trained};
use crate::table::{CellIndex, Column, Mixing, NoteKind, Source, chosen_protocol_tables};

/// A capture has a table in every format; with six of them also intervals.
#[test]
fn a_capture_has_a_protocol_table_in_every_format() {
    let mut capture = preset("photos-3v-256");
    (capture.dataset, capture.index_name) = ("/home/me/fox".to_owned(), None);
    let methods = || vec![trained("atsplat", "1", "simulated rooms"), nearest_view()];
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
    let mut results =
        results_over(vec![preset("rooms-overlap-128"), preset("rooms-extrapolation-128")], paper_methods(), 8);
    for row in results.targets.iter_mut().filter(|row| row.key.preset == "rooms-extrapolation-128") {
        // 4 dB per frame, and 5 dB with the nearest view.
        row.signed_distance = [0, -1, 3][row.target as usize];
        if row.signed_distance != 0 {
            let per_frame = if row.key.method == nearest_view().name { 5.0 } else { 4.0 };
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
    let trends = notes_as_text(&tables[1], NoteKind::Trend);
    // A target of the first scene is a context frame, and one distance alone says nothing.
    let expected = "minus that of Nearest view changes by +1.000 [+1.000, +1.000] per frame outside, over 7 scenes";
    assert!(trends.contains(expected), "{trends}");
    let counts = row.cells[4][0].counts.unwrap();
    assert_eq!((counts.scenes, counts.targets), (8, 16), "without the targets inside the window");
    // Files have the scenes of slopes; footers list those of means.
    for (table, column) in tables.iter().zip(["slope-over-overlap_scenes", "slope-over-distance_scenes"]) {
        let records = csv::parse(&TableFormat::Csv.write(table).unwrap()).unwrap();
        let at = records[0].iter().position(|name| name == column).unwrap();
        let position = table.rows.iter().position(|row| row.method.as_deref() == Some("atsplat")).unwrap();
        assert_eq!(records[position + 1][at], "8", "{column}");
        let listed = notes_as_text(table, NoteKind::Counts);
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
        let mut results = results_over(vec![preset("rooms-overlap-128")], vec![nearest_view()], scenes);
        for (row, at) in results.targets.iter_mut().zip(0u8..) {
            row.signed_distance = 0;
            row.overlap = step.map_or(row.overlap, |step| Some(0.5 + step * f64::from(at)));
        }
        let table = protocols(&results).swap_remove(0);
        let trend = CellIndex { group: 4, column: 0 };
        let printed = measured(&table).next().unwrap().cell(trend).print(table.column(trend));
        let why = notes_as_text(&table, NoteKind::NotComputed);
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

/// The average over bins, in tables of the paper, is another set of targets.
#[test]
fn a_bin_named_average_is_one_bin() {
    let mut record = preset("rooms-overlap-128");
    let mut protocol = record.protocol().unwrap();
    let names = ["low", "average", "high"].map(str::to_owned).to_vec();
    protocol.overlap_bins = Some(OverlapBins::new(BinRule::Strict, names, vec![0.0, 0.4, 0.6, 1.0]).unwrap());
    (record.hash, record.toml) = (protocol.hash().unwrap().to_string(), protocol.to_toml().unwrap());
    let results = results_over(vec![record], vec![trained("atsplat", "1", "simulated rooms"), nearest_view()], 8);
    let choice = Choice { against: Some(nearest_view().name), ..Choice::default() };
    let source = Source { label: "run", results: &results };
    let table = chosen_protocol_tables(&[source], Mixing::Apart, &choice).unwrap().swap_remove(0);
    assert_eq!(table.groups[2].title, "average overlap");
    let in_bin = row_of(&table, "atsplat").cells[2][0].value.number();
    Tolerance::absolute(1e-9).assert(in_bin, [19.25], "the third scene and the seventh, not all with 20.25");
    let heads: Vec<String> = table.groups.last().unwrap().columns.iter().map(Column::head).collect();
    assert_eq!(heads, ["ΔPSNR"], "no difference over all targets stands under the heading of a bin");
}

/// The clipped PSNR was scored too.
#[test]
fn columns_by_overlap_and_differences_are_of_the_psnr_that_the_protocol_names() {
    let mut store =
        results(vec![preset("re10k-overlap")], vec![trained("atsplat", "1", "simulated rooms"), nearest_view()]);
    let record = &mut store.provenance.presets[0];
    let [usual, rounded] = ["psnr", "psnr-8bit-rounded"].map(|id| format!("[metrics]\npsnr = \"{id}\"\n"));
    assert!(record.toml.contains(&usual), "{}", record.toml);
    record.toml = record.toml.replace(&usual, &rounded);
    for row in &mut store.targets {
        if let Some(psnr) = row.scores.get("psnr").copied() {
            row.scores.insert("psnr-8bit-rounded".to_owned(), psnr - 0.5);
        }
    }
    let table = protocols(&store).swap_remove(0);
    let of_groups: Vec<&str> = table.columns().map(|(_, column)| column.quantity.id()).collect();
    assert_eq!(of_groups[..2], ["psnr-8bit-rounded", "psnr"], "all metrics");
    let count = |of: &str| of_groups.iter().filter(|id| **id == of).count();
    assert!(count("psnr") == 1 && count("psnr-8bit-rounded") >= 4, "{of_groups:?}");
    let choice = Choice { against: Some(nearest_view().name), ..Choice::default() };
    let source = Source { label: "run", results: &store };
    let table = chosen_protocol_tables(&[source], Mixing::Apart, &choice).unwrap().swap_remove(0);
    let differences = &table.groups.last().unwrap().columns;
    let names: Vec<&str> = differences.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["psnr-8bit-rounded_difference"]);
}
