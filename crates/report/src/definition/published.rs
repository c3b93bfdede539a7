use serde::Serialize;

use super::{ColumnGroup, TableDefinition};
use crate::ReportError;
use crate::table::Value;

/// What a paper printed, in the order in which it did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Published {
    /// Its rows.
    pub rows: Vec<PublishedRow>,
}

/// A published row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PublishedRow {
    /// What names it, one text per label column.
    pub labels: Vec<String>,
    /// Its numbers, group by group and column by column.
    pub values: Vec<Vec<Value>>,
}

impl Published {
    /// Reads a CSV file as a definition asks.
    ///
    /// # Errors
    /// [`ReportError::Csv`]; [`ReportError::Definition`] where a column that the definition names is not there.
    pub(super) fn parse(file: &str, text: &str, definition: &TableDefinition) -> Result<Self, ReportError> {
        let broken = |source| ReportError::Csv { file: file.to_owned(), source };
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let header: Vec<String> = reader.headers().map_err(broken)?.iter().map(str::to_owned).collect();
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
        for record in reader.records() {
            let record = record.map_err(broken)?;
            let field = |at: usize| record.get(at).unwrap_or_default();
            let filled = |text: &str| {
                let names = header.iter().enumerate();
                names.fold(text.to_owned(), |text, (at, name)| text.replace(&format!("{{{name}}}"), field(at)))
            };
            rows.push(PublishedRow {
                labels: definition.labels.iter().map(|label| filled(&label.text)).collect(),
                values: groups
                    .iter()
                    .map(|places| places.iter().map(|at| Value::published(field(*at))).collect())
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
