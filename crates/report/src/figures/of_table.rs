use std::collections::BTreeSet;
use std::ops::Range;

use atsplat_eval::statistics::{Identical, Leaked, MetricQuery, paired_between};
use atsplat_eval::{Results, TrialKey};
use atsplat_metrics::Definition;

use super::{estimate, metric_of, place_of};
use crate::counted;
use crate::definition::{PlotKind, Quantity, TableDefinition, has_thresholds};
use crate::plot::{
    Ablation, AblationRow, BudgetHistogram, BudgetSeries, CostAxis, Drawing, Estimate, Frontier, FrontierPoint, KPoint,
    KScaling, Origin, OverlapBinMeans, OverlapBinSeries,
};
use crate::table::{BUSY, Group, Place, Row, Source, StoreProtocol, Table, TimeScope, Value};

/// The plots of a measured table, by name.
pub fn of_table(definition: &TableDefinition, table: &Table, sources: &[Source<'_>]) -> Vec<(String, Drawing)> {
    let Some(kind) = definition.plot.filter(|_| table.is_measured()) else { return Vec::new() };
    match kind {
        PlotKind::Frontier => frontiers(table),
        PlotKind::Ablation => ablation(definition, table, sources).into_iter().collect(),
        PlotKind::KScaling => k_scaling(table).into_iter().collect(),
        PlotKind::OverlapBins => overlap_bins(table).into_iter().collect(),
        PlotKind::BudgetHistogram => budget_histogram(table, sources).into_iter().collect(),
    }
}

fn shown(table: &Table) -> impl Iterator<Item = &Row> {
    table.rows.iter().filter(|row| !row.without_leaked)
}

fn name(row: &Row) -> String {
    let labels = row.names();
    let untrained =
        if row.untrained && !labels.iter().any(|label| label.contains("untrained")) { " (untrained)" } else { "" };
    let inference_only = if row.inference_only { " ¶" } else { "" };
    format!("{}{untrained}{inference_only}", labels.join(", "))
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
    let place = group.measured_on.as_ref().map_or_else(String::new, |name| format!(" on {name}"));
    let scenes =
        scenes.map_or_else(String::new, |scenes| format!("; measured{place} over {}", counted(scenes, "scene")));
    let group = if group.title.is_empty() { String::new() } else { format!(", {}", group.title) };
    let inference_only =
        if table.rows.iter().any(|row| row.inference_only) { "; ¶ changed at inference only" } else { "" };
    format!("{}{group}{scenes}{inference_only}", table.title)
}

fn frontiers(table: &Table) -> Vec<(String, Drawing)> {
    let mut plots = Vec::new();
    for (at, group) in table.groups.iter().enumerate() {
        let Some((quality_at, metric)) = metric_of(group) else { continue };
        for (cost, quantity, cost_name) in
            [(CostAxis::Gaussians, Quantity::Gaussians, "gaussians"), (CostAxis::Seconds, Quantity::Seconds, "seconds")]
        {
            let Some(cost_at) = place_of(group, quantity) else { continue };
            let point = |row: &Row| {
                let (spent, quality) = (row.cell((at, cost_at)), row.cell((at, quality_at)));
                let marks = spent.marks();
                Some(FrontierPoint {
                    label: if marks.is_empty() { name(row) } else { format!("{} {marks}", name(row)) },
                    cost: spent.value.number()?,
                    spread: spent.timing.as_ref().map(|timing| timing.spread.quartiles),
                    quality: estimate(quality)?,
                    origin: row.origin,
                    standing: None,
                    ranked: !row.untrained && spent.is_rankable() && quality.is_rankable(),
                    highlighted: false,
                })
            };
            let points: Vec<FrontierPoint> = shown(table).filter_map(point).collect();
            if points.iter().filter(|point| point.origin == Origin::Measured).count() == 0 {
                continue;
            }
            let what =
                if cost == CostAxis::Gaussians { "Gaussians" } else { "time; published times are from other machines" };
            let machine = machine(table, (at, cost_at));
            let frontier = Frontier {
                title: format!("{} against {what}", metric.name),
                subtitle: format!("{}{machine}", subtitle(table, group, at..at + 1)),
                cost,
                quality: metric.into(),
                points,
            };
            let suffix = if table.groups.len() > 1 { format!("-{}", at + 1) } else { String::new() };
            plots.push((format!("{}-{cost_name}{suffix}", table.name), frontier.draw()));
        }
    }
    plots
}

/// The machine of a column of times, and the meaning of their marks.
fn machine(table: &Table, place: Place) -> String {
    let mut timings = table.rows.iter().filter_map(|row| row.cell(place).timing.as_ref());
    let busy = if timings.clone().any(|timing| timing.busy) { format!("; {BUSY} it was busy") } else { String::new() };
    let devices: BTreeSet<&String> = timings.clone().filter_map(|timing| timing.device.as_ref()).collect();
    let devices: String = devices.iter().map(|device| format!("; {device}")).collect();
    let scopes: BTreeSet<String> =
        timings.clone().filter_map(|timing| timing.scope).map(TimeScope::explained).collect();
    let scopes: String = scopes.iter().map(|scope| format!("; {scope}")).collect();
    timings.next().map_or_else(String::new, |timing| format!("; {}{devices}{scopes}{busy}", timing.machine))
}

fn ablation(definition: &TableDefinition, table: &Table, sources: &[Source<'_>]) -> Option<(String, Drawing)> {
    let group = table.groups.first()?;
    let (at, metric) = metric_of(group)?;
    let reference_labels = definition.reference.as_ref()?;
    let published: Vec<&Row> = table.rows.iter().filter(|row| row.origin == Origin::Published).collect();
    let reference = *published.iter().find(|row| row.labels == *reference_labels)?;
    let reproduced = |row: &Row| shown(table).find(|own| own.origin == Origin::Measured && own.answers == row.answers);
    let own_reference = reproduced(reference);
    let row = |row: &Row| {
        let own = reproduced(row);
        AblationRow {
            label: format!(
                "{}{}",
                row.labels.join(", "),
                if own.is_some_and(|own| own.inference_only) { " ¶" } else { "" }
            ),
            published: match &row.cell((0, at)).value {
                Value::Number(number) => Some(Ok(*number)),
                Value::Text(text) => Some(Err(text.clone())),
                Value::Absent => None,
            },
            measured: own.and_then(|own| own.cell((0, at)).value.number()),
            gap: own.zip(own_reference).and_then(|(own, reference)| gap(sources, metric, own, reference)),
        }
    };
    let rows: Vec<AblationRow> =
        published.iter().filter(|other| other.labels != reference.labels).map(|other| row(other)).collect();
    // The plot shows differences: without any there is nothing to draw.
    rows.iter().any(|row| row.gap.is_some()).then_some(())?;
    let ablation = Ablation {
        title: table.title.clone(),
        subtitle: subtitle(table, group, 0..1),
        quality: metric.into(),
        reference: row(reference),
        rows,
    };
    Some((table.name.clone(), ablation.draw()))
}

/// Variant minus reference over the same targets.
fn gap(sources: &[Source<'_>], metric: &Definition, own: &Row, reference: &Row) -> Option<Estimate> {
    let ((a, first), (b, second)) = (measured_from(sources, own)?, measured_from(sources, reference)?);
    let (leaked, identical) = (Leaked::Included, Identical::Excluded);
    let query = |preset, method| MetricQuery { preset, method, metric: metric.id, leaked, identical };
    let pair =
        paired_between((a, &query(first, own.method.as_deref()?)), (b, &query(second, reference.method.as_deref()?)))?;
    Some(Estimate { value: pair.difference, interval: pair.interval })
}

/// The results that the first group of a measured row was computed from, and the name of the protocol in them.
fn measured_from<'a>(sources: &[Source<'a>], row: &'a Row) -> Option<(&'a Results, &'a str)> {
    let StoreProtocol { store, preset, .. } = row.protocol(0)?;
    let source = sources.iter().find(|source| source.label == store)?;
    Some((source.results, preset.as_str()))
}

fn k_scaling(table: &Table) -> Option<(String, Drawing)> {
    let group = table.groups.first()?;
    let (at, metric) = metric_of(group)?;
    let gaussians_at = place_of(group, Quantity::Gaussians);
    let point = |row: &Row| {
        let digits: String = row.labels.first()?.chars().take_while(char::is_ascii_digit).collect();
        let gaussians = gaussians_at.and_then(|at| row.cell((0, at)).value.number());
        Some(KPoint { k: digits.parse().ok()?, quality: estimate(row.cell((0, at)))?, gaussians, origin: row.origin })
    };
    let points: Vec<KPoint> = shown(table).filter_map(point).collect();
    let own = points.iter().filter(|point| point.origin == Origin::Measured).count() > 1;
    let plot = KScaling {
        title: format!("{} against K", metric.name),
        subtitle: subtitle(table, group, 0..1),
        quality: metric.into(),
        points,
    };
    own.then(|| (table.name.clone(), plot.draw()))
}

fn overlap_bins(table: &Table) -> Option<(String, Drawing)> {
    let groups: Vec<(usize, &Group, (usize, &'static Definition))> =
        table.groups.iter().enumerate().filter_map(|(at, group)| Some((at, group, metric_of(group)?))).collect();
    let (_, first, (_, metric)) = groups.first()?;
    let series = |row: &Row| OverlapBinSeries {
        label: format!("{}{}", name(row), if row.origin == Origin::Published { " (paper)" } else { "" }),
        means: groups.iter().map(|(at, _, (column, _))| estimate(row.cell((*at, *column)))).collect(),
        origin: row.origin,
    };
    let plot = OverlapBinMeans {
        title: format!("{} by overlap", metric.name),
        subtitle: subtitle(table, &Group { title: String::new(), ..(*first).clone() }, 0..table.groups.len()),
        quality: (*metric).into(),
        bins: groups.iter().map(|(_, group, _)| group.title.clone()).collect(),
        series: shown(table).map(series).collect(),
    };
    let is_drawn = |series: &OverlapBinSeries| series.means.iter().any(Option::is_some);
    let measured = plot.series.iter().any(|series| series.origin == Origin::Measured && is_drawn(series));
    measured.then(|| (table.name.clone(), plot.draw()))
}

fn budget_histogram(table: &Table, sources: &[Source<'_>]) -> Option<(String, Drawing)> {
    let group = table.groups.first()?;
    let series = |row: &Row| {
        let (results, preset) = measured_from(sources, row)?;
        let is_own = |key: &TrialKey| key.preset == preset && Some(&key.method) == row.method.as_ref();
        let own = results.trials.iter().filter(|trial| is_own(&trial.key));
        let gaussians: Vec<f64> = own.filter_map(|trial| trial.gaussians).map(|count| count as f64).collect();
        let record = results.provenance.methods.iter().find(|own| Some(&own.name) == row.method.as_ref());
        let series = BudgetSeries { label: row.printed_labels().join(", "), gaussians };
        (!series.gaussians.is_empty()).then(|| (series, record.is_some_and(has_thresholds)))
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
    let fixed = fixed.first().and_then(|(series, _)| series.gaussians.first().copied());
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
    use atsplat_eval::{MethodRecord, TargetStatus, TrialStatus};

    use super::*;
    use crate::sample::{SCENES, atsplat, preset, results_over};
    use crate::table::{Mixing, tables};

    /// The second network is cheaper and worse, and first fails in one scene.
    #[test]
    fn rows_that_are_not_ranked_are_on_no_frontier() {
        let methods = vec![atsplat("dear", |_| ()), atsplat("cheap", |_| ())];
        let mut results = results_over(vec![preset("re10k-2v-256")], methods, 4);
        results.trials.iter_mut().filter(|own| own.key.method == "cheap").for_each(|own| own.gaussians = Some(11_520));
        let has_frontier = |results: &Results| {
            let definition = TableDefinition::named("re10k").unwrap();
            let sources = [Source { label: "run", results }];
            let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            let plots = of_table(&definition, &table, &sources);
            let (_, plot) = plots.iter().find(|(name, _)| name == "re10k-gaussians").unwrap();
            plot.texts().any(|text| text == "measured, and their frontier")
        };
        assert!(!has_frontier(&results), "a mean without a scene");
        results.trials.iter_mut().for_each(|own| own.status = TrialStatus::Done);
        for row in results.targets.iter_mut().filter(|row| row.status == TargetStatus::Failed) {
            (row.status, row.scores) = (TargetStatus::Scored, [("psnr".to_owned(), 20.0)].into());
        }
        assert!(has_frontier(&results));
        results.provenance.methods[1].untrained = true;
        assert!(!has_frontier(&results), "random weights");
    }

    /// Answers take 0.26 s; of that, the process says, its encoder takes 0.005 s.
    #[test]
    fn times_of_processes_say_what_they_cover() {
        let texts = |states: bool| {
            let mut results = results_over(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ())], 4);
            results.provenance.methods[0].kind = "exec".to_owned();
            for row in &mut results.timings {
                row.stages = if states { [("encode".to_owned(), vec![0.005; 5])].into() } else { [].into() };
            }
            let definition = TableDefinition::named("re10k").unwrap();
            let sources = [Source { label: "run", results: &results }];
            let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            let plots = of_table(&definition, &table, &sources);
            let text = |name: &str| {
                let (_, plot) = plots.iter().find(|(own, _)| own == name).unwrap();
                plot.texts().collect::<Vec<_>>().join("\n")
            };
            (text("re10k-seconds"), text("re10k-gaussians"))
        };
        for (states, mark, remark) in
            [(true, "ATSplat †", "† as the method states"), (false, "ATSplat ‡", "‡ the whole answer")]
        {
            let (seconds, gaussians) = texts(states);
            assert!(seconds.contains(mark) && seconds.contains(remark), "{seconds}");
            assert!(!gaussians.contains(['†', '‡']), "{gaussians}");
        }
    }

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
            let definition = TableDefinition::named("dynamic_budget").unwrap();
            let sources = [Source { label: "run", results: &results }];
            let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
            let (_, plot) = of_table(&definition, &table, &sources).swap_remove(0);
            plot.texts().map(str::to_owned).collect::<Vec<_>>().join("\n")
        };
        let thresholds = texts(Vec::new());
        assert!(!thresholds.contains("fixed ratios") && thresholds.contains("0.1 / 0.1 / 0.4"), "{thresholds}");
        let all = texts(vec![atsplat("atsplat", |_| ())]);
        assert!(all.contains("fixed ratios, 23K") && all.contains("0.1 / 0.1 / 0.4"), "{all}");
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
}
