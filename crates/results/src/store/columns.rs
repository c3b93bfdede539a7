use polars::prelude::{
    BooleanChunked, DataFrame, DataType, Float64Chunked, Float64Type, Int64Chunked, IntoColumn as _, IntoSeries as _,
    ListBuilderTrait as _, ListPrimitiveChunkedBuilder, ListStringChunkedBuilder, NewChunkedArray as _, PolarsResult,
    Series, StringChunked, UInt64Chunked, UInt64Type,
};

use super::schema::{Column, Kind};
use crate::TrialKey;

/// Builds a table from rows, column by column.
pub(super) struct Columns<'a, R> {
    rows: &'a [R],
    series: Vec<Series>,
    described: Vec<Column>,
}

impl<'a, R> Columns<'a, R> {
    /// Begins with the columns of the rows' keys.
    pub(super) fn of(rows: &'a [R], key: impl Fn(&'a R) -> &'a TrialKey) -> Self {
        Self { rows, series: Vec::new(), described: Vec::new() }
            .text("preset", |row| &key(row).preset)
            .text("method", |row| &key(row).method)
            .text("scene", |row| &key(row).scene)
            .count("entry", |row| key(row).entry.into())
    }

    /// The schema of the columns.
    #[cfg(test)]
    pub(super) fn described(self) -> Vec<Column> {
        self.described
    }

    pub(super) fn frame(self) -> PolarsResult<DataFrame> {
        let columns = self.series.into_iter().map(Series::into_column).collect();
        DataFrame::new(self.rows.len(), columns)
    }

    fn with(mut self, name: &str, kind: Kind, nullable: bool, series: Series) -> Self {
        self.described.push(Column { name: name.to_owned(), kind, nullable });
        self.series.push(series);
        self
    }

    pub(super) fn text(self, name: &str, of: impl Fn(&'a R) -> &'a str) -> Self {
        let series = StringChunked::from_iter_values(name.into(), self.rows.iter().map(of)).into_series();
        self.with(name, Kind::Text, false, series)
    }

    pub(super) fn optional_text(self, name: &str, of: impl Fn(&'a R) -> Option<&'a str>) -> Self {
        let series = StringChunked::from_iter_options(name.into(), self.rows.iter().map(of)).into_series();
        self.with(name, Kind::Text, true, series)
    }

    pub(super) fn flag(self, name: &str, of: impl Fn(&'a R) -> bool) -> Self {
        let series = BooleanChunked::from_iter_values(name.into(), self.rows.iter().map(of)).into_series();
        self.with(name, Kind::Flag, false, series)
    }

    pub(super) fn count(self, name: &str, of: impl Fn(&'a R) -> u64) -> Self {
        let series = UInt64Chunked::from_iter_values(name.into(), self.rows.iter().map(of)).into_series();
        self.with(name, Kind::Count, false, series)
    }

    pub(super) fn optional_count(self, name: &str, of: impl Fn(&'a R) -> Option<u64>) -> Self {
        let series = UInt64Chunked::from_iter_options(name.into(), self.rows.iter().map(of)).into_series();
        self.with(name, Kind::Count, true, series)
    }

    pub(super) fn integer(self, name: &str, of: impl Fn(&'a R) -> i64) -> Self {
        let series = Int64Chunked::from_iter_values(name.into(), self.rows.iter().map(of)).into_series();
        self.with(name, Kind::Integer, false, series)
    }

    pub(super) fn optional_number(self, name: &str, of: impl Fn(&'a R) -> Option<f64>) -> Self {
        let series = Float64Chunked::from_iter_options(name.into(), self.rows.iter().map(of)).into_series();
        self.with(name, Kind::Number, true, series)
    }

    pub(super) fn texts(self, name: &str, of: impl Fn(&'a R) -> Vec<&'a str>) -> Self {
        let mut lists = ListStringChunkedBuilder::new(name.into(), self.rows.len(), self.rows.len());
        self.rows.iter().for_each(|row| lists.append_values_iter(of(row).into_iter()));
        self.with(name, Kind::Texts, false, lists.finish().into_series())
    }

    pub(super) fn counts(self, name: &str, of: impl Fn(&'a R) -> &'a [u64]) -> Self {
        let (rows, item) = (self.rows.len(), DataType::UInt64);
        let mut lists = ListPrimitiveChunkedBuilder::<UInt64Type>::new(name.into(), rows, rows, item);
        self.rows.iter().for_each(|row| lists.append_slice(of(row)));
        self.with(name, Kind::Counts, false, lists.finish().into_series())
    }

    pub(super) fn numbers(self, name: &str, of: impl Fn(&'a R) -> Vec<f64>) -> Self {
        let (rows, item) = (self.rows.len(), DataType::Float64);
        let mut lists = ListPrimitiveChunkedBuilder::<Float64Type>::new(name.into(), rows, rows, item);
        self.rows.iter().for_each(|row| lists.append_slice(&of(row)));
        self.with(name, Kind::Numbers, false, lists.finish().into_series())
    }
}
