//! Chosen columns and rows.

use atsplat_results::{MethodRecord, Results};

use crate::definition::{Choice, Quantity, TableDefinition};
use crate::plot_data::table_plots;
use crate::sample::{atsplat, nearest_view, preset, results};
use crate::table::test_tables::{notes, trained};
use crate::table::{CellIndex, Mixing, NoteKind, Row, Source, Table, Value, chosen_protocol_tables, tables};

/// Two methods of one title, and a network that reproduces a row of the paper.
fn store() -> Results {
    let methods = ["a", "b"].map(|name| MethodRecord { name: name.to_owned(), ..nearest_view() });
    results(vec![preset("rooms-2v-128")], methods.into_iter().chain([atsplat("network", |_| ())]).collect())
}

fn chosen(results: &Results, choice: &Choice) -> Table {
    let definition = TableDefinition::named("re10k").unwrap().with_choice(choice);
    let sources = [Source { label: "run", results }];
    let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
    table_plots(&definition, &table, &sources);
    table
}

fn methods(table: &Table) -> Vec<&str> {
    table.rows.iter().filter(|row| !row.without_leaked).filter_map(|row| row.method.as_deref()).collect()
}

#[test]
fn columns_are_shown_in_the_order_of_the_choice() {
    let store = store();
    let columns: Vec<Quantity> = ["lpips", "psnr"].map(|id| id.parse().unwrap()).to_vec();
    let choice = Choice { columns: columns.clone(), ..Choice::default() };
    let table = chosen(&store, &choice);
    let shown: Vec<Quantity> = table.columns().map(|(_, column)| column.quantity).collect();
    assert_eq!(shown, columns);
    let paper = table.rows.iter().find(|row| row.labels == ["iLRM"]).unwrap();
    assert_eq!((&paper.cells[0][0].value, &paper.cells[0][1].value), (&Value::Number(0.110), &Value::Number(28.65)));
    let said = notes(&table, NoteKind::Choice).concat();
    assert_eq!(said, "left out by choice: columns SSIM, #Gauss., Time (s)");
    let sources = [Source { label: "run", results: &store }];
    let protocol = chosen_protocol_tables(&sources, Mixing::Apart, &choice).unwrap().swap_remove(0);
    assert_eq!(protocol.columns().map(|(_, column)| column.quantity).collect::<Vec<_>>()[..2], columns);
    assert!(notes(&protocol, NoteKind::Choice).concat().starts_with("left out by choice: columns SSIM"));
    let none = Choice { columns: vec![Quantity::InitialTokens], ..Choice::default() };
    assert!(
        !chosen(&store, &none).is_measured()
            && chosen_protocol_tables(&sources, Mixing::Apart, &none).unwrap().is_empty()
    );
}

/// Of the paper's rows, what the paper printed stays.
#[test]
fn measured_numbers_have_the_decimals_of_the_choice() {
    let store = store();
    let [psnr, ssim] = ["psnr", "ssim"].map(|id| id.parse::<Quantity>().unwrap());
    let printed = |decimals: Vec<(Quantity, usize)>| {
        let choice = Choice { decimals, against: Some("network".to_owned()), ..Choice::default() };
        let table = chosen(&store, &choice);
        let measured = table.rows.iter().find(|row| row.method.as_deref() == Some("network")).unwrap();
        let paper = table.rows.iter().find(|row| row.labels == ["iLRM"]).unwrap();
        let text = |row: &Row, column: usize| {
            let index = CellIndex { group: 0, column };
            row.cell(index).print(table.column(index))
        };
        let scores = [0, 1].map(|column| measured.cells[0][column].value.number().unwrap());
        let difference =
            table.columns().find(|(_, column)| matches!(column.quantity, Quantity::Difference(_))).unwrap();
        (scores, [0, 1].map(|column| text(measured, column)), text(paper, 0), difference.1.decimals)
    };
    let (scores, texts, paper, of_difference) = printed(vec![(ssim, 1), (psnr, 4)]);
    assert_eq!(texts, [format!("{:.4}", scores[0]), format!("{:.1}", scores[1])]);
    assert_eq!((paper.as_str(), of_difference), ("28.65", Some(4)));
    let (_, texts, paper, of_difference) = printed(Vec::new());
    assert_eq!(texts, [format!("{:.2}", scores[0]), format!("{:.3}", scores[1])]);
    assert_eq!((paper.as_str(), of_difference), ("28.65", None));
}

#[test]
fn methods_are_shown_in_the_order_of_the_choice() {
    let store = store();
    let table = chosen(&store, &Choice { methods: vec!["b".to_owned(), "a".to_owned()], ..Choice::default() });
    assert_eq!(methods(&table), ["b", "a"]);
    assert!(table.is_published());
    assert_eq!(notes(&table, NoteKind::Choice), ["left out by choice: methods network"]);
    let table = chosen(&store, &Choice { methods: vec!["run: b".to_owned()], ..Choice::default() });
    let row = table.rows.iter().find(|row| row.method.is_some()).unwrap();
    assert_eq!(
        (methods(&table), row.labels.concat().as_str()),
        (vec!["b"], "Nearest view"),
        "no name apart from its title"
    );
    let all = chosen(&store, &Choice::default());
    assert_eq!((methods(&all), notes(&all, NoteKind::Choice)), (vec!["network", "a", "b"], vec![]));
}

/// The network's row would follow that of the paper which it reproduces; its trainings come before their mean.
#[test]
fn without_the_papers_rows_all_methods_are_in_the_order_of_the_choice() {
    let store = store();
    let of = |names: &[&str], without_published| Choice {
        methods: names.iter().map(|name| (*name).to_owned()).collect(),
        without_published,
        ..Choice::default()
    };
    let table = chosen(&store, &of(&["b", "network", "a"], true));
    assert_eq!(methods(&table), ["b", "network", "a"]);
    assert!(table.rows.iter().all(|row| !row.rule_above));
    assert_eq!(methods(&chosen(&store, &of(&["b", "network", "a"], false))), ["network", "b", "a"]);
    let trainings = ["one", "two"].map(|seed| trained(seed, seed, "simulated rooms"));
    let floors = ["a", "b"].map(|name| MethodRecord { name: name.to_owned(), ..nearest_view() });
    let store = results(vec![preset("rooms-2v-128")], trainings.into_iter().chain(floors).collect());
    let table = chosen(&store, &of(&["b", "two", "one", "a"], true));
    let order: Vec<&str> = table
        .rows
        .iter()
        .filter(|row| !row.without_leaked)
        .map(|row| if row.is_over_trainings() { "mean" } else { row.method.as_deref().unwrap() })
        .collect();
    assert_eq!(order, ["b", "two", "one", "mean", "a"]);
}

#[test]
fn without_the_papers_rows_nothing_is_said_of_them() {
    let table = chosen(&store(), &Choice { without_published: true, ..Choice::default() });
    assert!(!table.is_published() && table.is_measured() && table.orders.is_empty());
    assert_eq!((methods(&table), notes(&table, NoteKind::Published)), (vec!["network", "a", "b"], vec![]));
    assert!(!table.caption.contains("the paper's numbers"), "{}", table.caption);
    assert_eq!(notes(&table, NoteKind::Choice), ["left out by choice: the paper's rows"]);
}

#[test]
fn names_of_no_method_or_of_several_are_errors_that_list_the_known_ones() {
    let store = store();
    let sources = [Source { label: "run", results: &store }];
    let said = |choice: Choice| choice.check(&sources).map_err(|error| error.to_string());
    let methods = |name: &str| said(Choice { methods: vec![name.to_owned()], ..Choice::default() });
    let against = |name: &str| said(Choice { against: Some(name.to_owned()), ..Choice::default() });
    assert_eq!(methods("c").unwrap_err(), "methods: expected one of the methods a, b, network, found \"c\"");
    assert_eq!(methods("Nearest view"), Ok(()), "both of this title");
    let of_title = "against: expected one of the methods a, b, found \"Nearest view\"";
    assert_eq!(against("Nearest view").unwrap_err(), of_title);
    for name in ["a", "run: a", "Nearest view (a)", "ATSplat"] {
        assert_eq!(against(name), Ok(()), "{name}");
    }
}

/// Each row of a name that means several networks would be compared with itself.
#[test]
fn a_name_of_several_networks_of_one_table_is_ambiguous_until_a_store_is_named() {
    let store = |weights: &str, preset_name: &str| {
        let network = MethodRecord { weights_sha256: Some(weights.to_owned()), ..atsplat("network", |_| ()) };
        results(vec![preset(preset_name)], vec![network, nearest_view()])
    };
    let (e7, e8, elsewhere) =
        (store("7777", "rooms-2v-128"), store("8888", "rooms-2v-128"), store("9999", "yards-2v-128x224"));
    let said = |stores: &[(&str, &Results)], name: &str| {
        let sources: Vec<Source<'_>> = stores.iter().map(|(label, results)| Source { label, results }).collect();
        let choice = Choice { against: Some(name.to_owned()), ..Choice::default() };
        choice.check(&sources).map_err(|error| error.to_string())
    };
    let both = [("e7", &e7), ("e8", &e8)];
    for name in ["network", "ATSplat", "ATSplat (network)"] {
        let expected = format!("against: expected one of the methods e7: network, e8: network, found {name:?}");
        assert_eq!(said(&both, name), Err(expected));
    }
    for name in ["e8: network", "e8:network", "ATSplat (e7: network)", "nearest-view"] {
        assert_eq!(said(&both, name), Ok(()), "{name}");
    }
    assert_eq!(said(&[("e7", &e7), ("again", &e7.clone())], "network"), Ok(()), "the same network");
    assert_eq!(said(&[("e7", &e7), ("e9", &elsewhere)], "network"), Ok(()), "no table has both");
}
