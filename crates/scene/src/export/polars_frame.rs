use std::io::Cursor;

use arrow_array::RecordBatch;
use arrow_ipc::writer::StreamWriter;
use polars::prelude::{DataFrame, IpcStreamReader, SerReader as _};

use super::ExportError;

/// A record batch as a polars frame. Polars has its own Arrow types, so the batch goes through Arrow's
/// stream format in memory: a copy, which writing a file does not notice.
///
/// # Errors
/// [`ExportError::Arrow`] or [`ExportError::Polars`] where one side cannot handle a column.
pub(crate) fn polars_from_batch(batch: &RecordBatch) -> Result<DataFrame, ExportError> {
    let mut stream = StreamWriter::try_new(Vec::new(), batch.schema_ref())?;
    stream.write(batch)?;
    stream.finish()?;
    let bytes = stream.into_inner()?;
    let mut frame = IpcStreamReader::new(Cursor::new(bytes)).finish()?;
    frame.rechunk_mut();
    Ok(frame)
}
