use std::fmt::Display;
use std::io::Cursor;
use std::path::Path;

use polars::prelude::{
    ChunkedArray, Column as Values, DataFrame, ParquetReader, ParquetWriter, PolarsError, SerReader as _, Series,
};

use super::disk;
use super::schema::Column;
use crate::EvalError;

/// A table that was read, with the columns that its version has.
pub(super) struct Table<'a> {
    frame: DataFrame,
    columns: &'a [Column],
    path: &'a Path,
}

/// Writes a table.
pub(super) fn write(path: &Path, frame: PolarsOutcome) -> Result<(), EvalError> {
    let failed = |error: PolarsError| EvalError::malformed(path, "table", "rows that Parquet holds", error);
    let mut frame = frame.map_err(failed)?;
    let mut bytes = Vec::new();
    ParquetWriter::new(&mut bytes).set_parallel(false).finish(&mut frame).map_err(failed)?;
    disk::write(path, &bytes)
}

pub(super) type PolarsOutcome = Result<DataFrame, PolarsError>;

impl<'a> Table<'a> {
    /// Reads a table and checks its columns; `None` where there is no file.
    pub(super) fn read(path: &'a Path, columns: &'a [Column]) -> Result<Option<Self>, EvalError> {
        let Some(bytes) = disk::read(path)? else { return Ok(None) };
        let frame = ParquetReader::new(Cursor::new(bytes)).finish();
        let frame = frame.map_err(|error| EvalError::malformed(path, "file", "a Parquet table", error))?;
        let table = Self { frame, columns, path };
        columns.iter().try_for_each(|column| table.check(column))?;
        Ok(Some(table))
    }

    fn check(&self, column: &Column) -> Result<(), EvalError> {
        let Column { name, kind, nullable } = column;
        let expected = || format!("{}, {}", kind.name(), if *nullable { "null or not" } else { "never null" });
        let wrong = |found: String| EvalError::malformed(self.path, format!("column {name}"), expected(), found);
        let series = self.frame.column(name).map_err(|_absent| wrong("no such column".to_owned()))?;
        if *series.dtype() != kind.data_type() {
            return Err(wrong(series.dtype().to_string()));
        }
        let nulls = series.null_count();
        if nulls > 0 && !nullable { Err(wrong(format!("{nulls} nulls"))) } else { Ok(()) }
    }

    pub(super) fn rows(&self) -> usize {
        self.frame.height()
    }

    /// A column that the table's version has; `None` for one that came later.
    fn column(&self, name: &str) -> Option<&Series> {
        self.columns.iter().find(|column| column.name == name)?;
        self.frame.column(name).ok().map(Values::as_materialized_series)
    }

    pub(super) fn texts_of(&self, name: &str) -> Vec<Option<String>> {
        let column = self.column(name).and_then(|column| column.str().ok());
        self.all(column.map(|column| column.iter().map(|text| text.map(str::to_owned))))
    }

    pub(super) fn flags_of(&self, name: &str) -> Vec<Option<bool>> {
        self.all(self.column(name).and_then(|column| column.bool().ok()).map(ChunkedArray::iter))
    }

    pub(super) fn counts_of(&self, name: &str) -> Vec<Option<u64>> {
        self.all(self.column(name).and_then(|column| column.u64().ok()).map(ChunkedArray::iter))
    }

    pub(super) fn integers_of(&self, name: &str) -> Vec<Option<i64>> {
        self.all(self.column(name).and_then(|column| column.i64().ok()).map(ChunkedArray::iter))
    }

    pub(super) fn numbers_of(&self, name: &str) -> Vec<Option<f64>> {
        self.all(self.column(name).and_then(|column| column.f64().ok()).map(ChunkedArray::iter))
    }

    pub(super) fn lists_of_texts(&self, name: &str) -> Vec<Vec<String>> {
        let list = |series: &Series| Some(series.str().ok()?.iter().flatten().map(str::to_owned).collect());
        self.lists(name, list)
    }

    pub(super) fn lists_of_counts(&self, name: &str) -> Vec<Vec<u64>> {
        self.lists(name, |series| Some(series.u64().ok()?.iter().flatten().collect()))
    }

    pub(super) fn lists_of_numbers(&self, name: &str) -> Vec<Vec<f64>> {
        self.lists(name, |series| Some(series.f64().ok()?.iter().flatten().collect()))
    }

    fn lists<T>(&self, name: &str, of: impl Fn(&Series) -> Option<Vec<T>>) -> Vec<Vec<T>> {
        let column = self.column(name).and_then(|column| column.list().ok());
        let lists = column.map(|column| {
            (0..column.len()).map(|at| column.get_as_series(at).map(|series| of(&series).unwrap_or_default()))
        });
        self.all(lists).into_iter().map(Option::unwrap_or_default).collect()
    }

    /// Nulls where there is no such column.
    fn all<T>(&self, values: Option<impl Iterator<Item = Option<T>>>) -> Vec<Option<T>> {
        match values {
            Some(values) => values.collect(),
            None => std::iter::repeat_with(|| None).take(self.rows()).collect(),
        }
    }

    /// A value outside what a field takes.
    pub(super) fn wrong(&self, column: &str, row: usize, expected: &str, found: impl Display) -> EvalError {
        EvalError::malformed(self.path, format!("column {column}, row {row}"), expected, found)
    }
}
