use std::collections::BTreeSet;

use serde::Serialize;

use super::{Column, Outcome, Place, Row, Table};
use crate::definition::Quantity;
use crate::plot::Origin;

/// How measured rows compare with the published rows that they reproduce.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Verdict {
    /// Name of the table.
    pub table: String,
    /// The most important values.
    pub headline: Option<Headline>,
    /// Why measured and published values are not comparable: what was measured instead. Empty if they are.
    pub not_comparable: Vec<String>,
    /// Number of values that are both published and measured.
    pub compared: u64,
    /// Those that print alike.
    pub alike: u64,
    /// The others whose interval contains the published value.
    pub inside: u64,
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
    /// Whether a reproduced row was changed at inference only, where the paper trains a network of its own.
    pub inference_only: bool,
}

/// One quantity of the last published row that is reproduced, because papers print their own method last: a printed value
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
pub fn verdict(table: &Table) -> Verdict {
    let published = table.rows.iter().filter(|row| row.origin == Origin::Published);
    let reproduced = |row: &Row| {
        let mut measured = table.rows.iter().filter(|other| other.origin == Origin::Measured && !other.without_leaked);
        measured.find(|other| other.answers.is_some() && other.answers == row.answers)
    };
    let pairs: Vec<(&Row, &Row)> = published.filter_map(|row| Some((row, reproduced(row)?))).collect();
    let elsewhere = pairs.iter().filter_map(|(_, own)| own.measured_on.as_ref()).filter(|on| !on.published_setting);
    let places: BTreeSet<&String> = elsewhere.map(|on| &on.place).collect();
    let votes = |outcome| table.orders.iter().filter(|order| order.outcome == outcome).count() as u64;
    let mut verdict = Verdict {
        table: table.name.clone(),
        headline: pairs.last().and_then(|(paper, own)| headline(table, paper, own)),
        not_comparable: places.into_iter().cloned().collect(),
        kept: votes(Outcome::Kept),
        reversed: votes(Outcome::Reversed),
        undecided: votes(Outcome::Undecided),
        few_scenes: table.orders.iter().any(|order| order.interval.is_none()),
        untrained: pairs.iter().any(|(_, own)| own.untrained),
        inference_only: pairs.iter().any(|(_, own)| own.not_retrained),
        ..Verdict::default()
    };
    for (place, column) in table.columns() {
        // Published times were measured on other machines.
        if column.quantity == Quantity::Seconds {
            continue;
        }
        for (paper, own) in &pairs {
            let number = |row: &Row| row.cell(place).value.number();
            let (Some(published), Some(measured)) = (number(paper), number(own)) else { continue };
            verdict.compared += 1;
            if column.format(measured) == column.format(published) {
                verdict.alike += 1;
            } else if own.cell(place).interval.is_some_and(|[low, high]| (low..=high).contains(&published)) {
                verdict.inside += 1;
            }
        }
    }
    verdict
}

/// The first metric that both have, or the first column.
fn headline(table: &Table, paper: &Row, own: &Row) -> Option<Headline> {
    let figures = |place: Place, column: &Column| {
        let print = |row: &Row| row.cell(place).value.number().map(|value| column.format(value));
        Some((column.quantity, print(own)?, print(paper)?))
    };
    let both: Vec<_> = table.columns().filter_map(|(place, column)| figures(place, column)).collect();
    let is_metric = |quantity: Quantity| matches!(quantity, Quantity::Metric(_));
    let (first, ..) = both.iter().find(|(quantity, ..)| is_metric(*quantity)).or(both.first())?;
    let own = both.iter().filter(|(quantity, ..)| quantity == first);
    let (measured, published) = own.map(|(_, own, paper)| (own.clone(), paper.clone())).unzip();
    Some(Headline { row: paper.names().join(" "), quantity: first.title(), measured, published })
}

impl std::fmt::Display for Verdict {
    /// `not comparable: measured on simulated rooms, 128×128, 8 of 24 scenes; orders: 1 kept, 0 reversed, 5 undecided`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.compared == 0 {
            return write!(f, "nothing to compare");
        }
        if self.not_comparable.is_empty() {
            write!(f, "{} of {} figures print alike", self.alike, self.compared)?;
            if self.inside > 0 {
                write!(f, ", {} more within their interval", self.inside)?;
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
