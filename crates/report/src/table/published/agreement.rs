//! How many measured values agree with the published ones that they reproduce.

use std::collections::BTreeSet;

use atsplat_results::MetricRecord;
use serde::Serialize;

use super::Outcome;
use crate::definition::Quantity;
use crate::plot::Origin;
use crate::table::content::is_zero;
use crate::table::{Cell, CellIndex, Column, Row, Table};

/// How measured rows compare with the published rows that they reproduce.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Agreement {
    /// Name of the table.
    pub table: String,
    /// The most important values.
    pub headline: Option<Headline>,
    /// Why measured and published values are not comparable: what was measured instead. Empty if they are.
    pub not_comparable: Vec<String>,
    /// Number of values that are both published and measured.
    pub compared: u64,
    /// Those that print the same digits.
    pub equal_as_printed: u64,
    /// The others whose interval contains the published value.
    pub inside: u64,
    /// Those that are over a part of the targets or trials, and are neither equal nor inside.
    #[serde(skip_serializing_if = "is_zero")]
    pub partial: u64,
    /// Those whose metric has learned weights that are known not to be the published ones; they are neither equal nor inside.
    #[serde(skip_serializing_if = "is_zero")]
    pub other_weights: u64,
    /// Pairs of published rows whose measured order is the same, by a paired 95 % interval.
    pub kept: u64,
    /// Pairs whose measured order is the opposite.
    pub reversed: u64,
    /// Pairs whose interval contains 0, or that have none.
    pub undecided: u64,
    /// Whether a pair has too few scenes for an interval.
    pub few_scenes: bool,
    /// Whether a reproduced row has random weights.
    pub untrained: bool,
    /// Whether a reproduced row was changed at inference only, where the paper trains a separate network.
    pub inference_only: bool,
}

/// One quantity of the last published row that is reproduced, because papers print the proposed method last: a printed value
/// for each group of columns.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Headline {
    /// Labels of the published row.
    pub row: String,
    /// Title of the columns.
    pub quantity: &'static str,
    /// The measured values.
    pub measured: Vec<String>,
    /// The published values.
    pub published: Vec<String>,
}

impl std::fmt::Display for Headline {
    /// `ATSplat, PSNR: measured 18.08, 19.61; published 24.09, 26.56`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { row, quantity, measured, published } = self;
        write!(f, "{row}, {quantity}: measured {}; published {}", measured.join(", "), published.join(", "))
    }
}

/// Compares values; if several measured rows reproduce a published row, the first counts. Orders are those of
/// [`Table::orders`].
pub fn agreement(table: &Table) -> Agreement {
    let published = table.rows.iter().filter(|row| row.origin == Origin::Published);
    let reproduced = |row: &Row| table.measured_rows().find(|other| other.reproduces(row));
    let pairs: Vec<(&Row, &Row)> = published.filter_map(|row| Some((row, reproduced(row)?))).collect();
    let measured_on = pairs.iter().filter_map(|(_, measured)| measured.measured_on.as_ref());
    let elsewhere = measured_on.filter(|on| !on.published_setting);
    let places: BTreeSet<&String> = elsewhere.map(|on| &on.place).collect();
    let votes = |outcome| table.orders.iter().filter(|order| order.outcome == outcome).count() as u64;
    let mut agreement = Agreement {
        table: table.name.clone(),
        headline: pairs.last().and_then(|(paper, measured)| headline(table, paper, measured)),
        not_comparable: places.into_iter().cloned().collect(),
        kept: votes(Outcome::Kept),
        reversed: votes(Outcome::Reversed),
        undecided: votes(Outcome::Undecided),
        few_scenes: table.orders.iter().any(|order| order.interval.is_none()),
        untrained: pairs.iter().any(|(_, measured)| measured.untrained),
        inference_only: pairs.iter().any(|(_, measured)| measured.not_retrained),
        ..Agreement::default()
    };
    // Published times were measured on other machines.
    for (index, column) in table.columns().filter(|(_, column)| column.quantity != Quantity::Seconds) {
        for (paper, measured) in &pairs {
            agreement.compare(column, paper.cell(index), measured.cell(index));
        }
    }
    agreement
}

impl Agreement {
    /// Counts a pair of cells, if both have a number.
    fn compare(&mut self, column: &Column, paper: &Cell, cell: &Cell) {
        let (Some(published), Some(measured)) = (paper.value.number(), cell.value.number()) else { return };
        self.compared += 1;
        let counter = if !cell.is_rankable() {
            &mut self.partial
        } else if has_other_weights(column, cell) {
            &mut self.other_weights
        } else if column.format_as_papers(measured) == column.format_as_papers(published) {
            &mut self.equal_as_printed
        } else if cell.interval.is_some_and(|[low, high]| (low..=high).contains(&published)) {
            &mut self.inside
        } else {
            return;
        };
        *counter += 1;
    }
}

/// Whether the learned weights of a cell's metric are known not to be the published ones.
fn has_other_weights(column: &Column, cell: &Cell) -> bool {
    let Some(metric) = column.quantity.metric() else { return false };
    let (id, weights_sha256) = (metric.id.to_owned(), cell.metric_weights.clone());
    MetricRecord { id, weights_sha256, ..MetricRecord::default() }.unpublished().is_some()
}

/// The first metric that both have; without any, their Gaussians, or the last column, to which the others lead.
fn headline(table: &Table, paper: &Row, measured: &Row) -> Option<Headline> {
    let values = |index: CellIndex, column: &Column| {
        let number = |row: &Row| row.cell(index).value.number();
        Some((column.quantity, column.format(number(measured)?), column.format_as_papers(number(paper)?)))
    };
    let both: Vec<_> = table.columns().filter_map(|(index, column)| values(index, column)).collect();
    let is_metric = |quantity: Quantity| quantity.metric().is_some();
    let of_kind = |is_wanted: &dyn Fn(Quantity) -> bool| both.iter().find(|(quantity, ..)| is_wanted(*quantity));
    let is_gaussians = |quantity: Quantity| quantity == Quantity::Gaussians;
    let (first, ..) = of_kind(&is_metric).or_else(|| of_kind(&is_gaussians)).or(both.last())?;
    let of_first = both.iter().filter(|(quantity, ..)| quantity == first);
    let (measured, published) = of_first.map(|(_, measured, paper)| (measured.clone(), paper.clone())).unzip();
    Some(Headline { row: paper.names().join(" "), quantity: first.title(), measured, published })
}

impl std::fmt::Display for Agreement {
    /// `not comparable: measured on simulated rooms, 128×128, 8 of 24 scenes; orders: 1 kept, 0 reversed, 5 undecided`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.compared == 0 {
            return write!(f, "nothing to compare");
        }
        if self.not_comparable.is_empty() {
            write!(f, "{} of {} values agree to the printed digits", self.equal_as_printed, self.compared)?;
            for (count, what) in [
                (self.inside, "more within their interval"),
                (self.partial, "over part of the targets"),
                (self.other_weights, "with other weights of the metric"),
            ] {
                if count > 0 {
                    write!(f, ", {count} {what}")?;
                }
            }
        } else {
            write!(f, "not comparable: measured on {}", self.not_comparable.join("; "))?;
        }
        if self.kept + self.reversed + self.undecided > 0 {
            let Self { kept, reversed, undecided, .. } = self;
            write!(f, "; orders: {kept} kept, {reversed} reversed, {undecided} undecided")?;
        }
        for (applies, what) in [
            (self.few_scenes, "fewer than 6 scenes in common give no interval"),
            (self.inference_only, "changed at inference only, where the paper trains"),
            (self.untrained, "untrained"),
        ] {
            if applies {
                write!(f, "; {what}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use atsplat_results::{Results, TargetStatus};

    use super::*;
    use crate::definition::TableDefinition;
    use crate::sample::{atsplat, preset, results_over};
    use crate::table::{Mixing, Source, tables};

    /// The whole protocol. PSNR and LPIPS are those of the paper in every target, SSIM is not.
    fn store(lpips_weights: &str) -> Results {
        let mut whole = preset("re10k-2v-256");
        (whole.entries, whole.entries_of_index) = (6, 6);
        let mut results = results_over(vec![whole], vec![atsplat("atsplat", |_| ())], 6);
        results.provenance.skipped.clear();
        for metric in results.provenance.metrics.iter_mut().filter(|metric| metric.id == "lpips") {
            (metric.absent, metric.weights_sha256) = (None, Some(lpips_weights.to_owned()));
        }
        let number = |title: &str| {
            let table = built(None);
            let (index, _) = table.columns().find(|(_, column)| column.title == title).unwrap();
            let row = table.rows.iter().find(|row| row.labels == ["ATSplat"]).unwrap();
            row.cell(index).value.number().unwrap()
        };
        let (psnr, lpips) = (number("PSNR"), number("LPIPS"));
        for row in &mut results.targets {
            row.not_computed.clear();
            let scores = [("psnr", psnr), ("ssim", 0.1), ("lpips", lpips)];
            row.scores = scores.map(|(id, score)| (id.to_owned(), score)).into();
        }
        results
    }

    fn built(results: Option<&Results>) -> Table {
        let sources: Vec<Source<'_>> = results.map(|results| Source { label: "run", results }).into_iter().collect();
        tables(&TableDefinition::named("re10k").unwrap(), &sources, Mixing::Apart).unwrap().swap_remove(0)
    }

    /// As many initial tokens as the paper, and other numbers of final ones and of Gaussians.
    #[test]
    fn the_headline_of_counts_is_the_number_of_gaussians() {
        let mut results = store("397923af00");
        results.trials.iter_mut().for_each(|trial| (trial.final_tokens, trial.gaussians) = (Some(1441), Some(23_056)));
        let source = Source { label: "run", results: &results };
        let definition = TableDefinition::named("budget").unwrap();
        let table = tables(&definition, &[source], Mixing::Apart).unwrap().swap_remove(0);
        let headline = agreement(&table).headline.unwrap();
        assert_eq!(headline.quantity, Quantity::Gaussians.title(), "{headline}");
        assert_ne!(headline.measured, headline.published);
    }

    /// 23 900 Gaussians, of which a paper prints 23K.
    #[test]
    fn counts_agree_with_the_digits_of_papers() {
        let mut results = store("397923af00");
        results.trials.iter_mut().for_each(|trial| trial.gaussians = Some(23_900));
        let table = built(Some(&results));
        assert_eq!(agreement(&table).equal_as_printed, 3);
        let (index, column) = table.columns().find(|(_, column)| column.quantity == Quantity::Gaussians).unwrap();
        let measured = table.measured_rows().next().unwrap();
        let paper = table.rows.iter().find(|row| row.origin == Origin::Published && measured.reproduces(row)).unwrap();
        assert_eq!([measured, paper].map(|row| row.cell(index).print(column)), ["23.9K", "23K"]);
    }

    #[test]
    fn means_over_part_of_the_targets_and_other_metrics_are_not_equal() {
        let of = |results: &Results| {
            let found = agreement(&built(Some(results)));
            ([found.equal_as_printed, found.partial, found.other_weights], found.compared, found.to_string())
        };
        let whole = store("397923af00");
        let (counts, compared, said) = of(&whole);
        assert_eq!((compared, counts), (4, [3, 0, 0]), "SSIM differs: {said}");
        assert!(said.starts_with("3 of 4 values agree to the printed digits") && !said.contains("part of"), "{said}");
        // Other weights are another metric.
        let (counts, _, said) = of(&store("0123"));
        assert_eq!(counts, [2, 0, 1], "{said}");
        assert!(said.contains(", 1 with other weights of the metric"), "{said}");
        // One target of 18 is not finite: the means of the others print as published, and so does the number of Gaussians.
        let mut lacking = whole.clone();
        let row = &mut lacking.targets[4];
        row.status = TargetStatus::NonFinite;
        row.scores.clear();
        let (counts, again, said) = of(&lacking);
        assert_eq!((counts, again), ([1, 3, 0], 4), "{said}");
        assert!(said.starts_with("1 of 4 values agree to the printed digits, 3 over part of the targets"), "{said}");
    }
}
