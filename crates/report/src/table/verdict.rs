use std::collections::BTreeSet;

use serde::Serialize;

use super::{Column, NoteKind, Place, Row, Table};
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
    /// Number of values that are both published and measured.
    pub compared: u64,
    /// Those that print alike, or whose interval contains the published value.
    pub agreeing: u64,
    /// Pairs of published rows, in a column, that differ and are both reproduced.
    pub pairs: u64,
    /// Those whose measured rows differ in the same direction.
    pub ordered: u64,
    /// Whether a reproduced row has random weights.
    pub untrained: bool,
    /// Whether the published setting was run: index, entries, preset.
    pub same_setting: bool,
    /// The presets that were run otherwise.
    pub measured_on: Vec<String>,
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
    /// `Ours, PSNR: measured 18.08, 19.61; published 24.09, 26.56`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { row, quantity, measured, published } = self;
        write!(f, "{row}, {quantity}: measured {}; published {}", measured.join(", "), published.join(", "))
    }
}

/// Compares values and their order; if several measured rows reproduce a published row, the first counts. The order is not
/// compared in columns without a better direction, such as tokens.
pub fn verdict(table: &Table) -> Verdict {
    let same_setting = !table.footer.iter().any(|note| note.kind == NoteKind::Setting);
    let places: BTreeSet<&String> = table.groups.iter().filter_map(|group| group.measured_on.as_ref()).collect();
    let measured_on = places.into_iter().cloned().collect();
    let mut verdict = Verdict { table: table.name.clone(), same_setting, measured_on, ..Verdict::default() };
    let published = table.rows.iter().filter(|row| row.origin == Origin::Published);
    let reproduced = |row: &Row| {
        let mut measured = table.rows.iter().filter(|other| other.origin == Origin::Measured && !other.without_leaked);
        measured.find(|other| other.answers.is_some() && other.answers == row.answers)
    };
    let pairs: Vec<(&Row, &Row)> = published.filter_map(|row| Some((row, reproduced(row)?))).collect();
    verdict.untrained = pairs.iter().any(|(_, own)| own.untrained);
    verdict.headline = pairs.last().and_then(|(paper, own)| headline(table, paper, own));
    for (place, column) in table.columns() {
        // Published times were measured on other machines.
        if column.quantity == Quantity::Seconds {
            continue;
        }
        let of = |row: &Row| row.cell(place).value.number();
        let mut figures: Vec<(f64, f64)> = Vec::new();
        for (paper, own) in &pairs {
            let (Some(published), Some(measured)) = (of(paper), of(own)) else { continue };
            figures.push((published, measured));
            let alike = column.format(measured) == column.format(published);
            let inside = own.cell(place).interval.is_some_and(|[low, high]| (low..=high).contains(&published));
            verdict.agreeing += u64::from(alike || inside);
        }
        verdict.compared += figures.len() as u64;
        if column.direction.is_none() {
            continue;
        }
        for (at, first) in figures.iter().enumerate() {
            for second in figures.iter().skip(at + 1) {
                let (paper, own) = (first.0 - second.0, first.1 - second.1);
                if paper != 0.0 {
                    verdict.pairs += 1;
                    verdict.ordered += u64::from(paper * own > 0.0);
                }
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
    /// `3 of 4 figures agree, 9 of 10 orders kept`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.compared == 0 {
            return write!(f, "nothing to compare");
        }
        write!(f, "{} of {} figures agree", self.agreeing, self.compared)?;
        if self.pairs > 0 {
            write!(f, ", {} of {} orders kept", self.ordered, self.pairs)?;
        }
        if self.untrained {
            write!(f, ", untrained")?;
        }
        if !self.same_setting {
            write!(f, ", not the published setting")?;
            if !self.measured_on.is_empty() {
                write!(f, ": measured on {}", self.measured_on.join(", "))?;
            }
        }
        Ok(())
    }
}
