//! Snapshots of every format, and tests of escaping.

use atsplat_results::{MethodRecord, Results, StatedCost, StatedSeconds};

use super::*;
use crate::definition::TableDefinition;
use crate::sample::{HOSTILE, UNBROKEN, atsplat, nearest_view, preset, results, results_over, store};
use crate::table::{Mark, Mixing, Source, protocol_tables, tables};

fn measured(name: &str) -> Table {
    table_of(name, &store())
}

fn table_of(name: &str, results: &Results) -> Table {
    let definition = TableDefinition::named(name).unwrap();
    tables(&definition, &[Source { label: "run", results }], Mixing::Apart).unwrap().swap_remove(0)
}

fn published(name: &str) -> Table {
    tables(&TableDefinition::named(name).unwrap(), &[], Mixing::Apart).unwrap().swap_remove(0)
}

#[test]
fn writes_a_measured_table_in_every_format() {
    let table = measured("re10k");
    for format in TableFormat::ALL {
        insta::assert_snapshot!(format!("re10k-{}", format.extension()), format.write(&table).unwrap());
    }
}

#[test]
fn writes_ablations_and_grouped_tables() {
    insta::assert_snapshot!("ablation-txt", TableFormat::Terminal.write(&measured("ablation_ate")).unwrap());
    insta::assert_snapshot!("overlap-txt", TableFormat::Terminal.write(&measured("re10k_overlap")).unwrap());
    insta::assert_snapshot!("dl3dv-tex", TableFormat::Latex.write(&published("dl3dv")).unwrap());
    insta::assert_snapshot!("budget-txt", TableFormat::Terminal.write(&published("budget")).unwrap());
}

/// The ends of an interval are called `low` and `high` too.
#[test]
fn columns_of_csv_have_different_names_whatever_the_bins_are_called() {
    let mut renamed = preset("re10k-overlap");
    renamed.toml = renamed.toml.replace("\"small\"", "\"low\"").replace("\"large\"", "\"high\"");
    let results = results(vec![renamed], vec![nearest_view()]);
    let table = protocol_tables(&[Source { label: "run", results: &results }], Mixing::Apart).unwrap().swap_remove(0);
    let text = TableFormat::Csv.write(&table).unwrap();
    let head: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    assert!(head.contains(&"psnr_low") && head.contains(&"psnr_low_overlap"), "{head:?}");
    let distinct: std::collections::BTreeSet<&&str> = head.iter().collect();
    assert_eq!(distinct.len(), head.len(), "{head:?}");
}

#[test]
fn no_line_is_wider_than_its_terminal() {
    use unicode_width::UnicodeWidthStr as _;
    let published = TableDefinition::names().map(|name| (name.to_owned(), published(name)));
    // Eight scenes have intervals, which no table of a paper has.
    let long = MethodRecord { title: UNBROKEN.to_owned(), ..nearest_view() };
    let presets = ["re10k-2v-256", "re10k-overlap"].map(preset).to_vec();
    let results = results_over(presets, vec![atsplat("atsplat", |_| ()), long], 8);
    let measured = protocol_tables(&[Source { label: "run", results: &results }], Mixing::Apart).unwrap();
    assert!(measured.iter().flat_map(Table::columns).any(|(_, column)| column.intervals));
    let measured = measured.into_iter().map(|table| (table.name.clone(), table));
    for (name, table) in published.chain(measured) {
        for width in [60, 80, 120, 200] {
            let text = Terminal { width, styled: false }.write(&table);
            for line in text.lines().filter(|line| line.starts_with(['│', '┌', '├', '└'])) {
                assert!(line.width() <= width, "{name} at {width}: {line}");
            }
            let boxes = text.lines().filter(|line| line.starts_with('│')).map(|line| line.matches('│').count());
            assert!(boxes.count() > 2, "{name}");
        }
    }
}

#[test]
fn a_split_table_contains_every_number() {
    let table = published("re10k_overlap");
    let narrow = Terminal { width: 70, styled: false }.write(&table);
    assert!(narrow.matches('┌').count() > 1, "the table is split:\n{narrow}");
    for cell in table.rows.iter().flat_map(|row| row.cells.iter().flatten()) {
        if let Some(number) = cell.value.number().filter(|number| *number < 100.0 && *number > 1.0) {
            assert!(narrow.contains(&format!("{number:.2}")), "{number}");
        }
    }
}

#[test]
fn escape_sequences_are_only_used_if_styled() {
    let table = published("re10k");
    assert!(!Terminal { width: 100, styled: false }.write(&table).contains('\u{1b}'));
    let styled = Terminal { width: 100, styled: true }.write(&table);
    assert!(styled.contains("\u{1b}[1m28.65\u{1b}[0m") && styled.contains("\u{1b}[4m28.54\u{1b}[0m"), "{styled}");
}

/// A hostile method name stays text in every format.
#[test]
fn escapes_hostile_names_in_every_format() {
    let mut method = nearest_view();
    method.title = format!("{HOSTILE}\n%{{}}$^~# & \\input{{/etc/passwd}}");
    let results = results(vec![preset("re10k-2v-256")], vec![method]);
    let mut table = table_of("re10k", &results);
    table.title = HOSTILE.to_owned();
    let write = |format: TableFormat| format.write(&table).unwrap();
    assert!(!write(TableFormat::Terminal).contains('\u{1b}'));
    let markdown = write(TableFormat::Markdown);
    assert!(!markdown.contains("<script"), "{markdown}");
    assert!(markdown.contains("\\$^") && !markdown.replace("\\$", "").contains('$'), "no formula: {markdown}");
    let width = |line: &str| line.replace("\\|", "").matches('|').count();
    let lines: Vec<usize> = markdown.lines().filter(|line| line.starts_with("| ")).map(width).collect();
    assert!(lines.windows(2).all(|pair| pair[0] == pair[1]), "cells end where they should: {lines:?}\n{markdown}");
    let latex = write(TableFormat::Latex);
    let body: String = latex.lines().filter(|line| !line.starts_with('%')).collect();
    assert!(!body.contains("\\input") && body.contains("\\textbackslash{}input"), "{latex}");
    assert!(!body.replace("\\%", "").contains('%'), "nothing else is a comment: {latex}");
    assert!(!body.contains('|') && body.contains("&\\textbar{}*"), "a bar is a dash in LaTeX's default font: {latex}");
    let csv = write(TableFormat::Csv);
    assert_eq!(atsplat_files::csv::parse(&csv).unwrap().len(), table.rows.len() + 1, "{csv}");
    serde_json::from_str::<Value>(&write(TableFormat::Json)).unwrap();
}

/// pdfLaTeX stops at what is left; it prints accented letters as they are.
#[test]
fn characters_have_their_commands_in_latex_or_are_listed_in_its_comment() {
    let latex = |title: &str| {
        let mut method = nearest_view();
        method.title = title.to_owned();
        let results = results(vec![preset("re10k-2v-256")], vec![method]);
        let table = table_of("re10k", &results);
        TableFormat::Latex.write(&table).unwrap()
    };
    let known = latex("σ ≥ 0.5 − α·Σ ± 2×3 °… “é” -– -— -");
    for expected in [
        "$\\sigma$ $\\ge$ 0.5 $-$ $\\alpha$$\\cdot$$\\Sigma$ $\\pm$ 2$\\times$3 ",
        " $^\\circ$\\dots{} ``é'' -{}-- -{}--- - & ",
    ] {
        assert!(known.contains(expected), "{expected}\n{known}");
    }
    assert!(!known.contains("Unicode engine"), "{known}");
    let others = latex("σ 视图 é ✓ đ");
    let comment = " and a font with đ (U+0111), ✓ (U+2713), 图 (U+56FE), 视 (U+89C6)\n\\begin{table}";
    assert!(others.contains(comment) && others.contains("$\\sigma$ 视图 é ✓ đ"), "{others}");
}

/// A hyphen is shorter than the plus in the same column.
#[test]
fn negative_numbers_have_a_minus_in_latex() {
    let mut method = nearest_view();
    method.title = "a -2.44 [-4.52, +1.94] lr1e-4, 10-20, x-2, (-3), - 5, -x".to_owned();
    let results = results(vec![preset("re10k-2v-256")], vec![method]);
    let table = table_of("re10k", &results);
    let latex = TableFormat::Latex.write(&table).unwrap();
    let expected = "a $-$2.44 [$-$4.52, +1.94] lr1e-4, 10-20, x-2, ($-$3), - 5, -x";
    assert!(latex.contains(expected), "{latex}");
    let markdown = TableFormat::Markdown.write(&table).unwrap();
    assert!(markdown.contains("a -2.44 "), "{markdown}");
}

/// Asterisks of published rows, and times of other machines, would otherwise be explained in comments alone.
#[test]
fn marks_and_machines_are_explained_where_latex_prints_them() {
    let printed = |table: &Table| {
        let latex = TableFormat::Latex.write(table).unwrap();
        latex.lines().filter(|line| !line.starts_with('%')).collect::<Vec<_>>().join("\n")
    };
    for (name, row, note) in [
        ("dl3dv", "iLRM* &", "{\\footnotesize * published at 6 views only"),
        ("dl3dv_hr", "DepthSplat* &", "{\\footnotesize * the paper's time of DepthSplat is of one A6000"),
        ("k_scaling", "16* &", "{\\footnotesize * the setting of all other tables of the paper."),
    ] {
        let printed = printed(&published(name));
        assert!(printed.contains(row) && printed.contains(note), "{printed}");
        assert!(!printed.contains("paper: ATSplat"), "the source is a comment: {printed}");
    }
    let with_times = printed(&measured("re10k"));
    for note in ["published times are of one RTX 3090", "Time: a processor, 2 threads on 2 logical processors"] {
        assert!(with_times.contains(note), "{note}\n{with_times}");
    }
    let mut untimed = store();
    untimed.timings.clear();
    assert!(!printed(&table_of("re10k", &untimed)).contains("Time: a processor"));
}

/// Gaussians are stated under the table's protocol, and nothing was timed; the other method counts its own.
#[test]
fn stated_costs_are_said_to_be_stated_in_every_format() {
    let seconds = Some(StatedSeconds { encode: 0.25, render: None, machine: "a card".to_owned() });
    let mut imported = nearest_view();
    imported.stated.insert("re10k-2v-256".to_owned(), StatedCost { gaussians: Some(70_000), seconds });
    imported.stated.insert("another".to_owned(), StatedCost { gaussians: Some(1), seconds: None });
    let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), imported]);
    results.timings.clear();
    let table = table_of("re10k", &results);
    let rows = "Nearest view; Nearest view, leaked targets excluded";
    let [count, time] = [
        format!("{rows}: Gaussians stated, not counted"),
        format!("Time of {rows}: a card (stated, not measured here)"),
    ];
    let latex = TableFormat::Latex.write(&table).unwrap();
    let printed: Vec<&str> = latex.lines().filter(|line| !line.starts_with('%')).collect();
    for text in [printed.join("\n"), TableFormat::Markdown.write(&table).unwrap()] {
        assert!(text.contains(&count) && text.contains(&time) && text.contains("70K"), "{text}");
    }
    let csv = TableFormat::Csv.write(&table).unwrap();
    let fields = atsplat_files::csv::parse(&csv).unwrap();
    let column = |name: &str| fields[0].iter().position(|head| head == name);
    let of = |id: &str, name: &str| {
        let row = fields.iter().find(|row| row[column("method_id").unwrap()] == id).unwrap();
        row[column(name).unwrap()].clone()
    };
    let names = ["gaussians", "gaussians_stated", "seconds", "seconds_stated"];
    assert_eq!(names.map(|name| of("nearest-view", name)), ["70000", "true", "0.25", "true"]);
    assert_eq!(names.map(|name| of("a", name)), ["23040", "false", "", "false"]);
    assert_eq!(of("nearest-view", "seconds_mad"), "", "a single number has no deviation");
    assert_eq!(column("psnr_stated"), None, "nothing there was stated");
    let json: Value = serde_json::from_str(&TableFormat::Json.write(&table).unwrap()).unwrap();
    let rows = json["table"]["rows"].as_array().unwrap();
    let cells = |id: &str| &rows.iter().find(|row| row["method"] == id).unwrap()["cells"][0];
    assert_eq!([&cells("nearest-view")[3]["stated"], &cells("a")[3]["stated"]], [&Value::Bool(true), &Value::Null]);
}

/// `52K`, `> 10 m` and `Diverged` have columns of their own; other tables do not have these columns.
#[test]
fn columns_of_numbers_have_no_other_text() {
    for (name, column, texts) in [
        ("budget", "gaussians", &["52K"][..]),
        ("dl3dv_hr", "seconds", &["> 10 m"]),
        ("ablation_anchor_dl3dv", "psnr", &["Diverged"]),
        ("re10k", "psnr", &[]),
    ] {
        let records = atsplat_files::csv::parse(&TableFormat::Csv.write(&published(name)).unwrap()).unwrap();
        let (head, rows) = records.split_first().unwrap();
        let values = |column: &str| {
            let at = head.iter().position(|known| known == column);
            at.map(|at| rows.iter().map(|row| row[at].as_str()).filter(|value| !value.is_empty()).collect::<Vec<_>>())
        };
        let numbers = values(column).unwrap();
        assert!(
            !numbers.is_empty() && numbers.iter().all(|number| number.parse::<f64>().is_ok()),
            "{name}: {numbers:?}"
        );
        let found = values(&format!("{column}_text"));
        let mut distinct = found.clone().unwrap_or_default();
        distinct.dedup();
        assert_eq!((found.is_some(), &distinct[..]), (!texts.is_empty(), texts), "{name}");
    }
}

/// `\tabularnewline` takes a star and a length in brackets, `\midrule` the latter.
#[test]
fn labels_are_no_arguments_of_the_latex_above_them() {
    let methods = ["[9mm] method", "*method", "method [9mm]*"].map(|title| {
        let mut method = nearest_view();
        (method.name, method.title) = (title.to_owned(), title.to_owned());
        method
    });
    let results = results(vec![preset("re10k-2v-256")], methods.into());
    let table = table_of("re10k", &results);
    let latex = TableFormat::Latex.write(&table).unwrap();
    for expected in
        ["\\midrule\n{}[9mm] method & ", "\\tabularnewline\n{}*method & ", "\\tabularnewline\nmethod [9mm]* & "]
    {
        assert!(latex.contains(expected), "{expected}\n{latex}");
    }
}

#[test]
fn long_names_may_break_in_latex_and_short_ones_may_not() {
    let mut method = nearest_view();
    method.title = format!("{UNBROKEN} at re10k-2v-256");
    let results = results(vec![preset("re10k-2v-256")], vec![method]);
    let table = table_of("re10k", &results);
    let latex = TableFormat::Latex.write(&table).unwrap();
    let expected = "\\raggedright mvsplat\\_\\allowbreak{}re10k\\_\\allowbreak{}finetuned\\_";
    assert!(latex.contains(expected) && latex.contains("lr1e-\\allowbreak{}4\\_"), "{latex}");
    assert!(latex.contains("last\\_\\allowbreak{}final at re10k-2v-256"), "{latex}");
}

/// Every table, with a hostile method and one of a long name among its rows, fits an A4 page.
#[test]
fn latex_compiles_and_no_table_is_wider_than_its_page() {
    use std::process::Command;
    let mut method = nearest_view();
    method.title = format!("{HOSTILE} %{{}}$^~# & \\input{{/etc/passwd}} with a name of many words").replace('>', "> ");
    let presets = ["re10k-2v-256", "rooms-2v-128", "dl3dv-6v-256x448"].map(preset).into();
    let mut bracketed = nearest_view();
    (bracketed.name, bracketed.title) = ("bracketed".to_owned(), "[method]".to_owned());
    let mut unbroken = nearest_view();
    (unbroken.name, unbroken.title) = ("unbroken".to_owned(), UNBROKEN.to_owned());
    let results = results(presets, vec![method, atsplat("atsplat", |_| ()), bracketed, unbroken]);
    let mut pages = String::new();
    for name in TableDefinition::names() {
        let definition = TableDefinition::named(name).unwrap();
        let source = Source { label: "run", results: &results };
        for table in tables(&definition, &[source], Mixing::Apart).unwrap().into_iter().chain([published(name)]) {
            pages += &format!("{}\\clearpage\n", TableFormat::Latex.write(&table).unwrap());
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let head = "\\documentclass{article}\\usepackage[a4paper,margin=25mm]{geometry}\\usepackage[T1]{fontenc}";
    let document = format!("{head}\\usepackage{{booktabs,graphicx}}\\begin{{document}}\n{pages}\\end{{document}}\n");
    std::fs::write(folder.path().join("tables.tex"), document).unwrap();
    let run = Command::new("pdflatex")
        .args(["-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", "tables.tex"])
        .current_dir(folder.path())
        .output();
    let Ok(run) = run else {
        return atsplat_tests::skip("latex_compiles_and_no_table_is_wider_than_its_page", "no pdflatex");
    };
    let log = String::from_utf8_lossy(&run.stdout);
    let end: String = log.chars().skip(log.chars().count().saturating_sub(2000)).collect();
    assert!(run.status.success(), "{end}");
    let wide: Vec<&str> = log.lines().filter(|line| line.starts_with("Overfull \\hbox")).collect();
    assert!(wide.is_empty(), "{wide:#?}");
}

/// The bold and underlined values of the paper's LaTeX, read by eye; ties share a mark.
#[test]
fn marks_agree_with_the_paper() {
    let marked = |table: &Table, group: usize, column: usize, mark: Mark| {
        let rows = table.rows.iter().filter(|row| row.cells[group][column].mark == mark);
        rows.map(|row| row.labels[0].clone()).collect::<Vec<_>>()
    };
    let overlap = published("re10k_overlap");
    let (psnr, ssim, lpips) = (0, 1, 2);
    for (group, column, best, second) in [
        (1, psnr, vec!["ATSplat"], vec!["iLRM"]),
        (1, ssim, vec!["ATSplat"], vec!["iLRM"]),
        (1, lpips, vec!["iLRM"], vec!["ATSplat"]),
        (2, psnr, vec!["ATSplat"], vec!["iLRM"]),
        (2, ssim, vec!["iLRM"], vec!["ATSplat"]),
        (2, lpips, vec!["iLRM"], vec!["ATSplat"]),
        (3, ssim, vec!["iLRM"], vec!["DepthSplat", "ATSplat"]),
        (3, lpips, vec!["iLRM"], vec!["DepthSplat"]),
        (4, psnr, vec!["iLRM", "ATSplat"], vec!["DepthSplat"]),
        (4, ssim, vec!["iLRM"], vec!["ATSplat"]),
        (4, lpips, vec!["iLRM"], vec!["DepthSplat"]),
        (0, 0, vec!["ATSplat"], vec![]),
    ] {
        assert_eq!(marked(&overlap, group, column, Mark::Best), best, "group {group}, column {column}");
        // With two best values, the paper marks no second.
        if best.len() == 1 {
            assert_eq!(marked(&overlap, group, column, Mark::Second), second, "group {group}, column {column}");
        }
    }
    let cross = published("cross_dataset");
    assert_eq!(marked(&cross, 0, lpips, Mark::Best), ["DepthSplat", "iLRM"]);
    assert_eq!(marked(&cross, 0, lpips, Mark::Second), ["ATSplat"]);
    let re10k = published("re10k");
    assert_eq!(
        (marked(&re10k, 0, lpips, Mark::Best), marked(&re10k, 0, lpips, Mark::Second)),
        (vec!["LongLRM".to_owned()], vec!["iLRM".to_owned()])
    );
    assert_eq!(marked(&published("k_scaling"), 0, psnr, Mark::Best), Vec::<String>::new());
}

#[test]
fn csv_has_full_precision_and_json_every_row() {
    let results = results_over(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), nearest_view()], 7);
    let table = table_of("re10k", &results);
    let text = TableFormat::Csv.write(&table).unwrap();
    let records = atsplat_files::csv::parse(&text).unwrap();
    let at = |name: &str| records[0].iter().position(|head| head == name).unwrap();
    let position = table.rows.iter().position(|row| row.method.as_deref() == Some("atsplat")).unwrap();
    let record = &records[position + 1];
    let cell = &table.rows[position].cells[0][0];
    assert_eq!(record[at("psnr")].parse::<f64>().unwrap().to_bits(), cell.value.number().unwrap().to_bits());
    assert_eq!(record[at("psnr_low")].parse::<f64>().unwrap().to_bits(), cell.interval.unwrap()[0].to_bits());
    assert_eq!((record[at("psnr_scenes")].as_str(), record[at("lpips")].as_str()), ("7", ""));
    let json: Value = serde_json::from_str(&TableFormat::Json.write(&table).unwrap()).unwrap();
    assert_eq!(json["table"]["rows"].as_array().unwrap().len(), table.rows.len());
}

/// The list is what tests and the Python package write.
#[test]
fn all_table_formats_are_in_the_list_of_all() {
    let unknown = serde_json::from_value::<TableFormat>("".into()).unwrap_err().to_string();
    let all = TableFormat::ALL.map(|format| serde_json::to_string(&format).unwrap().replace('"', "`")).join(", ");
    assert_eq!(unknown, format!("unknown variant ``, expected one of {all}"));
}
