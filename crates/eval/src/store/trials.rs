//! [`TrialRow`]s as a table.

use super::columns::Columns;
use super::table::Table;
use crate::{EvalError, TrialKey, TrialRow, TrialStatus};

pub(super) fn columns(rows: &[TrialRow]) -> Columns<'_, TrialRow> {
    Columns::of(rows, |row| &row.key)
        .text("trial-hash", |row| &row.trial_hash)
        .text("pose-hash", |row| &row.pose_hash)
        .optional_text("data-hash", |row| row.data_hash.as_deref())
        .optional_text("input-hash", |row| row.input_hash.as_deref())
        .text("status", |row| row.status.name())
        .optional_text("detail", |row| row.detail.as_deref())
        .counts("context", |row| &row.context)
        .count("targets", |row| row.targets.into())
        .optional_number("overlap", |row| row.overlap)
        .count("width", |row| row.width.into())
        .count("height", |row| row.height.into())
        .optional_count("initial-tokens", |row| row.initial_tokens)
        .optional_count("final-tokens", |row| row.final_tokens)
        .optional_count("gaussians", |row| row.gaussians)
        .optional_number("gaussians-drawn", |row| row.gaussians_drawn)
        .optional_count("peak-bytes", |row| row.peak_bytes)
        .texts("effects", |row| row.effects.iter().map(String::as_str).collect())
        .texts("notes", |row| row.notes.iter().map(String::as_str).collect())
        .texts("context-hashes", |row| row.context_hashes.iter().map(String::as_str).collect())
}

pub(super) fn rows(table: &Table<'_>) -> Result<Vec<TrialRow>, EvalError> {
    let keys = keys(table)?;
    let texts = ["trial-hash", "pose-hash", "data-hash", "input-hash", "status", "detail"];
    let [hash, pose, data, input, status, detail] = texts.map(|name| table.texts_of(name));
    let mut context = table.lists_of_counts("context")?;
    let [targets, width, height] = ["targets", "width", "height"].map(|name| table.counts_of(name));
    let counts = ["initial-tokens", "final-tokens", "gaussians", "peak-bytes"].map(|name| table.counts_of(name));
    let numbers = ["overlap", "gaussians-drawn"].map(|name| table.numbers_of(name));
    let [effects, notes, context_hashes] =
        ["effects", "notes", "context-hashes"].map(|name| table.lists_of_texts(name));
    let mut texts = [effects?, notes?, context_hashes?];
    let mut rows = Vec::with_capacity(keys.len());
    for (at, key) in keys.into_iter().enumerate() {
        let small = |name, values: &[Option<u64>]| small(table, name, at, values);
        let [initial_tokens, final_tokens, gaussians, peak_bytes] = counts.each_ref().map(|values| value(values, at));
        let [overlap, gaussians_drawn] = numbers.each_ref().map(|values| value(values, at));
        let [effects, notes, context_hashes] = texts.each_mut().map(|lists| taken(lists, at));
        let name = needed(table, "status", at, &status)?;
        let status = TrialStatus::named(&name)
            .ok_or_else(|| table.wrong("status", at, "the name of a trial's status", &name))?;
        rows.push(TrialRow {
            key,
            trial_hash: needed(table, "trial-hash", at, &hash)?,
            pose_hash: needed(table, "pose-hash", at, &pose)?,
            data_hash: value(&data, at),
            input_hash: value(&input, at),
            status,
            detail: value(&detail, at),
            context: taken(&mut context, at),
            context_hashes,
            targets: small("targets", &targets)?,
            overlap,
            width: small("width", &width)?,
            height: small("height", &height)?,
            initial_tokens,
            final_tokens,
            gaussians,
            gaussians_drawn,
            peak_bytes,
            effects,
            notes,
        });
    }
    Ok(rows)
}

/// The key of every row.
pub(super) fn keys(table: &Table<'_>) -> Result<Vec<TrialKey>, EvalError> {
    let [presets, methods, scenes] = ["preset", "method", "scene"].map(|name| table.texts_of(name));
    let entries = table.counts_of("entry");
    let key = |at| {
        Ok(TrialKey {
            preset: needed(table, "preset", at, &presets)?,
            method: needed(table, "method", at, &methods)?,
            scene: needed(table, "scene", at, &scenes)?,
            entry: small(table, "entry", at, &entries)?,
        })
    };
    (0..table.rows()).map(key).collect()
}

/// A count below 2³².
pub(super) fn small(table: &Table<'_>, name: &str, at: usize, values: &[Option<u64>]) -> Result<u32, EvalError> {
    let count = needed(table, name, at, values)?;
    u32::try_from(count).map_err(|_too_large| table.wrong(name, at, "a count below 2³²", count))
}

pub(super) fn value<T: Clone>(values: &[Option<T>], at: usize) -> Option<T> {
    values.get(at).cloned().flatten()
}

/// A value that must not be null.
pub(super) fn needed<T: Clone>(table: &Table<'_>, name: &str, at: usize, values: &[Option<T>]) -> Result<T, EvalError> {
    value(values, at).ok_or_else(|| table.wrong(name, at, "a value", "none"))
}

#[expect(clippy::expect_used, reason = "every row has a list")]
pub(super) fn taken<T>(lists: &mut [Vec<T>], at: usize) -> Vec<T> {
    lists.get_mut(at).map(std::mem::take).expect("a list for each row")
}

/// Zips two lists of one row, which must be of equal length.
pub(super) fn pairs<A, B>(
    table: &Table<'_>,
    (name, first): (&str, Vec<A>),
    second: Vec<B>,
    at: usize,
) -> Result<impl Iterator<Item = (A, B)>, EvalError> {
    if first.len() == second.len() {
        return Ok(first.into_iter().zip(second));
    }
    Err(table.wrong(name, at, &format!("{} entries, as in the list paired with it", second.len()), first.len()))
}
