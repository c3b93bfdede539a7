//! [`TrialRow`]s as a table.

use super::columns::Columns;
use super::table::Table;
use crate::{ResultsError, TrialRow, TrialStatus};

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
        .optional_number("context-psnr", |row| row.context_psnr)
        .optional_count("peak-bytes", |row| row.peak_bytes)
        .optional_text("network-adapter", |row| row.network_adapter.as_deref())
        .optional_text("renderer-adapter", |row| row.renderer_adapter.as_deref())
        .texts("effects", |row| row.effects.iter().map(String::as_str).collect())
        .texts("notes", |row| row.notes.iter().map(String::as_str).collect())
        .texts("context-hashes", |row| row.context_hashes.iter().map(String::as_str).collect())
}

pub(super) fn rows(table: &Table<'_>) -> Result<Vec<TrialRow>, ResultsError> {
    table.rows(|row| {
        let trial = TrialRow {
            key: row.key()?,
            trial_hash: row.text("trial-hash")?,
            pose_hash: row.text("pose-hash")?,
            data_hash: row.optional_text("data-hash"),
            input_hash: row.optional_text("input-hash"),
            status: row.named("status", "the name of a trial's status", TrialStatus::named)?,
            detail: row.optional_text("detail"),
            context: row.counts("context")?,
            context_hashes: row.texts("context-hashes")?,
            targets: row.small_count("targets")?,
            overlap: row.optional_number("overlap"),
            width: row.small_count("width")?,
            height: row.small_count("height")?,
            initial_tokens: row.optional_count("initial-tokens"),
            final_tokens: row.optional_count("final-tokens"),
            gaussians: row.optional_count("gaussians"),
            gaussians_drawn: row.optional_number("gaussians-drawn"),
            context_psnr: row.optional_number("context-psnr"),
            peak_bytes: row.optional_count("peak-bytes"),
            network_adapter: row.optional_text("network-adapter"),
            renderer_adapter: row.optional_text("renderer-adapter"),
            effects: row.texts("effects")?,
            notes: row.texts("notes")?,
        };
        row.possible(trial.impossible()).map(|()| trial)
    })
}
