//! Machines and devices of times, their spread and their marks.

use atsplat_numeric::{decimals_of_small, distinct, grouped};

use super::Notes;
use crate::counted;
use crate::numbers::fixed;
use crate::table::content::was_busy;
use crate::table::{BUSY, Cell, CellTiming, NoteKind, Row, Table};

impl Notes {
    /// Machines, what the marks of times mean, devices, then each time with its spread, and why some are unreliable.
    pub(super) fn times(&mut self, table: &Table) {
        let machines =
            table.rows.iter().flat_map(|row| timings(row).map(move |timing| (&timing.machine, row.printed_name())));
        for (machine, names) in grouped(machines) {
            let text = if machine.is_stated() {
                format!("Time of {}: {machine}", distinct(names).join("; "))
            } else {
                format!("Time: {machine}; separate timing pass, nothing else running in the process")
            };
            self.add(NoteKind::Machine, text);
        }
        for scope in table.rows.iter().flat_map(|row| row.cells.iter().flatten()).filter_map(Cell::time_scope) {
            self.add(NoteKind::TimeScope, scope.explained());
        }
        let devices = |row: &Row| {
            let devices = distinct(timings(row).filter_map(|timing| timing.device.clone()));
            devices.into_iter().map(|device| (device, row.printed_name())).collect::<Vec<_>>()
        };
        let devices = table.rows.iter().flat_map(devices);
        for (device, names) in grouped(devices) {
            self.add(NoteKind::Machine, format!("Time of {}: {device}", distinct(names).join("; ")));
        }
        for row in &table.rows {
            for timing in timings(row).filter(|timing| !timing.machine.is_stated()) {
                self.add(NoteKind::Interval, spread(&row.printed_name(), timing));
            }
        }
        let busy = table.rows.iter().flat_map(timings).filter(|timing| timing.busy);
        if let Some(others) = busy.filter_map(|timing| timing.others).max_by(f64::total_cmp) {
            let why = was_busy(others);
            self.add(NoteKind::Busy, format!("{BUSY} {why}: such times are unreliable and not ranked"));
        }
    }
}

fn timings(row: &Row) -> impl Iterator<Item = &CellTiming> {
    row.cells.iter().flatten().filter_map(|cell| cell.timing.as_ref())
}

fn spread(name: &str, timing: &CellTiming) -> String {
    let CellTiming { spread, trials, trials_there, repetitions, warm_up, .. } = timing;
    let decimals = decimals_of_small(spread.median, 4);
    let [low, high] = spread.quartiles;
    let [median, mad, low, high] = [spread.median, spread.mad, low, high].map(|secs| fixed(secs, decimals));
    let all = if trials == trials_there && *trials < 3 { " (all)" } else { "" };
    format!(
        "time, {name}: median {median} s, MAD {mad}, quartiles {low} to {high}, averaged over trials; {repetitions} repetitions \
         of {}{all}, {warm_up} warm-up",
        counted(*trials, "trial"),
    )
}
