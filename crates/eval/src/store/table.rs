use std::fmt::Display;
use std::io::Cursor;
use std::path::Path;

use polars::prelude::{
    ChunkedArray, DataFrame, ParquetReader, ParquetWriter, PolarsError, PolarsResult, SerReader as _, Series,
};

use super::disk;
use super::schema::Column;
use crate::EvalError;

/// A table read from disk, with the columns of its schema version.
pub(super) struct Table<'a> {
    frame: DataFrame,
    columns: &'a [Column],
    path: &'a Path,
}

/// Writes a table.
pub(super) fn write(path: &Path, frame: PolarsOutcome) -> Result<(), EvalError> {
    let failed = |error: PolarsError| EvalError::malformed(path, "table", "rows that Parquet can represent", error);
    let mut frame = frame.map_err(failed)?;
    let mut bytes = Vec::new();
    ParquetWriter::new(&mut bytes).set_parallel(false).finish(&mut frame).map_err(failed)?;
    disk::write(path, &bytes)
}

pub(super) type PolarsOutcome = Result<DataFrame, PolarsError>;

impl<'a> Table<'a> {
    /// Reads a table and checks its columns; `None` if there is no file.
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
        let expected = || format!("{}, {}", kind.name(), if *nullable { "nullable" } else { "not null" });
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

    /// A column in the type of the schema; `None` for a column that was added in a later version.
    #[expect(clippy::expect_used, reason = "every column of the version was checked when the table was read")]
    fn column<'t, T>(&'t self, name: &str, typed: impl Fn(&'t Series) -> PolarsResult<T>) -> Option<T> {
        self.columns.iter().find(|column| column.name == name)?;
        let column = self.frame.column(name).expect("a column of the schema").as_materialized_series();
        Some(typed(column).expect("a column of the schema's type"))
    }

    pub(super) fn texts_of(&self, name: &str) -> Vec<Option<String>> {
        let column = self.column(name, Series::str);
        self.all(column.map(|column| column.iter().map(|text| text.map(str::to_owned))))
    }

    pub(super) fn flags_of(&self, name: &str) -> Vec<Option<bool>> {
        self.all(self.column(name, Series::bool).map(ChunkedArray::iter))
    }

    pub(super) fn counts_of(&self, name: &str) -> Vec<Option<u64>> {
        self.all(self.column(name, Series::u64).map(ChunkedArray::iter))
    }

    pub(super) fn integers_of(&self, name: &str) -> Vec<Option<i64>> {
        self.all(self.column(name, Series::i64).map(ChunkedArray::iter))
    }

    pub(super) fn numbers_of(&self, name: &str) -> Vec<Option<f64>> {
        self.all(self.column(name, Series::f64).map(ChunkedArray::iter))
    }

    pub(super) fn lists_of_texts(&self, name: &str) -> Result<Vec<Vec<String>>, EvalError> {
        self.lists(name, |series| Ok(series.str()?.iter().map(|text| text.map(str::to_owned)).collect()))
    }

    pub(super) fn lists_of_counts(&self, name: &str) -> Result<Vec<Vec<u64>>, EvalError> {
        self.lists(name, |series| Ok(series.u64()?.iter().collect()))
    }

    pub(super) fn lists_of_numbers(&self, name: &str) -> Result<Vec<Vec<f64>>, EvalError> {
        self.lists(name, |series| Ok(series.f64()?.iter().collect()))
    }

    /// `of` returns `None` for a list that holds a null. Lists of a column that was added in a later version are empty.
    fn lists<T>(
        &self,
        name: &str,
        of: impl Fn(&Series) -> PolarsResult<Option<Vec<T>>>,
    ) -> Result<Vec<Vec<T>>, EvalError> {
        let Some(column) = self.column(name, Series::list) else {
            return Ok(std::iter::repeat_with(Vec::new).take(self.rows()).collect());
        };
        let list = |at: usize| {
            let series = column.get_as_series(at);
            let list = series.map(|series| of(&series)).transpose();
            let list = list.map_err(|error| self.wrong(name, at, "a list", error))?;
            list.flatten().ok_or_else(|| self.wrong(name, at, "a list without nulls", "a null"))
        };
        (0..column.len()).map(list).collect()
    }

    /// The values, or nulls if there is no such column.
    fn all<T>(&self, values: Option<impl Iterator<Item = Option<T>>>) -> Vec<Option<T>> {
        match values {
            Some(values) => values.collect(),
            None => std::iter::repeat_with(|| None).take(self.rows()).collect(),
        }
    }

    /// The error for an invalid value.
    pub(super) fn wrong(&self, column: &str, row: usize, expected: &str, found: impl Display) -> EvalError {
        EvalError::malformed(self.path, format!("column {column}, row {row}"), expected, found)
    }
}
