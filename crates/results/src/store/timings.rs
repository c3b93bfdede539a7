//! [`TimingRow`]s as a separate table.
//!
//! The table is small and rewritten whenever a method has been timed under a protocol. Stores of schema version 1 have none:
//! their times were measured while other trials ran and are not read.

use std::collections::BTreeSet;
use std::path::Path;

use super::columns::Columns;
use super::hashes::{NewTable, TableHashes};
use super::schema::Schema;
use super::table::{self, Table};
use super::{SCHEMA_VERSION, Store};
use crate::times::{Load, Machine, TimingRow, merged};
use crate::{ResultsError, TrialKey};

pub(super) const TIMINGS: &str = "timings.parquet";

impl Store {
    /// The store's timing rows.
    ///
    /// # Errors
    /// Those of [`crate::Results::read`].
    ///
    /// # Panics
    /// Never: the newest version has a schema.
    #[expect(clippy::expect_used, reason = "tests parse every committed schema")]
    pub fn timings(&self) -> Result<Vec<TimingRow>, ResultsError> {
        let schema = Schema::of_version(SCHEMA_VERSION).expect("the newest version has a schema");
        let hashes = self.recorded().hashes.clone();
        read(&self.folder, &schema, &hashes)
    }

    /// Adds timing rows, which replace those of the same methods on the same machine. Times stay where the new row of the trial has
    /// none, and where none of the method's new rows has any: what failed may have lacked memory for a while. Returns the rows that
    /// were left out for that.
    ///
    /// # Errors
    /// [`ResultsError::NotFinite`] before anything is written, [`ResultsError::Io`].
    pub fn add_timings(&self, rows: Vec<TimingRow>) -> Result<Vec<TimingRow>, ResultsError> {
        let subject = |row: &TimingRow| (row.key.preset.clone(), row.key.method.clone(), row.machine.clone());
        let replaced: BTreeSet<_> = rows.iter().map(subject).collect();
        let timed: BTreeSet<_> = rows.iter().filter(|row| row.is_timed()).map(subject).collect();
        let is_failure_of = |row: &TimingRow, known: &TimingRow| {
            let trial = |row: &TimingRow| (row.key.clone(), row.trial_hash.clone(), row.machine.clone());
            !row.is_timed() && known.is_timed() && trial(row) == trial(known)
        };
        let mut all = self.timings()?;
        all.retain(|known| {
            let stays = || !timed.contains(&subject(known)) || rows.iter().any(|row| is_failure_of(row, known));
            !replaced.contains(&subject(known)) || (known.is_timed() && stays())
        });
        let (left_out, added): (Vec<_>, Vec<_>) =
            rows.into_iter().partition(|row| all.iter().any(|known| is_failure_of(row, known)));
        all.extend(added);
        let all = merged(all)?;
        let table = encoded(&self.folder, &all)?;
        self.record_command()?;
        self.replace_tables(&[table])?;
        Ok(left_out)
    }

    /// Removes the times of one result, on every machine. Not to be called by two threads at once.
    ///
    /// # Errors
    /// Those of [`Self::timings`], and [`ResultsError::Io`].
    pub fn remove_timings(&self, key: &TrialKey) -> Result<(), ResultsError> {
        let mut rows = self.timings()?;
        rows.retain(|row| row.key != *key);
        self.replace_tables(&[encoded(&self.folder, &rows)?])
    }
}

pub(super) fn encoded(folder: &Path, rows: &[TimingRow]) -> Result<NewTable, ResultsError> {
    rows.iter().try_for_each(TimingRow::check)?;
    Ok((TIMINGS, Some(table::encoded(&folder.join(TIMINGS), columns(rows).frame())?)))
}

/// The rows of a store; none if its version has no such table or nothing was timed.
pub(super) fn read(folder: &Path, schema: &Schema, hashes: &TableHashes) -> Result<Vec<TimingRow>, ResultsError> {
    if schema.timings.is_empty() {
        return Ok(Vec::new());
    }
    let path = folder.join(TIMINGS);
    Table::read(&path, &schema.timings, hashes)?.map_or_else(|| Ok(Vec::new()), |table| rows(&table))
}

pub(super) fn columns(rows: &[TimingRow]) -> Columns<'_, TimingRow> {
    Columns::of(rows, |row| &row.key)
        .text("trial-hash", |row| &row.trial_hash)
        .text("processor", |row| &row.machine.processor)
        .text("platform", |row| &row.machine.platform)
        .count("cpus", |row| row.machine.cpus.into())
        .count("threads", |row| row.machine.threads.into())
        .optional_text("network-adapter", |row| row.network_adapter.as_deref())
        .optional_text("renderer-adapter", |row| row.renderer_adapter.as_deref())
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

fn rows(table: &Table<'_>) -> Result<Vec<TimingRow>, ResultsError> {
    table.rows(|row| {
        let (names, samples) = (row.texts("stages")?, row.numbers("stage-samples")?);
        // Every stage has the same number of repetitions; without stages there are no samples.
        let each = samples.len().checked_div(names.len()).unwrap_or(0);
        if each * names.len() != samples.len() {
            let expected = format!("the same number for each of {} stages", names.len());
            return Err(row.invalid("stage-samples", &expected, samples.len()));
        }
        Ok(TimingRow {
            key: row.key()?,
            trial_hash: row.text("trial-hash")?,
            machine: Machine {
                processor: row.text("processor")?,
                platform: row.text("platform")?,
                cpus: row.small_count("cpus")?,
                threads: row.small_count("threads")?,
            },
            network_adapter: row.optional_text("network-adapter"),
            renderer_adapter: row.optional_text("renderer-adapter"),
            started: row.count("started")?,
            trials_there: row.count("trials-there")?,
            warm_up: row.small_count("warm-up")?,
            encode: row.numbers("encode-samples")?,
            render: row.numbers("render-samples")?,
            stages: names.into_iter().zip(samples.chunks(each.max(1)).map(<[f64]>::to_vec)).collect(),
            held_bytes: row.optional_count("held-bytes"),
            peak_bytes: row.optional_count("peak-bytes"),
            load: Load {
                average_before: row.optional_number("load-before"),
                average_after: row.optional_number("load-after"),
                mhz_before: row.optional_number("mhz-before"),
                mhz_after: row.optional_number("mhz-after"),
                others: row.optional_number("others"),
            },
            detail: row.optional_text("detail"),
        })
    })
}
