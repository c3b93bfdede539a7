//! Writes camera tables as Parquet, Arrow IPC or CSV.
//!
//! [`export`] reads scenes in parallel and writes them in the order of their keys, with at most a few record batches in
//! memory, and renames the file into place when it is complete. The bytes do not depend on the number of threads.

mod error;
mod format;
mod writer;

use std::path::Path;

use serde::Serialize;

use crate::columns::CameraTable;
use crate::{SceneSource, Warnings, load_scenes};

pub use error::ExportError;
pub use format::ExportFormat;
pub use writer::TableWriter;

/// Scenes in memory at once: enough to keep many cores busy.
const SCENES_AT_ONCE: usize = 256;

/// Summary of an export.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ExportSummary {
    /// Scenes written.
    pub scenes: u64,
    /// Scenes that could not be read; each has a warning with the reason.
    pub skipped: u64,
    /// Rows written, one per frame.
    pub frames: u64,
    /// Size of the file in bytes.
    pub bytes: u64,
}

/// Writes every camera of `source` to `path` and calls `step` once per scene, from any thread.
///
/// A scene that cannot be read is skipped with a warning. If none can be read, nothing is written.
///
/// # Errors
/// [`ExportError`] if a scene cannot be fetched or the file cannot be written; an existing file at `path` is then unchanged.
pub fn export(
    source: &dyn SceneSource,
    path: &Path,
    format: ExportFormat,
    warnings: &mut Warnings,
    step: &(dyn Fn() + Sync),
) -> Result<ExportSummary, ExportError> {
    let mut writer = TableWriter::create(path, format)?;
    let mut table = CameraTable::new();
    let mut summary = ExportSummary::default();
    for keys in source.keys().chunks(SCENES_AT_ONCE) {
        let scenes = load_scenes(source, keys, warnings, &|_| step());
        source.check_fetched()?;
        summary.skipped += (keys.len() - scenes.len()) as u64;
        for mut scene in scenes {
            if !scene.has_times(source.times()) {
                scene.frames.iter_mut().for_each(|frame| frame.timestamp_micros = None);
            }
            table.push_scene(&scene, |batch| writer.write(&batch))?;
            summary.scenes += 1;
            summary.frames += scene.frames.len() as u64;
        }
    }
    if summary.scenes == 0 && summary.skipped > 0 {
        return Ok(summary);
    }
    writer.write(&table.take()?)?;
    summary.bytes = writer.finish()?;
    Ok(summary)
}

#[cfg(test)]
mod tests;
