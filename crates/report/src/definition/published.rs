use atsplat_files::csv;
use serde::Serialize;

use super::{ColumnGroup, TableDefinition};
use crate::ReportError;
use crate::table::Value;

/// The numbers that a paper printed, in its order.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Published {
    /// Its rows.
    pub rows: Vec<PublishedRow>,
}

/// A published row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PublishedRow {
    /// Its labels, one per label column.
    pub labels: Vec<String>,
    /// Its numbers, group by group and column by column.
    pub values: Vec<Vec<Value>>,
}

impl Published {
    /// Reads the columns of a definition from a CSV file.
    ///
    /// # Errors
    /// [`ReportError::Csv`]; [`ReportError::Definition`] if a column of the definition is missing.
    pub(super) fn parse(file: &str, text: &str, definition: &TableDefinition) -> Result<Self, ReportError> {
        let malformed = |problem| ReportError::Csv { file: file.to_owned(), problem };
        let mut records = csv::parse(text).map_err(malformed)?.into_iter();
        let header = records.next().ok_or_else(|| malformed("expected a header, found an empty file".to_owned()))?;
        let place = |name: &str| {
            let found = header.iter().position(|known| known == name);
            found.ok_or_else(|| {
                definition.wrong(&format!("column {name:?} in eval/published/{file}"), header.join(", "))
            })
        };
        let of_group = |group: &ColumnGroup| {
            let places = group.columns.iter().map(|column| place(&TableDefinition::published_name(group, column)));
            places.collect::<Result<Vec<usize>, ReportError>>()
        };
        let groups = definition.groups.iter().map(of_group).collect::<Result<Vec<_>, _>>()?;
        for label in &definition.labels {
            fields(&label.text).try_for_each(|name| place(name).map(|_| ()))?;
        }
        let mut rows = Vec::new();
        for record in records {
            let filled = |text: &str| {
                let fields = header.iter().zip(&record);
                fields.fold(text.to_owned(), |text, (name, field)| text.replace(&format!("{{{name}}}"), field))
            };
            rows.push(PublishedRow {
                labels: definition.labels.iter().map(|label| filled(&label.text)).collect(),
                values: groups
                    .iter()
                    .map(|places| places.iter().map(|at| Value::published(&record[*at])).collect())
                    .collect(),
            });
        }
        Ok(Self { rows })
    }
}

/// The names in braces.
fn fields(text: &str) -> impl Iterator<Item = &str> {
    text.split('{').skip(1).filter_map(|rest| rest.split_once('}').map(|(name, _)| name))
}
