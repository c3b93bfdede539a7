//! [`TimingRow`]s as a table of their own.
//!
//! The table is small and rewritten whenever a protocol has been timed. Stores of schema version 1 have none: their times
//! were measured while other trials ran and are not read.

use std::collections::BTreeSet;
use std::path::Path;

use super::columns::Columns;
use super::schema::Schema;
use super::table::{self, Table};
use super::trials::{keys, needed, small, taken, value};
use super::{SCHEMA_VERSION, Store};
use crate::EvalError;
use crate::timing::{Load, Machine, TimingRow, merged};

const TIMINGS: &str = "timings.parquet";

impl Store {
    /// The store's timing rows.
    ///
    /// # Errors
    /// As [`crate::Results::read`].
    #[expect(clippy::expect_used, reason = "tests parse every committed schema")]
    pub fn timings(&self) -> Result<Vec<TimingRow>, EvalError> {
        read(&self.folder, &Schema::of_version(SCHEMA_VERSION).expect("the newest version has a schema"))
    }

    /// Adds timing rows, which replace those of the same methods on the same machine.
    ///
    /// # Errors
    /// [`EvalError::NotFinite`] before anything is written, [`EvalError::Io`].
    pub fn add_timings(&self, rows: Vec<TimingRow>) -> Result<(), EvalError> {
        let subject = |row: &TimingRow| (row.key.preset.clone(), row.key.method.clone(), row.machine.clone());
        let replaced: BTreeSet<_> = rows.iter().map(subject).collect();
        let mut all = self.timings()?;
        all.retain(|row| !replaced.contains(&subject(row)));
        all.extend(rows);
        write(&self.folder, &merged(all)?)
    }
}

pub(super) fn write(folder: &Path, rows: &[TimingRow]) -> Result<(), EvalError> {
    rows.iter().try_for_each(TimingRow::check)?;
    table::write(&folder.join(TIMINGS), columns(rows).frame())
}

/// The rows of a store; none if its version has no such table or nothing was timed.
pub(super) fn read(folder: &Path, schema: &Schema) -> Result<Vec<TimingRow>, EvalError> {
    if schema.timings.is_empty() {
        return Ok(Vec::new());
    }
    Table::read(&folder.join(TIMINGS), &schema.timings)?.map_or_else(|| Ok(Vec::new()), |table| rows(&table))
}

pub(super) fn columns(rows: &[TimingRow]) -> Columns<'_, TimingRow> {
    Columns::of(rows, |row| &row.key)
        .text("trial-hash", |row| &row.trial_hash)
        .text("processor", |row| &row.machine.processor)
        .text("platform", |row| &row.machine.platform)
        .count("cpus", |row| row.machine.cpus.into())
        .count("threads", |row| row.machine.threads.into())
        .count("started", |row| row.started)
        .count("trials-there", |row| row.trials_there)
        .count("warm-up", |row| row.warm_up.into())
        .numbers("encode-samples", |row| row.encode.clone())
        .numbers("render-samples", |row| row.render.clone())
        .texts("stages", |row| row.stages.keys().map(String::as_str).collect())
        .numbers("stage-samples", |row| row.stages.values().flatten().copied().collect())
        .optional_count("held-bytes", |row| row.held_bytes)
        .optional_count("peak-bytes", |row| row.peak_bytes)
        .optional_number("load-before", |row| row.load.average_before)
        .optional_number("load-after", |row| row.load.average_after)
        .optional_number("mhz-before", |row| row.load.mhz_before)
        .optional_number("mhz-after", |row| row.load.mhz_after)
        .optional_number("others", |row| row.load.others)
        .optional_text("detail", |row| row.detail.as_deref())
}

fn rows(table: &Table<'_>) -> Result<Vec<TimingRow>, EvalError> {
    let keys = keys(table)?;
    let [hash, processor, platform, detail] =
        ["trial-hash", "processor", "platform", "detail"].map(|name| table.texts_of(name));
    let [cpus, threads, warm_up] = ["cpus", "threads", "warm-up"].map(|name| table.counts_of(name));
    let [started, there] = ["started", "trials-there"].map(|name| table.counts_of(name));
    let [held, peak] = ["held-bytes", "peak-bytes"].map(|name| table.counts_of(name));
    let loads = ["load-before", "load-after", "mhz-before", "mhz-after", "others"].map(|name| table.numbers_of(name));
    let [encode, render, of_stages] =
        ["encode-samples", "render-samples", "stage-samples"].map(|name| table.lists_of_numbers(name));
    let mut samples = [encode?, render?, of_stages?];
    let mut stages = table.lists_of_texts("stages")?;
    let mut rows = Vec::with_capacity(keys.len());
    for (at, key) in keys.into_iter().enumerate() {
        let small = |name, values: &[Option<u64>]| small(table, name, at, values);
        let [encode, render, of_stages] = samples.each_mut().map(|lists| taken(lists, at));
        let names = taken(&mut stages, at);
        // Every stage has the same number of repetitions; without stages there are no samples.
        let each = of_stages.len().checked_div(names.len()).unwrap_or(0);
        if each * names.len() != of_stages.len() {
            let expected = format!("the same number for each of {} stages", names.len());
            return Err(table.wrong("stage-samples", at, &expected, of_stages.len()));
        }
        let stages = names.into_iter().zip(of_stages.chunks(each.max(1)).map(<[f64]>::to_vec)).collect();
        let [average_before, average_after, mhz_before, mhz_after, others] =
            loads.each_ref().map(|values| value(values, at));
        rows.push(TimingRow {
            key,
            trial_hash: needed(table, "trial-hash", at, &hash)?,
            machine: Machine {
                processor: needed(table, "processor", at, &processor)?,
                platform: needed(table, "platform", at, &platform)?,
                cpus: small("cpus", &cpus)?,
                threads: small("threads", &threads)?,
            },
            started: needed(table, "started", at, &started)?,
            trials_there: needed(table, "trials-there", at, &there)?,
            warm_up: small("warm-up", &warm_up)?,
            encode,
            render,
            stages,
            held_bytes: value(&held, at),
            peak_bytes: value(&peak, at),
            load: Load { average_before, average_after, mhz_before, mhz_after, others },
            detail: value(&detail, at),
        });
    }
    Ok(rows)
}
