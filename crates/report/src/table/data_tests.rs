//! What rows say about their data and context views.

use atsplat_results::{PresetRecord, Results};

use super::statement_tests::{built, measured, notes, trained};
use super::*;
use crate::definition::Choice;
use crate::emit::TableFormat;
use crate::sample::{SCENES, UNKNOWN_HASH, atsplat, floor, preset, results};

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
        let results = results(vec![elsewhere(protocol, data)], vec![floor()]);
        let table = built(table, &results);
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
    let table = built("dl3dv", &results);
    assert_eq!(said(&table), "simulated rooms, 16×16, 4 of 24 scenes, 2 context views, unpublished index");
    let is_zero_shot = |table: &Table| {
        let remarks = &measured(table).next().unwrap().remarks;
        remarks.iter().any(|remark| remark.starts_with("zero-shot"))
    };
    assert!(!is_zero_shot(&table), "it was trained on rooms");
    results.trials[1].key.scene = "mine".to_owned();
    let table = built("dl3dv", &results);
    assert!(said(&table).starts_with("unidentified data (rooms150/test), 16×16, "), "{}", said(&table));
    assert!(is_zero_shot(&table));
}

#[test]
fn a_published_index_names_its_dataset_under_any_protocol() {
    let index_sha256 = preset("acid-2v-256").index_sha256;
    let record = PresetRecord { index_sha256, ..elsewhere("re10k-2v-256", "data/re10k") };
    let table = built("re10k", &results(vec![record], vec![floor()]));
    assert_eq!(said(&table), "ACID, 16×16, all 4 scenes, unpublished index");
}

/// The own index of a protocol is no published one, whatever the protocol calls its data.
#[test]
fn an_index_with_fewer_views_is_of_the_published_ones_dataset_and_an_own_one_is_not() {
    let of = |name: Option<&str>, reduced_from: Option<&str>| {
        let [index_name, reduced_from] = [name, reduced_from].map(|name| name.map(str::to_owned));
        let record = PresetRecord { index_name, reduced_from, ..elsewhere("dl3dv-12v-512x960", "data/dl3dv") };
        let results = with_context(results(vec![record], vec![floor()]), &[&[0, 30]]);
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
        said(&built("re10k", &with_context(results(vec![record], vec![floor()]), contexts))).to_owned()
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
    let table = built("budget", &with_context(results, &[&[0, 30]]));
    assert_eq!(measured(&table).next().unwrap().labels, ["unidentified data (desk)", "16×16", "2"]);
}

/// A network at another resolution has other tokens and Gaussians: the table says at which, in words of older stores too.
#[test]
fn a_network_that_saw_resized_images_says_so() {
    let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), floor()]);
    let resized = |results: &Results| {
        let table = built("re10k", results);
        notes(&table, NoteKind::Setting)
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
