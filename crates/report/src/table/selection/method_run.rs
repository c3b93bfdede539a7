//! A method in the results of one store, and under one of its presets.

use atsplat_metrics::Definition;
use atsplat_results::statistics::{Identical, Leaked, MetricQuery};
use atsplat_results::{MethodRecord, Results, TargetRow, TrialRow};

use super::Part;
use crate::table::StoreProtocol;

/// A method under one preset of one store.
#[derive(Clone, Copy, Debug)]
pub(in crate::table) struct MethodRun<'a> {
    pub(in crate::table) part: &'a Part<'a>,
    pub(in crate::table) record: &'a MethodRecord,
}

/// A method of a store.
#[derive(Clone, Copy, Debug)]
pub(in crate::table) struct StoreMethod<'a> {
    pub(in crate::table) store: &'a str,
    pub(in crate::table) record: &'a MethodRecord,
}

impl StoreMethod<'_> {
    /// Whether it is the method of the same name in the same store.
    pub(in crate::table) fn is(self, other: StoreMethod<'_>) -> bool {
        self.store == other.store && self.record.name == other.record.name
    }
}

impl<'a> MethodRun<'a> {
    /// All results of its store.
    pub(in crate::table) fn results(self) -> &'a Results {
        self.part.source.results
    }

    /// Name of the preset in rows.
    pub(in crate::table) fn preset_name(self) -> &'a str {
        &self.part.preset.name
    }

    /// Name of the method in rows.
    pub(in crate::table) fn method_name(self) -> &'a str {
        &self.record.name
    }

    /// Its trials.
    pub(in crate::table) fn trials(self) -> impl Iterator<Item = &'a TrialRow> {
        self.results().trials_of(self.preset_name(), self.method_name())
    }

    /// Its targets.
    pub(in crate::table) fn targets(self) -> impl Iterator<Item = &'a TargetRow> {
        self.results().targets_of(self.preset_name(), self.method_name())
    }

    /// A metric over targets, without renders that are identical to the truth.
    pub(in crate::table) fn query(self, metric: &'static Definition, leaked: Leaked) -> MetricQuery<'a> {
        let identical = Identical::Excluded;
        MetricQuery { preset: self.preset_name(), method: self.method_name(), metric: metric.id, leaked, identical }
    }

    /// The results of its store, and a metric over all of its targets in them.
    pub(in crate::table) fn over_all_targets(self, metric: &'static Definition) -> (&'a Results, MetricQuery<'a>) {
        (self.results(), self.query(metric, Leaked::Included))
    }

    /// Its names in rows of tables, with the remarks on it.
    pub(in crate::table) fn store_protocol(self, remarks: Vec<String>) -> StoreProtocol {
        let [store, preset, method] =
            [self.part.source.label, self.preset_name(), self.method_name()].map(str::to_owned);
        StoreProtocol { store, preset, method, remarks }
    }
}
