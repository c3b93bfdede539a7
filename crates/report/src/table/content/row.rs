//! A row with its labels, cells, and the protocols that were measured for it.

use serde::Serialize;

use super::{Cell, CellIndex};
use crate::plot::Origin;
use crate::table::MeasuredOn;

/// A row.
#[expect(clippy::struct_excessive_bools, reason = "independent facts, each with its own mark")]
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Row {
    /// Its labels.
    pub labels: Vec<String>,
    /// Whether it is published or measured.
    pub origin: Origin,
    /// Position of the published row that it is or reproduces.
    pub published_row: Option<usize>,
    /// What was measured; `None` for published rows.
    pub measured_on: Option<MeasuredOn>,
    /// What the label has to add: changed at inference only, zero-shot, leaked targets excluded, and the like.
    pub remarks: Vec<String>,
    /// Name of the method in its store; `None` for published rows and for rows of several methods.
    pub method: Option<String>,
    /// Label of its store; labels of all its stores, for a mean over trainings.
    pub store: Option<String>,
    /// For each group of columns, the method and the protocol that were measured; empty for published rows.
    #[serde(skip)]
    pub protocols: Vec<Option<StoreProtocol>>,
    /// The same of every training, if it is a mean over trainings (`protocols` are those of the first); else empty.
    #[serde(skip)]
    pub trainings: Vec<Vec<StoreProtocol>>,
    /// Whether its weights are random; such rows are never ranked.
    pub untrained: bool,
    /// Whether its weights are those of another row whose network differs: it was changed after training, at inference only.
    pub inference_only: bool,
    /// Whether the paper trains a separate network for such a row: an ablation that was not retrained.
    #[serde(skip)]
    pub not_retrained: bool,
    /// Whether targets that are also context frames are excluded.
    pub without_leaked: bool,
    /// Whether a line is drawn above it.
    pub rule_above: bool,
    /// Numbers, group by group and column by column.
    pub cells: Vec<Vec<Cell>>,
}

/// A method under a protocol of a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoreProtocol {
    /// Label of the store.
    pub store: String,
    /// Name of the protocol in the store's rows.
    pub preset: String,
    /// Name of the method in the store's rows.
    pub method: String,
    /// What the method's name has to add under this protocol: zero-shot, changed at inference only, and the like.
    pub remarks: Vec<String>,
}

impl Row {
    /// The cell of a column; rows have a cell for every column of their table.
    pub(crate) fn cell(&self, CellIndex { group, column }: CellIndex) -> &Cell {
        &self.cells[group][column]
    }

    /// The protocol that was measured for a group of columns.
    pub(crate) fn protocol(&self, group: usize) -> Option<&StoreProtocol> {
        self.protocols.get(group)?.as_ref()
    }

    /// What was measured for a group of columns: one protocol, or that of each training.
    pub(crate) fn measured(&self, group: usize) -> Vec<&StoreProtocol> {
        let trainings = self.trainings.get(group).map(|protocols| protocols.iter().collect());
        trainings.unwrap_or_else(|| self.protocol(group).into_iter().collect())
    }

    /// What was measured for all groups of columns: the protocols, and those of each training.
    pub(crate) fn all_measured(&self) -> impl Iterator<Item = &StoreProtocol> {
        self.protocols.iter().flatten().chain(self.trainings.iter().flatten())
    }

    /// Whether it is or reproduces the published row that `published` is.
    pub(crate) fn reproduces(&self, published: &Self) -> bool {
        self.published_row.is_some() && self.published_row == published.published_row
    }

    /// Whether it is a mean over several trainings.
    pub(crate) const fn is_over_trainings(&self) -> bool {
        !self.trainings.is_empty()
    }

    /// The labels that are not empty.
    pub(crate) fn names(&self) -> Vec<&str> {
        self.labels.iter().map(String::as_str).filter(|label| !label.is_empty()).collect()
    }

    /// `paper`, or what was measured.
    pub fn origin_text(&self) -> &str {
        self.measured_on.as_ref().map_or("paper", |measured_on| &measured_on.text)
    }

    /// The labels with the row's remarks after the last of them, as tables print them.
    pub fn printed_labels(&self) -> Vec<String> {
        let mut labels = self.labels.clone();
        let last = labels.iter().rposition(|label| !label.is_empty()).unwrap_or_default();
        if let Some(label) = labels.get_mut(last) {
            for remark in &self.remarks {
                label.push_str(if label.is_empty() { "" } else { ", " });
                label.push_str(remark);
            }
        }
        labels
    }

    /// The printed labels as one name: `ATSplat, untrained`.
    pub(in crate::table) fn printed_name(&self) -> String {
        let labels = self.printed_labels();
        labels.iter().map(String::as_str).filter(|label| !label.is_empty()).collect::<Vec<_>>().join(", ")
    }
}
