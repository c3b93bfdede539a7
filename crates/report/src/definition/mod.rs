//! Definitions of tables: one TOML file per table of the paper in `eval/tables`, with the published numbers in
//! `eval/published`.

mod builtin;
mod choice;
mod group;
mod method_rule;
mod published;
mod quantity;
#[cfg(test)]
mod tests;
mod training;
mod variant;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use choice::Choice;
pub(crate) use choice::is_called;
pub use group::{ColumnGroup, TargetSet};
pub use method_rule::MethodRule;
pub use published::{Published, PublishedRow};
pub use quantity::{Quantity, SlopeOver};
pub(crate) use training::{is_named as is_named_dataset, name as dataset_name, zero_shot_note};
pub use variant::Variant;
pub(crate) use variant::{by_quantile, has_thresholds, is_ablation, is_full, is_trained_separately};

use crate::ReportError;

/// The definition of a table, without measurements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct TableDefinition {
    /// Name in files and on command lines.
    pub name: String,
    /// Short title.
    pub title: String,
    /// The caption.
    pub caption: String,
    /// Where the published numbers were printed.
    pub source: String,
    /// Name of their file in `eval/published`.
    pub published: String,
    /// The columns that label rows.
    pub labels: Vec<LabelColumn>,
    /// How measured rows are labelled.
    #[serde(default)]
    pub measured_label: MeasuredLabel,
    /// Which values are bold and underlined.
    #[serde(default)]
    pub marks: Marks,
    /// The plot of the table.
    #[serde(default)]
    pub plot: Option<PlotKind>,
    /// Labels of the row that the others are compared with.
    #[serde(default)]
    pub reference: Option<Vec<String>>,
    /// Whether methods that match no row get additional rows, except for ablations.
    #[serde(default)]
    pub others: bool,
    /// Whether ablations get additional rows too, as in tables of one protocol.
    #[serde(skip)]
    pub ablations: bool,
    /// Whether intervals are printed next to the numbers.
    #[serde(default)]
    pub intervals: bool,
    /// What readers must know.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Columns, in groups with a common heading.
    pub groups: Vec<ColumnGroup>,
    /// Properties of rows beyond their published numbers. The order of rows is that of the published file.
    #[serde(default)]
    pub rows: Vec<RowDefinition>,
    /// What is shown of it.
    #[serde(skip)]
    pub choice: Choice,
    /// Headings of the columns that the choice left out.
    #[serde(skip)]
    pub columns_left_out: Vec<String>,
}

/// A column that labels rows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct LabelColumn {
    /// Its heading.
    pub title: String,
    /// The label, with names of published columns in braces: `{height}×{width}`.
    pub text: String,
}

/// How measured rows are labelled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeasuredLabel {
    /// With the method's title.
    #[default]
    Method,
    /// With the labels of the published row that they reproduce.
    Published,
}

/// Which values are bold and underlined.
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

/// The plot of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlotKind {
    /// Quality against Gaussians, and against seconds if available.
    Frontier,
    /// Differences to the reference row.
    Ablation,
    /// Quality against Gaussians per token.
    KScaling,
    /// Quality in each overlap bin.
    OverlapBins,
    /// Distribution of Gaussians per scene.
    BudgetHistogram,
}

/// A column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, from = "ColumnToml")]
pub struct ColumnDefinition {
    /// The quantity shown.
    pub quantity: Quantity,
    /// Name of the published column, without its group's suffix.
    pub published: String,
    /// Its heading, if it differs from the quantity's name.
    pub title: Option<String>,
    /// Whether counts are printed exactly instead of in thousands.
    pub exact: bool,
}

/// Properties of a row beyond its published numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RowDefinition {
    /// Labels of the published row.
    pub published: Vec<String>,
    /// The methods that reproduce it.
    #[serde(default)]
    pub method: Option<MethodRule>,
    /// The preset, if rows are settings.
    #[serde(default)]
    pub preset: Option<String>,
    /// Whether a line is drawn above it.
    #[serde(default)]
    pub rule_above: bool,
}

/// A column in TOML: a quantity such as `"psnr"`, or a table.
#[derive(Deserialize)]
#[serde(untagged)]
enum ColumnToml {
    Name(Quantity),
    Table(ColumnTable),
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct ColumnTable {
    quantity: Quantity,
    published: Option<String>,
    title: Option<String>,
    #[serde(default)]
    exact: bool,
}

impl From<ColumnToml> for ColumnDefinition {
    fn from(column: ColumnToml) -> Self {
        let ColumnTable { quantity, published, title, exact } = match column {
            ColumnToml::Name(quantity) => ColumnTable { quantity, published: None, title: None, exact: false },
            ColumnToml::Table(table) => table,
        };
        Self { quantity, published: published.unwrap_or_else(|| quantity.id().to_owned()), title, exact }
    }
}

impl ColumnDefinition {
    /// Its heading.
    pub(crate) fn title(&self) -> &str {
        self.title.as_deref().unwrap_or_else(|| self.quantity.title())
    }
}

impl TableDefinition {
    /// Names of the built-in tables, in the order of a report.
    pub fn names() -> impl Iterator<Item = &'static str> {
        builtin::TABLES.names()
    }

    /// A built-in table by name.
    ///
    /// # Errors
    /// [`ReportError::UnknownTable`].
    pub fn named(name: &str) -> Result<Self, ReportError> {
        let text = builtin::TABLES.text(name).ok_or_else(|| ReportError::UnknownTable {
            expected: Self::names().collect::<Vec<_>>().join(", "),
            found: name.to_owned(),
        })?;
        Self::from_toml(name, text)
    }

    /// Reads a definition; `name` appears in errors.
    ///
    /// # Errors
    /// [`ReportError::Toml`], and [`ReportError::Definition`] if it does not fit its published numbers.
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
    /// [`ReportError::Csv`], [`ReportError::Definition`] if there is no such file.
    pub fn published(&self) -> Result<Published, ReportError> {
        let text = builtin::PUBLISHED.text(&self.published);
        let text = text.ok_or_else(|| self.wrong("a file of eval/published", self.published.clone()))?;
        Published::parse(&self.published, text, self)
    }

    /// Every preset that it needs.
    pub fn presets(&self) -> Vec<&str> {
        let groups = self.groups.iter().filter_map(|group| group.preset.as_deref());
        groups.chain(self.rows.iter().filter_map(|row| row.preset.as_deref())).collect()
    }

    /// The presets of each built-in table.
    ///
    /// # Errors
    /// Those of [`Self::named`].
    pub fn presets_by_name() -> Result<BTreeMap<String, Vec<String>>, ReportError> {
        let presets =
            |name: &str| Ok((name.to_owned(), Self::named(name)?.presets().into_iter().map(str::to_owned).collect()));
        Self::names().map(presets).collect()
    }

    /// The name of the published column.
    pub(crate) fn published_name(group: &ColumnGroup, column: &ColumnDefinition) -> String {
        format!("{}{}", column.published, group.suffix)
    }

    /// The definition of the row with these labels, if any.
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
