mod ablation;
mod costs;

use std::ops::Range;

use atsplat_metrics::Definition;
use atsplat_numeric::distinct;
use atsplat_results::Results;
use atsplat_results::statistics::Leaked;

use super::subject::leaked_targets;
use crate::counted;
use crate::definition::{PlotKind, Quantity, TableDefinition, has_thresholds};
use crate::plot::{
    BudgetHistogram, BudgetSeries, Drawing, Estimate, KPoint, KScaling, Origin, OverlapBinMeans, OverlapBinSeries,
};
use crate::table::{Cell, CellIndex, Group, INFERENCE_ONLY, Row, Source, StoreProtocol, Table};
use ablation::ablation;
use costs::frontiers;

/// The plots of a measured table, by name.
pub fn table_plots(definition: &TableDefinition, table: &Table, sources: &[Source<'_>]) -> Vec<(String, Drawing)> {
    let Some(kind) = definition.plot.filter(|_| table.is_measured()) else { return Vec::new() };
    match kind {
        PlotKind::Frontier => frontiers(table, sources),
        PlotKind::Ablation => ablation(definition, table, sources).into_iter().collect(),
        PlotKind::KScaling => k_scaling(definition, table, sources).into_iter().collect(),
        PlotKind::OverlapBins => overlap_bins(table, sources).into_iter().collect(),
        PlotKind::BudgetHistogram => budget_histogram(table, sources).into_iter().collect(),
    }
}

/// The first metric of a group of columns, with its position.
fn metric_of(group: &Group) -> Option<(usize, &'static Definition)> {
    group.columns.iter().enumerate().find_map(|(at, column)| Some((at, column.quantity.metric()?)))
}

/// Position of the column with a quantity.
fn column_of(group: &Group, quantity: Quantity) -> Option<usize> {
    group.columns.iter().position(|column| column.quantity == quantity)
}

fn estimate(cell: &Cell) -> Option<Estimate> {
    Some(Estimate { value: cell.value.number()?, interval: cell.interval })
}

fn shown(table: &Table) -> impl Iterator<Item = &Row> {
    table.rows.iter().filter(|row| !row.without_leaked)
}

/// The printed labels, with a sign for the longest remark.
fn name(row: &Row) -> String {
    let remarks = row.remarks.iter().map(String::as_str).filter(|remark| *remark != INFERENCE_ONLY);
    let labels: Vec<&str> = row.names().into_iter().chain(remarks).collect();
    format!("{}{}", labels.join(", "), if row.inference_only { " ¶" } else { "" })
}

/// What the sign in names stands for, if a row has it.
fn explained<'a>(mut rows: impl Iterator<Item = &'a Row>) -> String {
    if rows.any(|row| row.inference_only) { format!("; ¶ {INFERENCE_ONLY}") } else { String::new() }
}

/// What the title of a plot adds if these groups of columns were measured in another setting than the published numbers that it
/// shows next to them: on other data, another index, or under a changed protocol.
fn other_setting(table: &Table, drawn: Range<usize>) -> &'static str {
    let is_other = |group: &Group| group.measured_on.is_some();
    let differs = table.is_published() && table.groups.get(drawn).is_some_and(|groups| groups.iter().any(is_other));
    if differs { "; published numbers are of other data or settings" } else { "" }
}

/// What is drawn of a table, from these of its groups of columns; `group` is their heading.
fn subtitle(table: &Table, group: &Group, drawn: Range<usize>) -> String {
    let scenes = table
        .rows
        .iter()
        .filter(|row| row.origin == Origin::Measured)
        .flat_map(|row| row.cells.get(drawn.clone()).unwrap_or_default().iter().flatten())
        .filter_map(|cell| cell.counts)
        .map(|counts| counts.scenes)
        .max();
    let place = group.measured_on.as_ref().map_or_else(String::new, |name| format!(" under {name}"));
    let scenes =
        scenes.map_or_else(String::new, |scenes| format!("; measured{place} over {}", counted(scenes, "scene")));
    let group = if group.title.is_empty() { String::new() } else { format!(", {}", group.title) };
    format!("{}{group}{scenes}", table.title)
}

/// How many of the measured targets of these groups of columns are context frames.
fn leaked_in(table: &Table, drawn: Range<usize>, sources: &[Source<'_>], leaked_are: Leaked) -> String {
    let measured = drawn.flat_map(|group| shown(table).flat_map(move |row| row.measured(group)));
    let protocols = distinct(measured.map(|protocol| (protocol.store.as_str(), protocol.preset.as_str())));
    let protocols = protocols.into_iter().filter_map(|(store, preset)| {
        let source = sources.iter().find(|source| source.label == store)?;
        Some((source.results, preset))
    });
    leaked_targets(protocols, leaked_are)
}

/// The results that the first group of a measured row was computed from, and the name of the protocol in them.
fn measured_from<'a>(sources: &[Source<'a>], row: &'a Row) -> Option<(&'a Results, &'a str)> {
    let StoreProtocol { store, preset, .. } = row.protocol(0)?;
    let source = sources.iter().find(|source| source.label == store)?;
    Some((source.results, preset.as_str()))
}

/// What a reader must know of a plot without names.
const MEANS: &str = "Each training is a point, and so is their mean.";

fn k_scaling(definition: &TableDefinition, table: &Table, sources: &[Source<'_>]) -> Option<(String, Drawing)> {
    let published = definition.published().ok()?.rows;
    let k_of = |row: &Row| {
        let labels = &published.get(row.published_row?)?.labels;
        definition.row(labels)?.method.as_ref()?.gaussians_per_token
    };
    let group = table.groups.first()?;
    let (quality, metric) = metric_of(group)?;
    let gaussians = column_of(group, Quantity::Gaussians);
    let point = |row: &Row| {
        let cell = |column: usize| row.cell(CellIndex { group: 0, column });
        Some(KPoint {
            k: k_of(row)? as f64,
            quality: estimate(cell(quality))?,
            gaussians: gaussians.and_then(|column| cell(column).value.number()),
            origin: row.origin,
        })
    };
    let drawn: Vec<(&Row, KPoint)> = shown(table).filter_map(|row| Some((row, point(row)?))).collect();
    let points: Vec<KPoint> = drawn.iter().map(|(_, point)| *point).collect();
    // Several trainings of one K are no curve.
    let measured: Vec<f64> =
        points.iter().filter(|point| point.origin == Origin::Measured).map(|point| point.k).collect();
    let is_curve = measured.windows(2).any(|pair| pair[0].total_cmp(&pair[1]).is_ne());
    let mut notes = Vec::new();
    notes.extend(shown(table).any(Row::is_over_trainings).then(|| MEANS.to_owned()));
    let mut mark = |what: &str, has: fn(&Row) -> bool| {
        let marked = drawn.iter().filter(|(row, _)| has(row)).filter_map(|(row, _)| k_of(row));
        let ks: Vec<String> = distinct(marked).into_iter().map(|k| k.to_string()).collect();
        notes.extend((!ks.is_empty()).then(|| format!("{what}: K = {}.", ks.join(", "))));
    };
    mark("Random weights", |row| row.untrained);
    mark("Changed at inference only", |row| row.inference_only);
    let plot = KScaling {
        title: format!("{} against K{}", metric.name, other_setting(table, 0..1)),
        subtitle: format!("{}{}", subtitle(table, group, 0..1), leaked_in(table, 0..1, sources, Leaked::Included)),
        quality: metric.into(),
        points,
        note: notes.join(" "),
    };
    is_curve.then(|| (table.name.clone(), plot.draw()))
}

fn overlap_bins(table: &Table, sources: &[Source<'_>]) -> Option<(String, Drawing)> {
    let bins: Vec<(CellIndex, &Group, &'static Definition)> = table
        .groups
        .iter()
        .enumerate()
        .filter_map(|(at, group)| {
            let (column, metric) = metric_of(group)?;
            Some((CellIndex { group: at, column }, group, metric))
        })
        .collect();
    let (_, first, metric) = bins.first()?;
    // Bins are small, and the score of a copied context frame is four times that of another target: the row without them, which
    // follows its row, is drawn if there is one.
    let series = |(at, row): (usize, &Row)| {
        let without_leaked = table.rows.get(at + 1).filter(|next| next.without_leaked);
        let means = bins.iter().map(|(index, ..)| estimate(without_leaked.unwrap_or(row).cell(*index)));
        let paper = if row.origin == Origin::Published { " (paper)" } else { "" };
        OverlapBinSeries { label: format!("{}{paper}", name(row)), means: means.collect(), origin: row.origin }
    };
    let rows = table.rows.iter().enumerate().filter(|(_, row)| !row.without_leaked);
    let plot = OverlapBinMeans {
        title: format!("{} by overlap{}", metric.name, other_setting(table, 0..table.groups.len())),
        subtitle: format!(
            "{}{}{}",
            subtitle(table, &Group { title: String::new(), ..(*first).clone() }, 0..table.groups.len()),
            leaked_in(table, 0..table.groups.len(), sources, Leaked::Excluded),
            explained(shown(table))
        ),
        quality: (*metric).into(),
        bins: bins.iter().map(|(_, group, _)| group.title.clone()).collect(),
        // A mean over trainings has no numbers for single bins.
        series: rows.map(series).filter(|series| series.means.iter().any(Option::is_some)).collect(),
    };
    let measured = plot.series.iter().any(|series| series.origin == Origin::Measured);
    measured.then(|| (table.name.clone(), plot.draw()))
}

fn budget_histogram(table: &Table, sources: &[Source<'_>]) -> Option<(String, Drawing)> {
    let group = table.groups.first()?;
    let series = |row: &Row| {
        let (results, preset) = measured_from(sources, row)?;
        let method = row.method.as_deref()?;
        let counts = results.trials_of(preset, method).filter_map(|trial| trial.gaussians);
        let gaussians: Vec<f64> = counts.map(|count| count as f64).collect();
        let by_thresholds = results.provenance.method(method).is_some_and(has_thresholds);
        let series = BudgetSeries { label: row.printed_labels().join(", "), gaussians };
        (!series.gaussians.is_empty()).then_some((series, by_thresholds))
    };
    let rows: Vec<(BudgetSeries, bool)> =
        shown(table).filter(|row| row.origin == Origin::Measured).filter_map(series).collect();
    let level = |series: &BudgetSeries| series.gaussians.windows(2).all(|pair| pair[0].total_cmp(&pair[1]).is_eq());
    if rows.iter().all(|(series, _)| level(series)) {
        return None;
    }
    // Thresholds may give every scene the same number too.
    let (moving, fixed): (Vec<_>, Vec<_>) =
        rows.into_iter().partition(|(series, by_thresholds)| *by_thresholds || !level(series));
    let fixed = distinct(fixed.iter().filter_map(|(series, _)| series.gaussians.first().copied()));
    let plot = BudgetHistogram {
        title: "Gaussians per scene".to_owned(),
        subtitle: subtitle(table, group, 0..1),
        series: moving.into_iter().map(|(series, _)| series).collect(),
        fixed,
    };
    Some((table.name.clone(), plot.draw()))
}

#[cfg(test)]
mod tests {
    use atsplat_model::config::Selection;
    use atsplat_results::{MethodRecord, TargetRow, TrainingRecord, TrialKey};

    use super::*;
    use crate::definition::Variant;
    use crate::sample::{SCENES, atsplat, nearest_view, preset, results_over};
    use crate::table::{Mixing, tables};

    /// The first thresholds give every scene as many Gaussians as the ratios, the second other numbers.
    #[test]
    fn thresholds_that_give_equal_numbers_are_no_fixed_ratios() {
        let by = |values: [f64; 3]| {
            atsplat(&format!("{values:?}"), |config| *config = config.with_thresholds(&values).unwrap())
        };
        let texts = |more: Vec<MethodRecord>| {
            let methods = [by([0.1, 0.1, 0.4]), by([0.05, 0.05, 0.2])].into_iter().chain(more).collect();
            let mut results = results_over(vec![preset("rooms-2v-128")], methods, 4);
            let second = results.trials.iter_mut().filter(|trial| trial.key.method.contains("0.05"));
            for (at, trial) in (0..).zip(second) {
                trial.gaussians = Some(30_000 + 1000 * at);
            }
            let half = results.trials.iter_mut().filter(|trial| trial.key.method == "half");
            half.for_each(|trial| trial.gaussians = Some(11_520));
            let definition = TableDefinition::named("dynamic_budget").unwrap();
            let sources = [Source { label: "run", results: &results }];
            let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            let (_, plot) = table_plots(&definition, &table, &sources).swap_remove(0);
            plot.texts().map(str::to_owned).collect::<Vec<_>>().join("\n")
        };
        let thresholds = texts(Vec::new());
        assert!(!thresholds.contains("fixed ratios") && thresholds.contains("0.1 / 0.1 / 0.4"), "{thresholds}");
        let ratios = || atsplat("atsplat", |_| ());
        let all = texts(vec![ratios()]);
        assert!(all.contains("fixed ratios, 23K\n") && all.contains("0.1 / 0.1 / 0.4"), "{all}");
        let [again, half] = ["again", "half"].map(|name| MethodRecord { name: name.to_owned(), ..ratios() });
        let all = texts(vec![ratios(), again, half]);
        assert!(all.contains("fixed ratios, 23K and 11.5K\n"), "{all}");
    }

    #[test]
    fn a_plot_over_k_does_not_depend_on_how_rows_are_called() {
        let k = |k| atsplat(&format!("network {k}"), |config| config.head.gaussians_per_token = k);
        let results = results_over(vec![preset("re10k-2v-256")], vec![k(8), k(32)], 4);
        let sources = [Source { label: "run", results: &results }];
        let texts = |definition: &TableDefinition| {
            let table = tables(definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            let plots = table_plots(definition, &table, &sources);
            plots.iter().flat_map(|(_, plot)| plot.texts()).map(str::to_owned).collect::<Vec<_>>()
        };
        let definition = TableDefinition::named("k_scaling").unwrap();
        let mut renamed = definition.clone();
        renamed.labels[0].text.insert_str(0, "K=");
        renamed.rows.iter_mut().for_each(|row| row.published[0].insert_str(0, "K="));
        assert!(!texts(&definition).is_empty());
        assert_eq!(texts(&renamed), texts(&definition));
    }

    #[test]
    fn networks_of_one_k_are_no_curve_beside_published_ones() {
        let k = |name: &str, k| atsplat(name, |config| config.head.gaussians_per_token = k);
        let plots = |methods: Vec<MethodRecord>| {
            let results = results_over(vec![preset("re10k-2v-256")], methods, 4);
            let sources = [Source { label: "run", results: &results }];
            let definition = TableDefinition::named("k_scaling").unwrap();
            let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            let measured = shown(&table).filter(|row| row.origin == Origin::Measured).count();
            (measured, table_plots(&definition, &table, &sources).len())
        };
        assert_eq!(plots(vec![k("a", 8), k("b", 8)]), (2, 0));
        assert_eq!(plots(vec![k("a", 8), k("b", 32)]), (2, 1));
    }

    /// The nano network has 16; one with 8 selects at random by its weights, and one with 32 was not trained.
    #[test]
    fn a_plot_over_k_says_which_points_are_of_no_training_of_their_own() {
        let k = |k| atsplat(&format!("network {k}"), |config| config.head.gaussians_per_token = k);
        let said = |methods: Vec<MethodRecord>, of_eight: Option<Variant>| {
            let results = results_over(vec![preset("re10k-2v-256")], methods, 4);
            let sources = [Source { label: "run", results: &results }];
            let mut definition = TableDefinition::named("k_scaling").unwrap();
            let rules = definition.rows.iter_mut().filter_map(|row| row.method.as_mut());
            rules
                .filter(|rule| rule.gaussians_per_token == Some(8))
                .for_each(|rule| rule.variant.clone_from(&of_eight));
            let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            let (_, plot) = table_plots(&definition, &table, &sources).swap_remove(0);
            assert_eq!(plot.faults(), []);
            plot.texts().map(str::to_owned).collect::<Vec<_>>().join(" ")
        };
        let of_its_own = Some("of its own".to_owned());
        let changed = atsplat("network 8", |config| {
            config.head.gaussians_per_token = 8;
            config.expansion.selection = Selection::Random { seed: 1 };
        });
        let random = MethodRecord { untrained: true, weights_sha256: of_its_own.clone(), ..k(32) };
        let marked = said(vec![atsplat("atsplat", |_| ()), changed, random], Some(Variant::Random));
        assert!(marked.contains("Random weights: K = 32. Changed at inference only: K = 8."), "{marked}");
        let trained = said(vec![atsplat("atsplat", |_| ()), MethodRecord { weights_sha256: of_its_own, ..k(8) }], None);
        assert!(!trained.contains("Random") && !trained.contains("inference"), "{trained}");
    }

    /// Eight scenes with two views, three with four.
    #[test]
    fn a_plot_of_one_group_counts_the_scenes_of_this_group() {
        let presets = ["yards-2v-128x224", "yards-4v-128x224"].map(preset).to_vec();
        let mut results = results_over(presets, vec![atsplat("atsplat", |_| ())], 8);
        let is_left_out =
            |key: &TrialKey| key.preset == "yards-4v-128x224" && !SCENES[..3].contains(&key.scene.as_str());
        results.trials.retain(|trial| !is_left_out(&trial.key));
        results.targets.retain(|target| !is_left_out(&target.key));
        let definition = TableDefinition::named("dl3dv").unwrap();
        let source = Source { label: "run", results: &results };
        let table = tables(&definition, &[source], Mixing::Apart).unwrap().swap_remove(0);
        let said = |at: usize, drawn| subtitle(&table, &table.groups[at], drawn);
        assert!(said(0, 0..1).contains("over 8 scenes"), "{}", said(0, 0..1));
        assert!(said(1, 1..2).contains("over 3 scenes"), "{}", said(1, 1..2));
        assert!(said(0, 0..3).contains("over 8 scenes"), "{}", said(0, 0..3));
    }

    #[test]
    fn context_frames_are_not_in_the_bins_that_are_drawn() {
        let definition = TableDefinition::named("re10k_overlap").unwrap();
        let drawn = |score: f64, is_leaked: bool| {
            let mut results =
                results_over(vec![preset("re10k-overlap")], vec![atsplat("a", |_| ()), nearest_view()], 8);
            let is_copy = |row: &&mut TargetRow| row.leaked && row.key.method == nearest_view().name;
            for row in results.targets.iter_mut().filter(is_copy) {
                row.scores.insert("psnr".to_owned(), score);
            }
            results.targets.iter_mut().for_each(|row| row.leaked &= is_leaked);
            let sources = [Source { label: "run", results: &results }];
            let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            table_plots(&definition, &table, &sources).swap_remove(0).1.to_svg().unwrap()
        };
        assert_eq!(drawn(60.0, true), drawn(20.0, true));
        assert_ne!(drawn(60.0, false), drawn(20.0, false), "of a frame that is no context frame");
    }

    /// The mean over two trainings has no numbers for bins, and the first training is random.
    #[test]
    fn a_legend_names_what_is_drawn_with_its_remarks() {
        let trained = |seed: &str| MethodRecord {
            weights_sha256: Some(seed.repeat(16)),
            untrained: seed == "1",
            training: Some(TrainingRecord { data: "RE10K".to_owned(), seed: Some(seed.to_owned()) }),
            ..atsplat(seed, |_| ())
        };
        let results = results_over(vec![preset("re10k-overlap")], vec![trained("1"), trained("2")], 8);
        let definition = TableDefinition::named("re10k_overlap").unwrap();
        let sources = [Source { label: "run", results: &results }];
        let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
        assert!(table.rows.iter().any(Row::is_over_trainings));
        let (_, plot) = table_plots(&definition, &table, &sources).swap_remove(0);
        assert_eq!(plot.faults(), []);
        let texts: Vec<&str> = plot.texts().collect();
        for expected in ["ATSplat (1), untrained", "ATSplat (2)"] {
            assert!(texts.contains(&expected), "{expected}: {texts:?}");
        }
        assert!(!texts.iter().any(|text| text.contains("mean of 2 trainings")), "{texts:?}");
        assert!(
            texts.iter().any(|text| text.ends_with("; without 1 of 24 targets, which is a context frame")),
            "{texts:?}"
        );
    }
}
