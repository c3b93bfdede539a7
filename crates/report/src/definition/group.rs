//! Groups of columns, and the targets that their metrics are over.

use serde::{Deserialize, Serialize};

use super::{ColumnDefinition, MethodRule};

/// What TOML calls [`TargetSet::AllBins`].
const ALL_BINS: &str = "average";

/// Columns with a common heading.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "GroupToml", into = "GroupToml")]
pub struct ColumnGroup {
    /// The heading; empty for none.
    pub title: String,
    /// The measured preset, unless rows specify it.
    pub preset: Option<String>,
    /// The measured methods, unless rows specify them.
    pub method: Option<MethodRule>,
    /// The targets that its metrics are over.
    pub targets: TargetSet,
    /// Suffix of the names of published columns.
    pub suffix: String,
    /// The columns.
    pub columns: Vec<ColumnDefinition>,
}

/// The targets that the metrics of a group are over.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum TargetSet {
    /// All targets.
    #[default]
    All,
    /// Those in the bin of overlap of this name.
    Bin(String),
    /// Those in any bin of overlap.
    AllBins,
    /// Those whose distance from the window of context frames is in this range, in frames on either side.
    Distances([u64; 2]),
}

impl TargetSet {
    /// Whether overlap decides which targets these are.
    pub(crate) const fn is_by_overlap(&self) -> bool {
        matches!(self, Self::Bin(_) | Self::AllBins)
    }

    /// Whether a mean over these targets stands for the protocol's: it is over all, or at least over all in bins.
    pub(crate) const fn is_overall(&self) -> bool {
        matches!(self, Self::All | Self::AllBins)
    }
}

/// A group in TOML.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct GroupToml {
    #[serde(default)]
    title: String,
    #[serde(default)]
    preset: Option<String>,
    #[serde(default)]
    method: Option<MethodRule>,
    /// The bin of overlap, or [`ALL_BINS`].
    #[serde(default)]
    bin: Option<String>,
    #[serde(default)]
    distances: Option<[u64; 2]>,
    #[serde(default)]
    suffix: String,
    columns: Vec<ColumnDefinition>,
}

impl TryFrom<GroupToml> for ColumnGroup {
    type Error = String;

    fn try_from(group: GroupToml) -> Result<Self, String> {
        let GroupToml { title, preset, method, bin, distances, suffix, columns } = group;
        let targets = match (bin, distances) {
            (None, None) => TargetSet::All,
            (Some(bin), None) if bin == ALL_BINS => TargetSet::AllBins,
            (Some(bin), None) => TargetSet::Bin(bin),
            (None, Some(distances)) => TargetSet::Distances(distances),
            (Some(_), Some(_)) => {
                return Err(format!("group {title:?}: expected one of `bin` and `distances`, found both"));
            }
        };
        Ok(Self { title, preset, method, targets, suffix, columns })
    }
}

impl From<ColumnGroup> for GroupToml {
    fn from(group: ColumnGroup) -> Self {
        let ColumnGroup { title, preset, method, targets, suffix, columns } = group;
        let (bin, distances) = match targets {
            TargetSet::All => (None, None),
            TargetSet::Bin(bin) => (Some(bin), None),
            TargetSet::AllBins => (Some(ALL_BINS.to_owned()), None),
            TargetSet::Distances(distances) => (None, Some(distances)),
        };
        Self { title, preset, method, bin, distances, suffix, columns }
    }
}
