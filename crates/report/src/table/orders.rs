//! Whether measured rows are in the published order: one vote for each pair of rows.

use atsplat_eval::MethodRecord;
use atsplat_eval::statistics::{
    Identical, Leaked, MetricQuery, SceneMean, difference_of_seeds, paired_between, scene_means,
};
use atsplat_metrics::Definition;
use serde::Serialize;

use super::build::is_not_retrained;
use super::edition::{Edition, Part};
use super::{Row, Table};
use crate::definition::{Quantity, TableDefinition};
use crate::plot::Origin;

/// Two published rows that differ, and how the rows that reproduce them differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Order {
    /// Labels of the two published rows.
    pub rows: [String; 2],
    /// Title of the compared column.
    pub quantity: &'static str,
    /// Published difference, first minus second.
    pub published: f64,
    /// Measured difference over the targets that both have.
    pub measured: f64,
    /// Its paired 95 % interval over scenes, and over trainings where there are several; `None` with fewer than 6 scenes.
    pub interval: Option<[f64; 2]>,
    /// Scenes that both have.
    pub scenes: u64,
    /// Number of trainings of each row.
    pub trainings: [usize; 2],
    /// Whether one of them was changed at inference only, where the paper trains a network.
    pub inference_only: bool,
    /// What the interval says.
    pub outcome: Outcome,
}

/// The verdict on an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// The whole interval is on the published side of 0.
    Kept,
    /// The whole interval is on the other side.
    Reversed,
    /// It contains 0, or there is none.
    Undecided,
}

impl Outcome {
    fn of(published: f64, interval: Option<[f64; 2]>) -> Self {
        match interval {
            Some([low, high]) if low > 0.0 || high < 0.0 => {
                if (low > 0.0) == (published > 0.0) {
                    Self::Kept
                } else {
                    Self::Reversed
                }
            }
            _ => Self::Undecided,
        }
    }
}

/// The orders of all pairs of published rows that are reproduced under one protocol. They are compared by their first metric
/// in the last group of columns that has it for both: the average over bins, the largest number of views.
pub(super) fn orders(table: &Table, definition: &TableDefinition, edition: &Edition<'_>) -> Vec<Order> {
    let published: Vec<&Row> = table.rows.iter().filter(|row| row.origin == Origin::Published).collect();
    let mut orders = Vec::new();
    for (at, first) in published.iter().enumerate() {
        for second in published.iter().skip(at + 1) {
            let found = (0..table.groups.len()).rev().find_map(|group| {
                let column = table.groups[group].columns.iter().position(|own| metric_of(own.quantity).is_some())?;
                let metric = metric_of(table.groups[group].columns[column].quantity)?;
                let number = |row: &Row| row.cell((group, column)).value.number();
                let difference = number(first)? - number(second)?;
                let bin = definition.groups[group].bin.as_deref().is_some_and(|bin| bin != "average");
                let rows = [*first, *second];
                let [one, other] = rows.map(|row| reproducing_methods(table, definition, edition, row, group));
                (difference != 0.0 && !bin).then(|| compared(edition, &one, &other, metric, difference, rows)).flatten()
            });
            orders.extend(found);
        }
    }
    orders
}

const fn metric_of(quantity: Quantity) -> Option<&'static Definition> {
    match quantity {
        Quantity::Metric(metric) => Some(metric),
        _ => None,
    }
}

/// Methods, each with the results of its store under one preset.
pub(super) type TrainedMethods<'a> = Vec<(&'a Part<'a>, &'a MethodRecord)>;

/// The first method that reproduces a published row, and its other trainings.
fn reproducing_methods<'a>(
    table: &Table,
    definition: &TableDefinition,
    edition: &'a Edition<'a>,
    row: &Row,
    group: usize,
) -> TrainedMethods<'a> {
    let own = definition.row(&row.labels).and_then(|own| own.preset.as_ref());
    let Some(preset) = own.or(definition.groups[group].preset.as_ref()) else { return Vec::new() };
    let measured = table.rows.iter().filter(|other| other.origin == Origin::Measured && !other.without_leaked);
    let answers = measured.filter(|other| other.answers.is_some() && other.answers == row.answers);
    let mut trainings: TrainedMethods<'a> = Vec::new();
    for method in answers.filter_map(|row| edition.method(preset, row)) {
        if is_further_training(&trainings, method) {
            trainings.push(method);
        }
    }
    trainings
}

/// Whether a method is another training of the network of `known`, from a seed that none of them has: stores may share some.
pub(super) fn is_further_training(
    known: &[(&Part<'_>, &MethodRecord)],
    (part, record): (&Part<'_>, &MethodRecord),
) -> bool {
    known.iter().all(|(own, other)| differs_only_in_seed(other, record) && own.is_consistent_with(part))
}

/// Whether two methods are one network, trained on the same data from different seeds.
fn differs_only_in_seed(a: &MethodRecord, b: &MethodRecord) -> bool {
    let (Some(first), Some(second)) = (&a.training, &b.training) else { return false };
    let differ = a.weights_sha256 != b.weights_sha256 && first.seed != second.seed;
    differ && first.data == second.data && a.kind == b.kind && a.parameters == b.parameters
}

fn compared(
    edition: &Edition<'_>,
    one: &TrainedMethods<'_>,
    other: &TrainedMethods<'_>,
    metric: &'static Definition,
    published: f64,
    rows: [&Row; 2],
) -> Option<Order> {
    let (first, second) = (one.first()?, other.first()?);
    let inference_only = [first, second].iter().any(|(_, record)| is_not_retrained(edition, record));
    let (measured, interval, scenes) = if one.len() + other.len() == 2 {
        let [a, b] = [first, second].map(|own| query(own, metric));
        let pair = paired_between((first.0.source.results, &a), (second.0.source.results, &b))?;
        (pair.difference, pair.interval, pair.scenes)
    } else {
        let [a, b] = [one, other].map(|own| own.iter().map(|own| means(own, metric)).collect::<Vec<_>>());
        let found = difference_of_seeds(&a, &b)?;
        (found.mean, found.interval, found.scenes)
    };
    Some(Order {
        rows: rows.map(|row| row.names().join(", ")),
        quantity: metric.name,
        published,
        measured,
        interval,
        scenes,
        trainings: [one.len(), other.len()],
        inference_only,
        outcome: Outcome::of(published, interval),
    })
}

pub(super) fn query<'a>(
    (part, record): &(&'a Part<'a>, &'a MethodRecord),
    metric: &'static Definition,
) -> MetricQuery<'a> {
    let (leaked, identical) = (Leaked::Included, Identical::Excluded);
    MetricQuery { preset: &part.preset.name, method: &record.name, metric: metric.id, leaked, identical }
}

/// The scene means of a method under a protocol.
pub(super) fn means<'a>(own: &(&'a Part<'a>, &'a MethodRecord), metric: &'static Definition) -> Vec<SceneMean> {
    scene_means(own.0.source.results, &query(own, metric))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_interval_beside_zero_decides() {
        for (published, interval, expected) in [
            (1.0, Some([0.1, 0.4]), Outcome::Kept),
            (-1.0, Some([0.1, 0.4]), Outcome::Reversed),
            (1.0, Some([-0.4, -0.1]), Outcome::Reversed),
            (-1.0, Some([-0.4, -0.1]), Outcome::Kept),
            (1.0, Some([-0.1, 9.0]), Outcome::Undecided),
            (1.0, None, Outcome::Undecided),
        ] {
            assert_eq!(Outcome::of(published, interval), expected, "{published}, {interval:?}");
        }
    }
}
