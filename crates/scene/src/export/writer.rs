use std::fmt;
use std::io::Cursor;
use std::path::Path;

use arrow_array::RecordBatch;
use arrow_ipc::writer::{FileWriter, StreamWriter};
use atsplat_files::{AtomicFile, Writer};
use polars::io::{csv, parquet};
use polars::prelude::{
    CsvWriter, DataFrame, IpcStreamReader, KeyValueMetadata, ParquetWriter, Schema, SerReader as _, SerWriter as _,
};

use super::{ExportError, ExportFormat};
use crate::columns::{metadata, schema};

/// Writes record batches into one file, which appears when it is complete.
pub struct TableWriter {
    // Dropped before `file`, which then removes an unfinished file.
    sink: Sink,
    file: AtomicFile,
}

/// Arrow IPC is written by Arrow itself, which keeps the complete schema; the other two by polars.
enum Sink {
    Parquet(Box<parquet::write::BatchedWriter<Writer>>),
    ArrowIpc(Box<FileWriter<Writer>>),
    Csv(Box<csv::write::BatchedWriter<Writer>>),
}

impl TableWriter {
    /// Opens a temporary file next to `path` for batches of [`crate::columns::schema`].
    ///
    /// # Errors
    /// [`ExportError::Io`] if the folder is missing or not writable.
    pub fn create(path: &Path, format: ExportFormat) -> Result<Self, ExportError> {
        let file = AtomicFile::create(path).map_err(ExportError::io("opening an output file", path))?;
        let sink = match format {
            ExportFormat::Parquet => {
                let metadata = KeyValueMetadata::from_static(metadata().to_vec());
                let writer = ParquetWriter::new(file.writer()).with_key_value_metadata(Some(metadata));
                Sink::Parquet(Box::new(writer.batched(&polars_schema()?)?))
            }
            ExportFormat::ArrowIpc => Sink::ArrowIpc(Box::new(FileWriter::try_new(file.writer(), &schema())?)),
            ExportFormat::Csv => Sink::Csv(Box::new(CsvWriter::new(file.writer()).batched(&polars_schema()?)?)),
        };
        Ok(Self { sink, file })
    }

    /// Appends the rows of one batch, in Parquet as one row group.
    ///
    /// # Errors
    /// [`ExportError`] if encoding or writing fails.
    pub fn write(&mut self, batch: &RecordBatch) -> Result<(), ExportError> {
        if batch.num_rows() == 0 {
            return Ok(());
        }
        match &mut self.sink {
            Sink::Parquet(writer) => writer.write_batch(&polars_from_batch(batch)?)?,
            Sink::ArrowIpc(writer) => writer.write(batch)?,
            Sink::Csv(writer) => writer.write_batch(&polars_from_batch(batch)?)?,
        }
        Ok(())
    }

    /// Completes the file, renames it into place and returns its size in bytes.
    ///
    /// # Errors
    /// [`ExportError`] if the rest cannot be written or the file cannot be renamed.
    pub fn finish(self) -> Result<u64, ExportError> {
        match self.sink {
            Sink::Parquet(writer) => drop(writer.finish()?),
            Sink::ArrowIpc(mut writer) => writer.finish()?,
            Sink::Csv(mut writer) => writer.finish()?,
        }
        let target = self.file.target().to_owned();
        self.file.commit().map_err(ExportError::io("finishing an output file", &target))
    }
}

impl fmt::Debug for TableWriter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let format = match self.sink {
            Sink::Parquet(_) => "Parquet",
            Sink::ArrowIpc(_) => "Arrow IPC",
            Sink::Csv(_) => "CSV",
        };
        write!(f, "TableWriter({format}, {})", self.file.target().display())
    }
}

fn polars_schema() -> Result<Schema, ExportError> {
    let empty = polars_from_batch(&RecordBatch::new_empty(schema()))?;
    Ok(empty.schema().as_ref().clone())
}

/// Converts a record batch to a polars frame. Polars has other Arrow types, so the batch goes through Arrow's stream
/// format in memory; the cost of this copy is negligible compared with writing a file.
///
/// # Errors
/// [`ExportError::Arrow`] or [`ExportError::Polars`] if one side does not support a column.
pub(crate) fn polars_from_batch(batch: &RecordBatch) -> Result<DataFrame, ExportError> {
    let mut stream = StreamWriter::try_new(Vec::new(), batch.schema_ref())?;
    stream.write(batch)?;
    stream.finish()?;
    let bytes = stream.into_inner()?;
    let mut frame = IpcStreamReader::new(Cursor::new(bytes)).finish()?;
    frame.rechunk_mut();
    Ok(frame)
}
