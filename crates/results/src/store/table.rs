use std::collections::HashMap;
use std::fmt::Display;
use std::io::Cursor;
use std::path::Path;

use atsplat_files::{catch_silently, panic_message};
use polars::prelude::{
    DataFrame, ParallelStrategy, ParquetReader, ParquetWriter, PolarsError, PolarsResult, SerReader as _, Series,
};

use super::disk;
use super::hashes::{ADVICE, TableHashes};
use super::schema::Column;
use crate::rows::Impossible;
use crate::{ResultsError, TrialKey};

/// A table read from disk, with the columns of its schema version.
pub(super) struct Table<'a> {
    frame: DataFrame,
    columns: &'a [Column],
    path: &'a Path,
}

/// The content of a table's file.
pub(super) fn encoded(path: &Path, frame: PolarsOutcome) -> Result<Vec<u8>, ResultsError> {
    let failed = |error: PolarsError| ResultsError::malformed(path, "table", "rows that Parquet can represent", error);
    let mut frame = frame.map_err(failed)?;
    let mut bytes = Vec::new();
    ParquetWriter::new(&mut bytes).set_parallel(false).finish(&mut frame).map_err(failed)?;
    Ok(bytes)
}

pub(super) type PolarsOutcome = Result<DataFrame, PolarsError>;

impl<'a> Table<'a> {
    /// Reads a table, and checks its hash and its columns; `None` if there is no file.
    pub(super) fn read(
        path: &'a Path,
        columns: &'a [Column],
        hashes: &TableHashes,
    ) -> Result<Option<Self>, ResultsError> {
        let bytes = disk::read(path)?;
        hashes.check(path, bytes.as_deref())?;
        let Some(bytes) = bytes else { return Ok(None) };
        let unreadable =
            |why: String| ResultsError::malformed(path, "file", format!("a Parquet table ({ADVICE})"), why);
        let frame = parsed(bytes).map_err(unreadable)?;
        let table = Self { frame, columns, path };
        columns.iter().try_for_each(|column| table.check(column))?;
        Ok(Some(table))
    }

    fn check(&self, column: &Column) -> Result<(), ResultsError> {
        let Column { name, kind, nullable } = column;
        let expected = || format!("{}, {}", kind.name(), if *nullable { "nullable" } else { "not null" });
        let wrong = |found: String| ResultsError::malformed(self.path, format!("column {name}"), expected(), found);
        let series = self.frame.column(name).map_err(|_absent| wrong("no such column".to_owned()))?;
        if *series.dtype() != kind.data_type() {
            return Err(wrong(series.dtype().to_string()));
        }
        let nulls = series.null_count();
        if nulls > 0 && !nullable { Err(wrong(format!("{nulls} nulls"))) } else { Ok(()) }
    }

    /// Converts every row.
    #[expect(clippy::expect_used, reason = "every column of the version was checked when the table was read")]
    pub(super) fn rows<T>(
        &self,
        convert: impl Fn(&Row<'_>) -> Result<T, ResultsError>,
    ) -> Result<Vec<T>, ResultsError> {
        let series = |name| self.frame.column(name).expect("a column of the schema").as_materialized_series();
        let columns = self.columns.iter().map(|column| (column.name.as_str(), series(&column.name))).collect();
        (0..self.frame.height()).map(|index| convert(&Row { columns: &columns, path: self.path, index })).collect()
    }
}

/// The table in a file's bytes, or why it cannot be read: some damaged files let polars panic. That is not printed of this thread, which
/// therefore decodes alone.
fn parsed(bytes: Vec<u8>) -> Result<DataFrame, String> {
    let table = || ParquetReader::new(Cursor::new(bytes)).read_parallel(ParallelStrategy::None).finish();
    let read = catch_silently(table);
    let damaged =
        |text: Option<&str>| text.map_or_else(|| "damaged data".to_owned(), |text| format!("damaged data: {text}"));
    read.map_err(|panic| damaged(panic_message(panic.as_ref())))?.map_err(|error| error.to_string())
}

/// A row of a table. Columns that were added in a later version are null, or empty lists.
pub(super) struct Row<'t> {
    columns: &'t HashMap<&'t str, &'t Series>,
    path: &'t Path,
    index: usize,
}

impl<'t> Row<'t> {
    #[expect(clippy::expect_used, reason = "the types of columns were checked when the table was read")]
    fn column<T>(&self, name: &str, typed: impl Fn(&'t Series) -> PolarsResult<&'t T>) -> Option<&'t T> {
        self.columns.get(name).map(|series| typed(series).expect("a column of the schema's type"))
    }

    fn required<T>(&self, name: &str, value: Option<T>) -> Result<T, ResultsError> {
        value.ok_or_else(|| self.invalid(name, "a value", "none"))
    }

    pub(super) fn key(&self) -> Result<TrialKey, ResultsError> {
        Ok(TrialKey {
            preset: self.text("preset")?,
            method: self.text("method")?,
            scene: self.text("scene")?,
            entry: self.small_count("entry")?,
        })
    }

    pub(super) fn optional_text(&self, name: &str) -> Option<String> {
        self.column(name, Series::str)?.get(self.index).map(str::to_owned)
    }

    pub(super) fn text(&self, name: &str) -> Result<String, ResultsError> {
        self.required(name, self.optional_text(name))
    }

    /// A text that is the name of something.
    pub(super) fn named<T>(
        &self,
        name: &str,
        expected: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T, ResultsError> {
        let text = self.text(name)?;
        parse(&text).ok_or_else(|| self.invalid(name, expected, &text))
    }

    pub(super) fn flag(&self, name: &str) -> Result<bool, ResultsError> {
        self.required(name, self.column(name, Series::bool).and_then(|column| column.get(self.index)))
    }

    pub(super) fn optional_count(&self, name: &str) -> Option<u64> {
        self.column(name, Series::u64)?.get(self.index)
    }

    pub(super) fn count(&self, name: &str) -> Result<u64, ResultsError> {
        self.required(name, self.optional_count(name))
    }

    /// A count below 2³².
    pub(super) fn small_count(&self, name: &str) -> Result<u32, ResultsError> {
        let count = self.count(name)?;
        u32::try_from(count).map_err(|_too_large| self.invalid(name, "a count below 2³²", count))
    }

    pub(super) fn integer(&self, name: &str) -> Result<i64, ResultsError> {
        self.required(name, self.column(name, Series::i64).and_then(|column| column.get(self.index)))
    }

    pub(super) fn optional_number(&self, name: &str) -> Option<f64> {
        self.column(name, Series::f64)?.get(self.index)
    }

    pub(super) fn texts(&self, name: &str) -> Result<Vec<String>, ResultsError> {
        self.list(name, |series| Ok(series.str()?.iter().map(|text| text.map(str::to_owned)).collect()))
    }

    pub(super) fn counts(&self, name: &str) -> Result<Vec<u64>, ResultsError> {
        self.list(name, |series| Ok(series.u64()?.iter().collect()))
    }

    pub(super) fn numbers(&self, name: &str) -> Result<Vec<f64>, ResultsError> {
        self.list(name, |series| Ok(series.f64()?.iter().collect()))
    }

    /// `of` returns `None` for a list that contains a null.
    fn list<T>(
        &self,
        name: &str,
        of: impl Fn(&Series) -> PolarsResult<Option<Vec<T>>>,
    ) -> Result<Vec<T>, ResultsError> {
        let Some(column) = self.column(name, Series::list) else { return Ok(Vec::new()) };
        let list = column.get_as_series(self.index).map(|series| of(&series)).transpose();
        let list = list.map_err(|error| self.invalid(name, "a list", error))?;
        list.flatten().ok_or_else(|| self.invalid(name, "a list without nulls", "a null"))
    }

    /// The error for a field with an impossible value, if there is one.
    pub(super) fn possible(&self, found: Option<Impossible>) -> Result<(), ResultsError> {
        found.map_or(Ok(()), |Impossible { field, expected, found }| Err(self.invalid(&field, &expected, found)))
    }

    /// The error for an invalid value.
    pub(super) fn invalid(&self, column: &str, expected: &str, found: impl Display) -> ResultsError {
        ResultsError::malformed(self.path, format!("column {column}, row {}", self.index), expected, found)
    }
}
