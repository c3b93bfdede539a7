//! [`TargetRow`]s as a table, with a column for each metric, null where it was not computed.

use atsplat_metrics::definitions;

use super::columns::Columns;
use super::table::Table;
use super::trials::{keys, needed, pairs, small, taken, value};
use crate::{EvalError, TargetRow, TargetStatus};

pub(super) fn columns(rows: &[TargetRow]) -> Columns<'_, TargetRow> {
    let fixed = Columns::of(rows, |row| &row.key)
        .count("target", |row| row.target.into())
        .count("frame", |row| row.frame)
        .integer("signed-distance", |row| row.signed_distance)
        .flag("leaked", |row| row.leaked)
        .optional_number("overlap", |row| row.overlap)
        .count("width", |row| row.width.into())
        .count("height", |row| row.height.into())
        .optional_text("truth-hash", |row| row.truth_hash.as_deref())
        .optional_text("render-hash", |row| row.render_hash.as_deref())
        .text("status", |row| row.status.name())
        .optional_text("detail", |row| row.detail.as_deref())
        .count("non-finite", |row| row.non_finite)
        .texts("not-computed", |row| row.not_computed.keys().map(String::as_str).collect())
        .texts("not-computed-why", |row| row.not_computed.values().map(String::as_str).collect());
    definitions().iter().fold(fixed, |columns, metric| {
        columns.optional_number(metric.id, |row: &TargetRow| row.scores.get(metric.id).copied())
    })
}

pub(super) fn rows(table: &Table<'_>) -> Result<Vec<TargetRow>, EvalError> {
    let keys = keys(table)?;
    let [truth, render, status, detail] =
        ["truth-hash", "render-hash", "status", "detail"].map(|name| table.texts_of(name));
    let [target, frame, width, height, non_finite] =
        ["target", "frame", "width", "height", "non-finite"].map(|name| table.counts_of(name));
    let overlap = table.numbers_of("overlap");
    let (distance, leaked) = (table.integers_of("signed-distance"), table.flags_of("leaked"));
    let [mut ids, mut reasons] = [table.lists_of_texts("not-computed")?, table.lists_of_texts("not-computed-why")?];
    let scores: Vec<_> = definitions().iter().map(|metric| (metric.id, table.numbers_of(metric.id))).collect();
    let mut rows = Vec::with_capacity(keys.len());
    for (at, key) in keys.into_iter().enumerate() {
        let small = |name, values: &[Option<u64>]| small(table, name, at, values);
        let name = needed(table, "status", at, &status)?;
        let status = TargetStatus::named(&name)
            .ok_or_else(|| table.wrong("status", at, "the name of a target's status", &name))?;
        let score = |(id, values): &(&str, Vec<Option<f64>>)| Some(((*id).to_owned(), value(values, at)?));
        rows.push(TargetRow {
            key,
            target: small("target", &target)?,
            frame: needed(table, "frame", at, &frame)?,
            signed_distance: needed(table, "signed-distance", at, &distance)?,
            leaked: needed(table, "leaked", at, &leaked)?,
            overlap: value(&overlap, at),
            width: small("width", &width)?,
            height: small("height", &height)?,
            truth_hash: value(&truth, at),
            render_hash: value(&render, at),
            status,
            detail: value(&detail, at),
            non_finite: needed(table, "non-finite", at, &non_finite)?,
            scores: scores.iter().filter_map(score).collect(),
            not_computed: pairs(table, ("not-computed", taken(&mut ids, at)), taken(&mut reasons, at), at)?.collect(),
        });
    }
    Ok(rows)
}
