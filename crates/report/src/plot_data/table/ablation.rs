use atsplat_results::statistics::Leaked;

use super::{explained, leaked_in, metric_of, other_setting, shown, subtitle};
use crate::definition::TableDefinition;
use crate::plot::{Ablation, AblationRow, Drawing, Origin};
use crate::table::{CellIndex, Row, Source, Table, Value};

/// What a reader must know of rows that were measured several times: trainings of one network are one row.
const FIRST: &str = "Of several measured rows with one label, the first is shown.";
/// The same of rows with several trainings.
const TRAININGS: &str = "Rows of several trainings show their means; their intervals are over trainings too.";

/// The differences to the reference row, published and measured.
pub(super) fn ablation(
    definition: &TableDefinition,
    table: &Table,
    sources: &[Source<'_>],
) -> Option<(String, Drawing)> {
    let group = table.groups.first()?;
    let (column, metric) = metric_of(group)?;
    let index = CellIndex { group: 0, column };
    let reference_labels = definition.reference.as_ref()?;
    let published: Vec<&Row> = table.rows.iter().filter(|row| row.origin == Origin::Published).collect();
    let reference = *published.iter().find(|row| row.labels == *reference_labels)?;
    let reproducing = |row: &Row| {
        let position = row.published_row;
        shown(table).filter(move |other| other.origin == Origin::Measured && other.published_row == position)
    };
    let row = |row: &Row| {
        let measured = measured_row(reproducing(row));
        let mut gaps = table.to_reference.iter();
        let gap = gaps.find(|(position, _)| Some(*position) == row.published_row);
        AblationRow {
            label: label(row, measured),
            published: match &row.cell(index).value {
                Value::Number(number) => Some(Ok(*number)),
                Value::Text(text) => Some(Err(text.clone())),
                Value::Absent => None,
            },
            measured: measured.and_then(|row| row.cell(index).value.number()),
            gap: gap.map(|(_, difference)| *difference),
        }
    };
    let rows: Vec<AblationRow> =
        published.iter().filter(|other| other.labels != reference.labels).map(|other| row(other)).collect();
    // The plot shows differences: without any there is nothing to draw.
    rows.iter().any(|row| row.gap.is_some()).then_some(())?;
    let methods = |row: &Row| reproducing(row).filter(|row| !row.is_over_trainings()).count();
    let lacks_methods = |row: &Row, drawn: &Row| drawn.measured(0).len() < methods(row);
    let drawn: Vec<(&Row, &Row)> =
        published.iter().filter_map(|row| Some((*row, measured_row(reproducing(row))?))).collect();
    let notes = [
        (drawn.iter().any(|(row, drawn)| lacks_methods(row, drawn)), FIRST),
        (drawn.iter().any(|(_, drawn)| drawn.is_over_trainings()), TRAININGS),
    ];
    let notes: Vec<&str> = notes.into_iter().filter(|(applies, _)| *applies).map(|(_, note)| note).collect();
    let ablation = Ablation {
        title: format!("{}{}", table.title, other_setting(table, 0..1)),
        subtitle: format!(
            "{}{}{}",
            subtitle(table, group, 0..1),
            leaked_in(table, 0..1, sources, Leaked::Included),
            explained(shown(table))
        ),
        quality: metric.into(),
        reference: row(reference),
        rows,
        note: notes.join(" "),
    };
    Some((table.name.clone(), ablation.draw()))
}

/// The label of a published row, with marks of the row that reproduces it.
fn label(row: &Row, measured: Option<&Row>) -> String {
    let untrained = if measured.is_some_and(|row| row.untrained) { ", untrained" } else { "" };
    let inference_only = if measured.is_some_and(|row| row.inference_only) { " ¶" } else { "" };
    format!("{}{untrained}{inference_only}", row.labels.join(", "))
}

/// The first of the rows that reproduce a published row, or the mean over its trainings if there are several.
fn measured_row<'a>(reproducing: impl Iterator<Item = &'a Row>) -> Option<&'a Row> {
    let rows: Vec<&Row> = reproducing.collect();
    let first = *rows.first()?;
    let is_mean_of_first =
        |row: &&Row| row.is_over_trainings() && first.protocol(0).is_some_and(|one| row.measured(0).contains(&one));
    Some(rows.iter().copied().find(is_mean_of_first).unwrap_or(first))
}

#[cfg(test)]
mod tests {
    use atsplat_results::{MethodRecord, TrainingRecord};

    use crate::definition::TableDefinition;
    use crate::plot_data::table_plots;
    use crate::sample::{atsplat, preset, random, results_over};
    use crate::table::{Mixing, Outcome, Source, tables};

    fn trained(seed: &str) -> MethodRecord {
        MethodRecord {
            weights_sha256: Some(seed.repeat(16)),
            training: Some(TrainingRecord { data: "simulated rooms".to_owned(), seed: Some(seed.to_owned()) }),
            ..atsplat(&format!("seed {seed}"), |_| ())
        }
    }

    /// Trainings of the full network at 0 and −6 dB, the random selection at −3: the plot says what `orders.md` says.
    #[test]
    fn differences_are_of_all_trainings_as_in_orders() {
        let said = |methods: Vec<MethodRecord>| {
            let results = results_over(vec![preset("rooms-2v-128")], methods, 7);
            let sources = [Source { label: "run", results: &results }];
            let definition = TableDefinition::named("ablation_ate").unwrap();
            let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            let (_, plot) = table_plots(&definition, &table, &sources).swap_remove(0);
            let gap = table.to_reference[0].1;
            assert_eq!((gap.value, gap.interval), (table.orders[0].measured, table.orders[0].interval), "one pair");
            (table.orders[0].outcome, gap.value, plot.texts().map(str::to_owned).collect::<Vec<_>>().join("\n"))
        };
        let other = MethodRecord { weights_sha256: Some("of its own".to_owned()), ..random() };
        let (outcome, gap, texts) = said(vec![trained("1"), other.clone(), trained("2")]);
        assert!(outcome == Outcome::Undecided && gap.abs() < 1e-9, "{gap}");
        assert!(texts.contains(super::TRAININGS) && !texts.contains(super::FIRST), "{texts}");
        let (outcome, gap, texts) = said(vec![trained("1"), other]);
        assert!(outcome == Outcome::Kept && (gap + 3.0).abs() < 1e-9, "{gap}");
        assert!(texts.contains("(−3.00)") && !texts.contains("several"), "{texts}");
    }

    /// Two networks of one label that are no trainings of each other.
    #[test]
    fn of_other_rows_with_one_label_the_first_is_shown() {
        let second = MethodRecord { training: None, ..trained("2") };
        let other = MethodRecord { weights_sha256: Some("of its own".to_owned()), ..random() };
        let results = results_over(vec![preset("rooms-2v-128")], vec![trained("1"), other, second], 7);
        let sources = [Source { label: "run", results: &results }];
        let definition = TableDefinition::named("ablation_ate").unwrap();
        let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
        let (_, plot) = table_plots(&definition, &table, &sources).swap_remove(0);
        let texts = plot.texts().collect::<Vec<_>>().join("\n");
        assert!(
            texts.contains(super::FIRST) && !texts.contains(super::TRAININGS) && texts.contains("(−3.00)"),
            "{texts}"
        );
    }
}
