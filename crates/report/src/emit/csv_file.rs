use atsplat_files::csv::line;

use crate::definition::Quantity;
use crate::plot::Origin;
use crate::table::{CellIndex, CellTiming, Row, Table, Value};

/// Endings of the names of the columns that CSV has after a number.
pub(crate) const CSV_SUFFIXES: [&str; 3] = ["low", "high", "scenes"];

/// Endings of those that it also has after a time.
const TIME_SUFFIXES: [&str; 5] = ["mad", "machine", "busy", "scope", "device"];

/// The ending of the name of the column that it also has after a number if some were stated: whether this one was.
const STATED_SUFFIX: &str = "stated";

/// The ending of the name of the column that it also has after a number if a paper printed another text somewhere: that text.
const TEXT_SUFFIX: &str = "text";

/// One line per row: labels, origin, what was measured, then each number in full precision with its interval and number of
/// scenes. Times also have their median absolute deviation, the machine, whether it was busy, what the time of a process covers,
/// and what ran on a graphics adapter; a column with stated numbers is followed by which these are, and one where a paper printed
/// another text by that text. Columns have the names that they have in `eval/published`.
pub(super) fn write(table: &Table) -> String {
    let mut head: Vec<String> = table.labels.clone();
    let about = ["from", "measured_on", "published_setting", "method_id", "store"];
    head.extend(about.into_iter().chain(["untrained", "inference_only", "without_leaked"]).map(str::to_owned));
    for (index, column) in table.columns() {
        let name = &column.name;
        head.push(name.clone());
        head.extend(CSV_SUFFIXES.map(|suffix| format!("{name}_{suffix}")));
        if column.quantity == Quantity::Seconds {
            head.extend(TIME_SUFFIXES.map(|suffix| format!("{name}_{suffix}")));
        }
        head.extend(has_stated(table, index).then(|| format!("{name}_{STATED_SUFFIX}")));
        head.extend(has_text(table, index).then(|| format!("{name}_{TEXT_SUFFIX}")));
    }
    let rows = table.rows.iter().map(|row| line(&record(table, row)));
    std::iter::once(line(&head)).chain(rows).collect()
}

fn record(table: &Table, row: &Row) -> Vec<String> {
    let mut record = row.printed_labels();
    record.push(match row.origin {
        Origin::Published => "published".to_owned(),
        Origin::Measured => "measured".to_owned(),
    });
    record.push(row.measured_on.as_ref().map_or_else(String::new, |on| on.text.clone()));
    record.push(row.measured_on.as_ref().map_or_else(String::new, |on| on.published_setting.to_string()));
    record.push(row.method.clone().unwrap_or_default());
    record.push(row.store.clone().unwrap_or_default());
    record.extend([row.untrained, row.inference_only, row.without_leaked].map(|set| set.to_string()));
    for (index, column) in table.columns() {
        let cell = row.cell(index);
        record.push(match &cell.value {
            Value::Number(number) => number.to_string(),
            Value::Text(_) | Value::Absent => String::new(),
        });
        record.extend(cell.interval.map_or_else(Default::default, |ends| ends.map(|end| end.to_string())));
        record.push(cell.counts.map_or_else(String::new, |counts| counts.scenes.to_string()));
        if column.quantity == Quantity::Seconds {
            record.extend(cell.timing.as_ref().map_or_else(Default::default, about_time));
        }
        record.extend(has_stated(table, index).then(|| cell.stated.to_string()));
        record.extend(has_text(table, index).then(|| match &cell.value {
            Value::Text(text) => text.clone(),
            Value::Number(_) | Value::Absent => String::new(),
        }));
    }
    record
}

/// Whether a column has numbers that were stated.
fn has_stated(table: &Table, index: CellIndex) -> bool {
    table.rows.iter().any(|row| row.cell(index).stated)
}

/// Whether a paper printed another text than a number in a column.
fn has_text(table: &Table, index: CellIndex) -> bool {
    table.rows.iter().any(|row| matches!(row.cell(index).value, Value::Text(_)))
}

/// What follows a time, in the order of [`TIME_SUFFIXES`].
fn about_time(timing: &CellTiming) -> [String; TIME_SUFFIXES.len()] {
    let scope = timing.scope.map_or_else(String::new, |scope| scope.remark().to_owned());
    let device = timing.device.clone().unwrap_or_default();
    // A time that was stated is a single number.
    let mad = if timing.machine.is_stated() { String::new() } else { timing.spread.mad.to_string() };
    [mad, timing.machine.to_string(), timing.busy.to_string(), scope, device]
}
