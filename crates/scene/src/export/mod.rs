//! Camera tables as files: Parquet, Arrow IPC, CSV.
//!
//! [`export`] walks a dataset scene by scene, in parallel but in the order of its keys, holds at most a few
//! record batches at a time, and renames the file into place only when it is complete. The same dataset
//! gives the same bytes whatever the number of threads.

mod error;
mod format;
mod polars_frame;
mod writer;

use std::path::Path;

use serde::Serialize;

use crate::columns::CameraTable;
use crate::{SceneSource, Warnings, load_scenes};

pub use error::ExportError;
pub use format::ExportFormat;
pub(crate) use polars_frame::polars_from_batch;
pub use writer::TableWriter;

/// Scenes read at a time: enough to keep many cores busy, few enough to hold in memory.
const SCENES_AT_ONCE: usize = 256;

/// What an export wrote.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ExportSummary {
    /// Scenes written.
    pub scenes: u64,
    /// Scenes that could not be read; each is a warning with its reason.
    pub skipped: u64,
    /// Rows written, one per frame.
    pub frames: u64,
    /// Size of the file.
    pub bytes: u64,
}

/// Writes every camera of `source` to `path`, calling `step` once per scene from any thread.
///
/// # Errors
/// [`ExportError`] where the file cannot be written; nothing is left at `path` then, and a file that was
/// there before stays. A scene that cannot be read is no error but a warning, and is left out.
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
        summary.skipped += (keys.len() - scenes.len()) as u64;
        for scene in scenes {
            table.push_scene(&scene, |batch| writer.write(&batch))?;
            summary.scenes += 1;
            summary.frames += scene.frames.len() as u64;
        }
    }
    writer.write(&table.take()?)?;
    summary.bytes = writer.finish()?;
    Ok(summary)
}

#[cfg(test)]
mod tests;
