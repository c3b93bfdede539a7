//! What rows say about their data, sizes, scenes and context views.

use atsplat_files::csv;
use atsplat_results::{PresetRecord, Results};

use crate::definition::{Choice, TableDefinition};
use crate::emit::{TableFormat, Terminal};
use crate::sample::{SCENES, UNKNOWN_HASH, atsplat, nearest_view, preset, results};
use crate::table::test_tables::{
    measured, paper_methods, protocols, row_of, table_of, table_of_stores, trained, two_stores,
};
use crate::table::{Mixing, Source, Table, chosen_protocol_tables};

/// A protocol on data at this path, with an index that nobody published.
fn elsewhere(name: &str, data: &str) -> PresetRecord {
    PresetRecord {
        dataset: data.to_owned(),
        index: "mine.json".to_owned(),
        index_sha256: UNKNOWN_HASH.to_owned(),
        index_name: None,
        entries_of_index: 4,
        scenes_of_index: Some(4),
        ..preset(name)
    }
}

/// What the first measured row says.
fn said(table: &Table) -> &str {
    &measured(table).next().unwrap().measured_on.as_ref().unwrap().text
}

fn with_context(mut results: Results, contexts: &[&[u64]]) -> Results {
    for (trial, context) in results.trials.iter_mut().zip(contexts.iter().cycle()) {
        trial.context = context.to_vec();
    }
    results
}

/// The scenes are named as the simulator names its own.
fn simulated(mut results: Results) -> Results {
    let key = |scene: &str| format!("rooms-test-{:08}", SCENES.iter().position(|known| *known == scene).unwrap());
    for row in &mut results.trials {
        row.key.scene = key(&row.key.scene);
    }
    for row in &mut results.targets {
        row.key.scene = key(&row.key.scene);
    }
    results
}

#[test]
fn data_of_an_unpublished_index_are_not_called_the_protocols_dataset() {
    for (protocol, table, data, expected) in [
        ("re10k-2v-256", "re10k", "captures/desk, images cropped beforehand", "unidentified data (desk)"),
        ("dl3dv-6v-256x448", "dl3dv", "/data/mine/test", "unidentified data (mine/test)"),
        ("rooms-2v-128", "re10k", "cm/", "unidentified data (cm)"),
    ] {
        let results = results(vec![elsewhere(protocol, data)], vec![nearest_view()]);
        let table = table_of(table, &results);
        let expected = format!("{expected}, 16×16, all 4 scenes, unpublished index");
        assert_eq!(said(&table), expected);
        let caption = format!(" Measured on {expected}: not comparable with the paper's numbers.");
        assert!(table.caption.ends_with(&caption), "{}", table.caption);
        let csv = TableFormat::Csv.write(&table).unwrap();
        assert!(csv.contains(&format!(",measured,\"{expected}\",false,")), "{csv}");
    }
}

/// The protocol's columns are for six views of DL3DV.
#[test]
fn simulated_scenes_are_named_under_any_protocol_and_so_is_their_number_of_views() {
    let record = PresetRecord {
        entries_of_index: 24,
        scenes_of_index: Some(24),
        ..elsewhere("dl3dv-6v-256x448", "rooms150/test")
    };
    let network = trained("atsplat", "1", "simulated rooms");
    let mut results = with_context(simulated(results(vec![record], vec![network])), &[&[0, 30]]);
    let table = table_of("dl3dv", &results);
    assert_eq!(said(&table), "simulated rooms, 16×16, 4 of 24 scenes, 2 context views, unpublished index");
    let is_zero_shot = |table: &Table| {
        let remarks = &measured(table).next().unwrap().remarks;
        remarks.iter().any(|remark| remark.starts_with("zero-shot"))
    };
    assert!(!is_zero_shot(&table), "it was trained on rooms");
    results.trials[1].key.scene = "mine".to_owned();
    let table = table_of("dl3dv", &results);
    assert!(said(&table).starts_with("unidentified data (rooms150/test), 16×16, "), "{}", said(&table));
    assert!(is_zero_shot(&table));
}

/// A copy of a built-in protocol must keep its content under its name, but an older version had another.
#[test]
fn an_own_protocol_is_not_called_a_changed_one() {
    let of = |name: &str, hash: &str| {
        let record = PresetRecord { preset: name.to_owned(), hash: hash.to_owned(), ..preset("re10k-2v-256") };
        let results = results(vec![record], vec![nearest_view()]);
        let table =
            chosen_protocol_tables(&[Source { label: "run", results: &results }], Mixing::Apart, &Choice::default());
        said(&table.unwrap()[0]).to_owned()
    };
    let scenes = "RE10K, 16×16, 4 of 6474 scenes";
    assert_eq!(of("re10k-2v-256", &preset("re10k-2v-256").hash), scenes);
    assert_eq!(of("re10k-2v-256", "another"), format!("{scenes}, protocol changed"));
    assert_eq!(of("lab", "another"), format!("{scenes}, own protocol"));
}

#[test]
fn a_published_index_names_its_dataset_under_any_protocol() {
    let index_sha256 = preset("acid-2v-256").index_sha256;
    let record = PresetRecord { index_sha256, ..elsewhere("re10k-2v-256", "data/re10k") };
    let table = table_of("re10k", &results(vec![record], vec![nearest_view()]));
    assert_eq!(said(&table), "ACID, 16×16, all 4 scenes, unpublished index");
}

/// The own index of a protocol is no published one, whatever the protocol calls its data.
#[test]
fn an_index_with_fewer_views_is_of_the_published_ones_dataset_and_an_own_one_is_not() {
    let of = |name: Option<&str>, reduced_from: Option<&str>| {
        let [index_name, reduced_from] = [name, reduced_from].map(|name| name.map(str::to_owned));
        let record = PresetRecord { index_name, reduced_from, ..elsewhere("dl3dv-12v-512x960", "data/dl3dv") };
        let results = with_context(results(vec![record], vec![nearest_view()]), &[&[0, 30]]);
        let table =
            chosen_protocol_tables(&[Source { label: "run", results: &results }], Mixing::Apart, &Choice::default());
        said(&table.unwrap()[0]).to_owned()
    };
    let reduced = of(None, Some("depthsplat-dl3dv-12v"));
    assert_eq!(reduced, "DL3DV, 16×16, all 4 scenes, 2 context views, unpublished index");
    assert!(of(None, None).starts_with("unidentified data (dl3dv), "));
    assert!(of(Some("lab"), None).starts_with("unidentified data (dl3dv), "));
}

#[test]
fn rows_say_their_number_of_context_views_if_it_is_not_the_protocols() {
    let of = |record: PresetRecord, contexts: &[&[u64]]| {
        said(&table_of("re10k", &with_context(results(vec![record], vec![nearest_view()]), contexts))).to_owned()
    };
    let scenes = "RE10K, 16×16, 4 of 6474 scenes";
    let protocol = || preset("re10k-2v-256");
    assert_eq!(of(protocol(), &[&[0, 30]]), scenes);
    assert_eq!(of(protocol(), &[&[0, 15, 30]]), format!("{scenes}, 3 context views"));
    assert_eq!(of(protocol(), &[&[0, 15, 30], &[0, 30]]), format!("{scenes}, 2 and 3 context views"));
    assert_eq!(of(protocol(), &[&[7]]), format!("{scenes}, 1 context view"));
    // A changed protocol fills the columns of the published one.
    let mut changed = protocol();
    changed.toml = changed.toml.replace("context-views = 2", "context-views = 3");
    assert_eq!(of(changed, &[&[0, 15, 30]]), format!("{scenes}, 3 context views"));
}

#[test]
fn labels_with_the_published_data_and_views_show_those_that_were_measured() {
    let results = results(vec![elsewhere("dl3dv-6v-256x448", "captures/desk")], vec![atsplat("atsplat", |_| ())]);
    let table = table_of("budget", &with_context(results, &[&[0, 30]]));
    assert_eq!(measured(&table).next().unwrap().labels, ["unidentified data (desk)", "16×16", "2"]);
}

/// All tables of the paper and of protocols, of stand-ins or of part of the published data: each measured row says so in
/// the visible text of each format, and LaTeX in more than its comments.
#[test]
fn every_row_that_is_not_the_published_setting_says_so() {
    let all = atsplat_protocol::Preset::names().map(preset);
    let (stand_ins, published): (Vec<_>, Vec<_>) = all.partition(|preset| preset.stands_for.is_some());
    for (presets, expected) in [(stand_ins, "simulated"), (published, " scene")] {
        let results = results(presets, paper_methods());
        let mut tables: Vec<Table> = TableDefinition::names().map(|name| table_of(name, &results)).collect();
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

            let records = csv::parse(&TableFormat::Csv.write(table).unwrap()).unwrap();
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
    let table = table_of("re10k", &results(vec![preset("rooms-2v-128")], vec![atsplat("atsplat", |_| ())]));
    let said = "Measured on simulated rooms, 16×16, 4 of 24 scenes: not comparable with the paper's numbers.";
    assert!(table.caption.ends_with(said), "{}", table.caption);
    let mut whole = preset("re10k-2v-256");
    whole.entries_of_index = whole.entries;
    let mut results = results(vec![whole], vec![atsplat("atsplat", |_| ())]);
    results.provenance.skipped.clear();
    let table = table_of("re10k", &results);
    assert!(table.caption.ends_with("Measured on RE10K, 16×16, 4 of 6474 scenes."), "{}", table.caption);
}

#[test]
fn rows_of_a_shard_say_so() {
    let [first, mut second] = two_stores("re10k-2v-256");
    second.provenance.shard = Some(atsplat_results::Shard { number: 2, count: 3 });
    let table = table_of_stores("re10k", &[&first, &second]);
    assert!(row_of(&table, "b").measured_on.as_ref().unwrap().text.ends_with(", shard 2 of 3 of the run"));
    assert!(!row_of(&table, "a").measured_on.as_ref().unwrap().text.contains("shard"));
}
