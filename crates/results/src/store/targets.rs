//! [`TargetRow`]s as a table, with a column for each metric, null where it was not computed.

use atsplat_metrics::definitions;

use super::columns::Columns;
use super::table::Table;
use crate::{ResultsError, TargetRow, TargetStatus};

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

pub(super) fn rows(table: &Table<'_>) -> Result<Vec<TargetRow>, ResultsError> {
    table.rows(|row| {
        let score = |id: &str| Some((id.to_owned(), row.optional_number(id)?));
        let (ids, reasons) = (row.texts("not-computed")?, row.texts("not-computed-why")?);
        if ids.len() != reasons.len() {
            let expected = format!("{} entries, one for each reason", reasons.len());
            return Err(row.invalid("not-computed", &expected, ids.len()));
        }
        let target = TargetRow {
            key: row.key()?,
            target: row.small_count("target")?,
            frame: row.count("frame")?,
            signed_distance: row.integer("signed-distance")?,
            leaked: row.flag("leaked")?,
            overlap: row.optional_number("overlap"),
            width: row.small_count("width")?,
            height: row.small_count("height")?,
            truth_hash: row.optional_text("truth-hash"),
            render_hash: row.optional_text("render-hash"),
            status: row.named("status", "the name of a target's status", TargetStatus::named)?,
            detail: row.optional_text("detail"),
            non_finite: row.count("non-finite")?,
            scores: definitions().iter().filter_map(|metric| score(metric.id)).collect(),
            not_computed: ids.into_iter().zip(reasons).collect(),
        };
        row.possible(target.impossible()).map(|()| target)
    })
}
