//! Times of methods, in this process or a separate one.

use std::collections::BTreeMap;

use atsplat_files::csv;
use atsplat_numeric::Tolerance;
use atsplat_results::Results;

use crate::definition::Quantity;
use crate::emit::TableFormat;
use crate::sample::store;
use crate::table::test_tables::{row_of, table_of};
use crate::table::{Cell, Mark, Table, TimeScope};

/// The sample store with its first method as a process, changed further.
fn with_process(change: impl FnOnce(&mut Results)) -> Table {
    let mut results = store();
    results.provenance.methods[0].kind = "exec".to_owned();
    change(&mut results);
    table_of("re10k", &results)
}

fn time(table: &Table) -> (String, Cell) {
    let (index, column) = table.columns().find(|(_, column)| column.quantity == Quantity::Seconds).unwrap();
    let cell = row_of(table, "atsplat").cell(index);
    (cell.print(column), cell.clone())
}

fn notes(table: &Table) -> Vec<&str> {
    table.footer.iter().map(|note| note.text.as_str()).collect()
}

/// Answers take 0.25, 0.26 and 0.27 s; of that, the process says, its encoder takes 0.004, 0.005 and 0.006 s.
fn state_encoders(results: &mut Results) {
    for (row, secs) in
        results.timings.iter_mut().filter(|row| row.key.method == "atsplat").zip([0.004, 0.005, 0.006].iter().cycle())
    {
        row.stages = BTreeMap::from([("encode".to_owned(), vec![*secs; 5]), ("read".to_owned(), vec![0.2; 5])]);
    }
}

#[test]
fn the_time_of_a_process_is_that_of_its_encoder_where_it_states_one() {
    let table = with_process(state_encoders);
    let (printed, cell) = time(&table);
    assert_eq!((printed.as_str(), cell.time_scope()), ("0.005 †", Some(TimeScope::Stated)));
    Tolerance::EXACT.assert([cell.value.number().unwrap()], [0.005], "the median of what is stated");
    assert!(notes(&table).contains(&"† as the method states"), "{:?}", notes(&table));
    assert!(notes(&table).iter().any(|note| note.starts_with("time, ATSplat: median 0.0050 s")), "{:?}", notes(&table));
    assert_eq!(serde_json::to_value(&cell).unwrap()["timing"]["scope"], "as the method states");
}

/// It took 4.8 µs, with a deviation of 0.3 µs.
#[test]
fn a_time_below_half_a_millisecond_has_digits() {
    let table = with_process(|results| {
        for row in results.timings.iter_mut().filter(|row| row.key.method == "atsplat") {
            row.stages = BTreeMap::from([("encode".to_owned(), vec![4.5e-6, 4.6e-6, 4.8e-6, 5.1e-6, 9.9e-6])]);
        }
    });
    assert_eq!(time(&table).0, "0.00000480 †");
    let start = "time, ATSplat: median 0.00000480 s, MAD 0.00000030, quartiles 0.0000046";
    assert!(notes(&table).iter().any(|note| note.starts_with(start)), "{:?}", notes(&table));
}

#[test]
fn the_time_of_a_process_is_the_whole_answer_unless_every_trial_states_its_encoder() {
    let one_is_silent = |results: &mut Results| {
        state_encoders(results);
        results.timings.iter_mut().find(|row| row.key.method == "atsplat").unwrap().stages.clear();
    };
    for table in [with_process(|_| ()), with_process(one_is_silent)] {
        let (printed, cell) = time(&table);
        assert_eq!((printed.as_str(), cell.time_scope()), ("0.260 ‡", Some(TimeScope::WholeAnswer)));
        let notes = notes(&table);
        assert!(notes.contains(&"‡ the whole answer, with reading and writing of files"), "{notes:?}");
        assert!(!notes.iter().any(|note| note.contains('†')), "{notes:?}");
    }
}

/// Both methods of the store that encode are timed; the second, within this process, on a card.
#[test]
fn files_say_what_times_cover_and_on_which_device() {
    let table = with_process(|results| {
        state_encoders(results);
        let others = results.timings.iter_mut().filter(|row| row.key.method == "nearest-view");
        others.for_each(|row| {
            (row.encode, row.stages) = (vec![0.5; 5], [].into());
            row.network_adapter = Some("card".to_owned());
        });
    });
    let latex = TableFormat::Latex.write(&table).unwrap();
    let printed: Vec<&str> = latex.lines().filter(|line| !line.starts_with('%')).collect();
    let explained = "$^\\dagger$ as the method states";
    assert!(printed.iter().any(|line| line.contains(explained)), "{latex}");
    assert!(!latex.lines().any(|line| line.starts_with('%') && line.contains('†')), "{latex}");
    let records = csv::parse(&TableFormat::Csv.write(&table).unwrap()).unwrap();
    let at = |name: &str| records[0].iter().position(|head| head == name).unwrap_or_else(|| panic!("{:?}", records[0]));
    let of = |method: &str| {
        let record = records.iter().find(|record| record[at("method_id")] == method).unwrap();
        ["seconds_busy", "seconds_scope", "seconds_device"].map(|name| record[at(name)].as_str())
    };
    assert_eq!(of("atsplat"), ["false", "as the method states", ""]);
    assert_eq!(of("nearest-view"), ["false", "", "network on card"]);
}

/// A network that runs in this process is timed while it encodes, whatever its stages are called.
#[test]
fn times_of_other_methods_have_no_remark() {
    let table = with_process(|results| {
        results.provenance.methods[0].kind = "atsplat".to_owned();
        state_encoders(results);
    });
    let (printed, cell) = time(&table);
    assert_eq!((printed.as_str(), cell.time_scope()), ("0.260", None));
    assert!(!notes(&table).iter().any(|note| note.contains(['†', '‡'])), "{:?}", notes(&table));
}

#[test]
fn a_busy_machine_is_marked_too() {
    let table = with_process(|results| results.timings.iter_mut().for_each(|row| row.load.others = Some(0.4)));
    assert_eq!(time(&table).0, "0.260 ‡ §");
}

#[test]
fn times_come_from_the_timing_pass_or_are_absent_with_a_reason() {
    let time = |results: &Results, method: &str| {
        let table = table_of("re10k", results);
        let (index, column) = table.columns().find(|(_, column)| column.quantity == Quantity::Seconds).unwrap();
        let cell = row_of(&table, method).cell(index).clone();
        let notes: Vec<String> = table.footer.iter().map(|note| note.text.clone()).collect();
        (cell.print(column), cell, notes.join("\n"))
    };
    let mut results = store();
    let (printed, cell, notes) = time(&results, "atsplat");
    let timing = cell.timing.unwrap();
    assert_eq!((printed.as_str(), timing.spread.samples, timing.trials, timing.repetitions), ("0.260", 15, 3, 5));
    assert!(notes.contains("MAD 0.00") && notes.contains("5 repetitions of 3 trials"), "{notes}");
    assert!(notes.contains("Time: a processor, 2 threads on 2 logical processors") && !notes.contains('§'), "{notes}");
    let (printed, _, notes) = time(&results, "nearest-view");
    assert_eq!(printed, "n/c");
    assert!(notes.contains("makes no Gaussians from images"), "{notes}");

    results.timings.iter_mut().for_each(|row| row.network_adapter = Some("a card (Vulkan), driver 1".to_owned()));
    let (_, _, on_card) = time(&results, "atsplat");
    let of_card: Vec<&str> = on_card.lines().filter(|line| line.contains("network on a card")).collect();
    let expected = "Time of ATSplat; ATSplat, leaked targets excluded";
    assert!(of_card.len() == 1 && of_card[0].starts_with(expected), "one for all rows: {on_card}");
    assert!(of_card[0].ends_with(": network on a card (Vulkan), driver 1"), "{on_card}");
    assert!(!notes.contains("Time of"), "{notes}");
    results.timings.iter_mut().for_each(|row| row.network_adapter = None);

    results.timings.iter_mut().for_each(|row| row.load.others = Some(0.4));
    let (printed, cell, notes) = time(&results, "atsplat");
    assert_eq!((printed.as_str(), cell.mark), ("0.260 §", Mark::Plain));
    assert!(notes.contains("§ other work or a quota took 40 % of the processors"), "{notes}");
    assert_eq!(serde_json::to_value(&cell).unwrap()["timing"]["busy"], true);

    results.timings.clear();
    let (printed, cell, notes) = time(&results, "atsplat");
    assert_eq!((printed.as_str(), cell.value.number()), ("n/c", None));
    assert!(notes.contains("`atsplat run --timing` makes one"), "{notes}");
}
