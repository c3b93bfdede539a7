//! Whether measured rows are in the published order: one vote for each pair of rows.

use atsplat_metrics::Definition;
use atsplat_results::statistics::Leaked;
use serde::Serialize;

use crate::definition::TableDefinition;
use crate::plot::Origin;
use crate::table::comparison::{Difference, differ_in_weights, difference, why_without_difference};
use crate::table::selection::{ComparableResults, MethodRun, is_further_training};
use crate::table::{CellIndex, Row, Table};

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
    /// Measured difference over the targets that both have; over those of all trainings, where there are several.
    pub measured: f64,
    /// Its paired 95 % interval over scenes, and over trainings where there are several; `None` with fewer than 6 scenes.
    pub interval: Option<[f64; 2]>,
    /// Scenes that both have.
    pub scenes: u64,
    /// Number of trainings of each row.
    pub trainings: [usize; 2],
    /// Whether one of them was changed at inference only, where the paper trains a network.
    pub inference_only: bool,
    /// Whether one of them has random weights, whose order says nothing about the method.
    pub untrained: bool,
    /// What the interval says.
    pub outcome: Outcome,
}

/// How a measured order compares with the published one.
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
/// in the last group of columns that has it for both: the average over bins, the largest number of views. Rows whose difference is
/// none of the table's numbers have no order, nor have those of other protocols in a table that was forced, or with other weights of
/// the metric.
pub(in crate::table) fn orders(
    table: &Table,
    definition: &TableDefinition,
    results: &ComparableResults<'_>,
) -> Vec<Order> {
    let published: Vec<&Row> = table.rows.iter().filter(|row| row.origin == Origin::Published).collect();
    let mut orders = Vec::new();
    for (at, first) in published.iter().enumerate() {
        for second in published.iter().skip(at + 1) {
            let mut groups = (0..table.groups.len()).rev();
            orders.extend(groups.find_map(|group| order_in(table, definition, results, group, [*first, *second])));
        }
    }
    orders
}

/// The order of two published rows by the first metric in a group of columns.
fn order_in(
    table: &Table,
    definition: &TableDefinition,
    results: &ComparableResults<'_>,
    group: usize,
    rows: [&Row; 2],
) -> Option<Order> {
    let mut columns = table.groups[group].columns.iter().enumerate();
    let (column, metric) = columns.find_map(|(at, column)| Some((at, column.quantity.metric()?)))?;
    let index = CellIndex { group, column };
    let number = |row: &Row| row.cell(index).value.number();
    let published = number(rows[0])? - number(rows[1])?;
    if published == 0.0 || !definition.groups[group].targets.is_overall() {
        return None;
    }
    let [first, second] = rows.map(|row| reproducing_methods(table, definition, results, row, index));
    compared(results, [&first?, &second?], metric, published, rows)
}

/// The first method that reproduces a published row, and its other trainings; `None` if the difference to one of them is no number of
/// the table.
pub(super) fn reproducing_methods<'a>(
    table: &Table,
    definition: &TableDefinition,
    results: &'a ComparableResults<'a>,
    row: &Row,
    index: CellIndex,
) -> Option<Vec<MethodRun<'a>>> {
    let preset_of_row = definition.row(&row.labels).and_then(|known| known.preset.as_ref());
    let preset = preset_of_row.or(definition.groups[index.group].preset.as_ref())?;
    let mut trainings: Vec<MethodRun<'a>> = Vec::new();
    for measured in table.measured_rows().filter(|other| other.reproduces(row)) {
        let Some(run) = results.run_under(preset, measured) else { continue };
        if is_further_training(&trainings, run) {
            if why_without_difference(measured.cell(index)).is_some() {
                return None;
            }
            trainings.push(run);
        }
    }
    Some(trainings)
}

/// The order of two rows with these trainings; `published` is their published difference.
fn compared(
    results: &ComparableResults<'_>,
    trainings: [&[MethodRun<'_>]; 2],
    metric: &'static Definition,
    published: f64,
    rows: [&Row; 2],
) -> Option<Order> {
    let both = [*trainings[0].first()?, *trainings[1].first()?];
    let found = paired_difference(results, trainings, metric)?;
    Some(Order {
        rows: rows.map(|row| row.names().join(", ")),
        quantity: metric.name,
        published,
        measured: found.value,
        interval: found.interval,
        scenes: found.scenes,
        trainings: trainings.map(<[_]>::len),
        inference_only: both.iter().any(|run| results.is_not_retrained(run.record)),
        untrained: trainings.into_iter().flatten().any(|run| run.record.untrained),
        outcome: Outcome::of(published, found.interval),
    })
}

/// The difference of two rows with these trainings; `None` if one has none, if they were mixed from different protocols, or if weights of
/// the metric differ.
pub(super) fn paired_difference(
    results: &ComparableResults<'_>,
    trainings: [&[MethodRun<'_>]; 2],
    metric: &'static Definition,
) -> Option<Difference> {
    let (first, _) = (trainings[0].first()?, trainings[1].first()?);
    let runs = || trainings.into_iter().flatten().copied();
    let are_comparable = !results.mixed || runs().all(|run| run.part.is_comparable_with(first.part));
    if !are_comparable || differ_in_weights(runs(), metric) {
        return None;
    }
    difference(trainings, metric, Leaked::Included)
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use atsplat_results::{MethodRecord, TargetStatus, TrialStatus};

    use super::*;
    use crate::sample::{preset, random, results_over};
    use crate::table::test_tables::{table_of, trained};

    /// Both trainings lose two of three targets, at which the random selection is 10 dB lower than at the other.
    #[test]
    fn several_trainings_are_compared_over_the_targets_that_all_have() {
        let seeded = |seed: &str| trained(seed, seed, "simulated rooms");
        let other = MethodRecord { weights_sha256: Some("of its own".to_owned()), ..random() };
        let name = other.name.clone();
        let mut results = results_over(vec![preset("rooms-2v-128")], vec![seeded("1"), other, seeded("2")], 6);
        results.trials.iter_mut().for_each(|trial| (trial.status, trial.detail) = (TrialStatus::Done, None));
        for row in &mut results.targets {
            let (is_random, is_hard) = (row.key.method == name, row.target > 0);
            let psnr = 20.0 + 0.5 * f64::from(is_random) - 10.0 * f64::from(is_hard);
            let is_lost = is_hard && !is_random;
            row.status = if is_lost { TargetStatus::NonFinite } else { TargetStatus::Scored };
            row.scores = if is_lost { [].into() } else { [("psnr".to_owned(), psnr)].into() };
        }
        let table = table_of("ablation_ate", &results);
        let [order] = &table.orders[..] else { panic!("{:?}", table.orders) };
        assert_eq!((order.trainings, order.scenes, order.quantity), ([1, 2], 6, "PSNR"), "{order:?}");
        Tolerance::absolute(1e-9).assert([order.measured], [0.5], "the random selection minus the trainings");
    }

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
