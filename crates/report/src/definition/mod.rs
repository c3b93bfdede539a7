//! What a table shows, as data: one TOML file per table of the paper under `eval/tables`, the published numbers beside it
//! under `eval/published`.

mod builtin;
mod method_rule;
mod published;
mod quantity;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub use method_rule::MethodRule;
pub(crate) use method_rule::is_ablation;
pub use published::{Published, PublishedRow};
pub use quantity::Quantity;

use crate::ReportError;

/// A table before anything is measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct TableDefinition {
    /// Name in files and on command lines.
    pub name: String,
    /// Short title.
    pub title: String,
    /// What the table shows, as a caption.
    pub caption: String,
    /// Where the published numbers were printed.
    pub source: String,
    /// Name of their file under `eval/published`.
    pub published: String,
    /// What names a row.
    pub labels: Vec<LabelColumn>,
    /// What measured rows are called.
    #[serde(default)]
    pub measured_label: MeasuredLabel,
    /// What is set bold and underlined.
    #[serde(default)]
    pub marks: Marks,
    /// What is drawn of it.
    #[serde(default)]
    pub plot: Option<PlotKind>,
    /// Labels of the row that the others are compared with.
    #[serde(default)]
    pub reference: Option<Vec<String>>,
    /// Whether methods that no row asks for get rows of their own; those of ablations do not.
    #[serde(default)]
    pub others: bool,
    /// What a reader must know.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Columns, in groups with a common head.
    pub groups: Vec<ColumnGroup>,
    /// What is known of rows beyond their published numbers. The order of rows is that of the published file.
    #[serde(default)]
    pub rows: Vec<RowDefinition>,
}

/// A column that names rows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct LabelColumn {
    /// Its head.
    pub title: String,
    /// Text with names of published columns in braces: `{height}×{width}`.
    pub text: String,
}

/// What measured rows are called.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeasuredLabel {
    /// As the method calls itself.
    #[default]
    Method,
    /// As the published row that they answer.
    Published,
}

/// What is set bold and underlined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Marks {
    /// The best bold, the second underlined.
    #[default]
    BestAndSecond,
    /// The best bold.
    Best,
    /// Nothing.
    None,
}

/// What is drawn of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlotKind {
    /// Quality against Gaussians, and against seconds where there are any.
    Frontier,
    /// Differences to the reference row.
    Ablation,
    /// Quality against Gaussians per token.
    KScaling,
    /// Quality in each bin of overlap.
    OverlapBins,
    /// Gaussians of each scene.
    BudgetHistogram,
}

/// Columns with a common head.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ColumnGroup {
    /// The head; empty for none.
    #[serde(default)]
    pub title: String,
    /// The preset that is measured, unless a row says which.
    #[serde(default)]
    pub preset: Option<String>,
    /// The methods that are measured, unless rows say which.
    #[serde(default)]
    pub method: Option<MethodRule>,
    /// The bin of overlap, or `average` over all bins.
    #[serde(default)]
    pub bin: Option<String>,
    /// What the names of published columns end in.
    #[serde(default)]
    pub suffix: String,
    /// The columns.
    pub columns: Vec<ColumnDefinition>,
}

/// A column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, from = "WrittenColumn")]
pub struct ColumnDefinition {
    /// What it shows.
    pub quantity: Quantity,
    /// Name of the published column, without its group's suffix.
    pub published: String,
    /// Its head where it is not the quantity's name.
    pub title: Option<String>,
    /// Whether counts are printed to the unit instead of cut to thousands.
    pub exact: bool,
}

/// What is known of a row beyond its published numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RowDefinition {
    /// Labels of the published row.
    pub published: Vec<String>,
    /// The methods that answer it.
    #[serde(default)]
    pub method: Option<MethodRule>,
    /// The preset, where rows are settings.
    #[serde(default)]
    pub preset: Option<String>,
    /// Whether a line is drawn above it.
    #[serde(default)]
    pub rule_above: bool,
}

/// `"psnr"`, or a table that says more.
#[derive(Deserialize)]
#[serde(untagged)]
enum WrittenColumn {
    Name(Quantity),
    Told(ToldColumn),
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct ToldColumn {
    quantity: Quantity,
    published: Option<String>,
    title: Option<String>,
    #[serde(default)]
    exact: bool,
}

impl From<WrittenColumn> for ColumnDefinition {
    fn from(written: WrittenColumn) -> Self {
        let told = match written {
            WrittenColumn::Name(quantity) => ToldColumn { quantity, published: None, title: None, exact: false },
            WrittenColumn::Told(told) => told,
        };
        let published = told.published.unwrap_or_else(|| told.quantity.id().to_owned());
        Self { quantity: told.quantity, published, title: told.title, exact: told.exact }
    }
}

impl TableDefinition {
    /// Names of the tables that travel in the binary, in the order of a report.
    pub fn names() -> impl Iterator<Item = &'static str> {
        builtin::TABLES.iter().map(|(name, _)| *name)
    }

    /// A table by name.
    ///
    /// # Errors
    /// [`ReportError::UnknownTable`].
    pub fn named(name: &str) -> Result<Self, ReportError> {
        let known = builtin::TABLES.iter().find(|(known, _)| *known == name);
        let (_, text) = known.ok_or_else(|| ReportError::UnknownTable {
            expected: Self::names().collect::<Vec<_>>().join(", "),
            found: name.to_owned(),
        })?;
        Self::from_toml(name, text)
    }

    /// Reads a definition; `name` is for errors.
    ///
    /// # Errors
    /// [`ReportError::Toml`], and [`ReportError::Definition`] where it does not fit its published numbers.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, ReportError> {
        let definition: Self =
            toml::from_str(text).map_err(|source| ReportError::Toml { table: name.to_owned(), source })?;
        let published = definition.published()?;
        definition.check(&published)?;
        Ok(definition)
    }

    /// The published numbers.
    ///
    /// # Errors
    /// [`ReportError::Csv`], [`ReportError::Definition`] where there is no such file.
    pub fn published(&self) -> Result<Published, ReportError> {
        let known = builtin::PUBLISHED.iter().find(|(file, _)| *file == self.published);
        let (file, text) = known.ok_or_else(|| self.wrong("a file of eval/published", self.published.clone()))?;
        Published::parse(file, text, self)
    }

    /// The name of a column's published numbers.
    pub(crate) fn published_name(group: &ColumnGroup, column: &ColumnDefinition) -> String {
        format!("{}{}", column.published, group.suffix)
    }

    /// What is known of a row with these labels.
    pub(crate) fn row(&self, labels: &[String]) -> Option<&RowDefinition> {
        self.rows.iter().find(|row| row.published == labels)
    }

    fn check(&self, published: &Published) -> Result<(), ReportError> {
        if self.labels.is_empty() || self.groups.iter().all(|group| group.columns.is_empty()) {
            return Err(self.wrong("labels and columns", "none".to_owned()));
        }
        for row in self.rows.iter().map(|row| &row.published).chain(&self.reference) {
            if !published.rows.iter().any(|known| known.labels == *row) {
                return Err(self.wrong("rows of the published file", format!("{row:?}")));
            }
        }
        for group in &self.groups {
            if group.preset.is_none() && self.rows.iter().any(|row| row.preset.is_none()) {
                return Err(self.wrong("a preset for each group or each row", format!("{:?}", group.title)));
            }
        }
        Ok(())
    }

    pub(crate) fn wrong(&self, expected: &str, found: String) -> ReportError {
        ReportError::Definition { table: self.name.clone(), expected: expected.to_owned(), found }
    }
}
