use atsplat_metrics::Definition;
use atsplat_results::statistics::Leaked;
use atsplat_results::tradeoff::Axis;

use super::{column_of, estimate, explained, leaked_in, metric_of, name, other_setting, shown, subtitle};
use crate::definition::Quantity;
use crate::plot::{Drawing, FrontierPoint, Frontiers, Origin};
use crate::plot_data::timed::Timed;
use crate::plot_data::without_point::without_point;
use crate::table::{Cell, CellIndex, CellTiming, Row, Source, Table, Value};

/// The columns of a plot.
#[derive(Clone, Copy)]
struct Columns {
    axis: Axis,
    cost: CellIndex,
    quality: CellIndex,
    metric: &'static Definition,
}

/// Quality against Gaussians and against seconds, for each group of columns that has them.
pub(super) fn frontiers(table: &Table, sources: &[Source<'_>]) -> Vec<(String, Drawing)> {
    let mut plots = Vec::new();
    for (at, group) in table.groups.iter().enumerate() {
        let Some((quality, metric)) = metric_of(group) else { continue };
        for (axis, quantity, cost_name) in
            [(Axis::Gaussians, Quantity::Gaussians, "gaussians"), (Axis::Seconds, Quantity::Seconds, "seconds")]
        {
            let Some(cost) = column_of(group, quantity) else { continue };
            let [cost, quality] = [cost, quality].map(|column| CellIndex { group: at, column });
            let columns = Columns { axis, cost, quality, metric };
            let Some(plot) = frontier(table, columns, sources) else { continue };
            let suffix = if table.groups.len() > 1 { format!("-{}", at + 1) } else { String::new() };
            plots.push((format!("{}-{cost_name}{suffix}", table.name), plot.draw()));
        }
    }
    plots
}

/// `None` without a measured point.
fn frontier(table: &Table, columns: Columns, sources: &[Source<'_>]) -> Option<Frontiers> {
    let Columns { axis, cost, quality, metric } = columns;
    let why_unranked = table.why_unranked(&[cost, quality]);
    let rows: Vec<(&Row, FrontierPoint)> =
        shown(table).filter_map(|row| Some((row, point(row, columns, why_unranked.is_empty())?))).collect();
    let measured = || rows.iter().map(|(row, _)| *row).filter(|row| row.origin == Origin::Measured);
    measured().next()?;
    let mut timed = Timed::default();
    for row in measured() {
        if let Some(timing) = &row.cell(cost).timing {
            timed.add(&name(row), &timing.machine, timing.device.as_deref());
            timed.trials(&name(row), [timing.trials, timing.trials_there]);
            timed.mark(timing.scope, timing.busy);
        }
    }
    let mut notes = Vec::new();
    if !why_unranked.is_empty() {
        notes.push(format!("The measured rows have no frontier, because {}.", why_unranked.join(", and because ")));
    }
    let of_trainings = |row: &Row| row.is_over_trainings() && row.cell(quality).interval.is_some();
    if measured().any(of_trainings) {
        notes.push("The interval of a mean of trainings is over these too.".to_owned());
    }
    let at = quality.group;
    let published = rows.iter().any(|(row, _)| row.origin == Origin::Published);
    let setting = if published { other_setting(table, at..at + 1) } else { "" };
    let what = match axis {
        Axis::Gaussians => "Gaussians",
        Axis::Seconds => "time",
    };
    let is_of_others = published && axis == Axis::Seconds;
    let machines = if is_of_others { "; published times are from other machines" } else { "" };
    let stated: Vec<String> = measured().filter(|row| row.cell(cost).is_stated_count()).map(name).collect();
    if !stated.is_empty() {
        notes.push(format!("Gaussians were stated, not counted, of {}.", stated.join(", ")));
    }
    let lacks_results = |row: &&Row| [cost, quality].iter().any(|index| row.cell(*index).lacks_results());
    let incomplete: Vec<String> = measured().filter(lacks_results).map(name).collect();
    if why_unranked.is_empty() && !incomplete.is_empty() {
        notes.push(format!("Not ranked, because their means lack targets or trials: {}.", incomplete.join(", ")));
    }
    let left_out = shown(table).filter_map(|row| Some((why_without_point(row, columns, what)?, name(row))));
    notes.extend(without_point(what, left_out));
    Some(Frontiers {
        title: format!("{} against {what}{setting}{machines}", metric.name),
        subtitle: format!(
            "{}{}{}{}",
            subtitle(table, &table.groups[at], at..at + 1),
            leaked_in(table, at..at + 1, sources, Leaked::Included),
            timed.in_words(),
            explained(shown(table))
        ),
        quality: metric.into(),
        panels: vec![(axis, rows.into_iter().map(|(_, point)| point).collect())],
        note: notes.join(" "),
    })
}

/// Why a row has no point; `None` if it has both numbers, and a cost that a logarithmic axis has a place for. `what` names the cost.
fn why_without_point(row: &Row, columns: Columns, what: &str) -> Option<String> {
    let Columns { axis, cost, quality, metric } = columns;
    let reason = |cell: &Cell, what: &str| match (&cell.value, &cell.not_computed) {
        (Value::Number(_), _) => None,
        (Value::Text(text), _) => Some(text.clone()),
        (Value::Absent, Some(why)) => Some(why.clone()),
        (Value::Absent, None) if row.origin == Origin::Published => Some("not published".to_owned()),
        (Value::Absent, None) if row.measured(quality.group).is_empty() => Some("not measured".to_owned()),
        (Value::Absent, None) => Some(format!("no {what}")),
    };
    let unit = match axis {
        Axis::Gaussians => "Gaussians",
        Axis::Seconds => "seconds",
    };
    let without_place = || row.cell(cost).value.number().filter(|spent| *spent <= 0.0);
    let free = || without_place().map(|spent| format!("{spent} {unit}"));
    reason(row.cell(quality), metric.name).or_else(|| reason(row.cell(cost), what)).or_else(free)
}

/// The point of a row that has both numbers, and a cost above 0; `compares` says whether the table ranks the measured rows of these columns.
fn point(row: &Row, columns: Columns, compares: bool) -> Option<FrontierPoint> {
    let (spent, quality) = (row.cell(columns.cost), row.cell(columns.quality));
    let marks = spent.marks();
    let compares = compares || row.origin == Origin::Published;
    Some(FrontierPoint {
        label: if marks.is_empty() { name(row) } else { format!("{} {marks}", name(row)) },
        cost: spent.value.number().filter(|spent| *spent > 0.0)?,
        spread: spent.timing.as_ref().and_then(CellTiming::quartiles),
        quality: estimate(quality)?,
        origin: row.origin,
        standing: None,
        ranked: compares && !row.untrained && spent.is_rankable() && quality.is_rankable(),
        highlighted: false,
    })
}

#[cfg(test)]
mod tests {
    use atsplat_results::{
        MethodRecord, Results, StatedCost, StatedSeconds, TargetStatus, TrainingRecord, TrialStatus,
    };

    use super::*;
    use crate::definition::TableDefinition;
    use crate::plot_data::table_plots;
    use crate::sample::{SCENES, atsplat, nearest_view, preset, results, results_over};
    use crate::table::{Mixing, tables};

    const FRONTIER: &str = "measured, and their frontier";

    /// All texts of a plot of the first table, one in a line.
    fn texts(stores: &[&Results], mixing: Mixing, plot: &str) -> String {
        let labels = ["one", "two"];
        let sources: Vec<Source<'_>> =
            labels.iter().zip(stores).map(|(label, results)| Source { label, results }).collect();
        let definition = TableDefinition::named("re10k").unwrap();
        let table = tables(&definition, &sources, mixing).unwrap().swap_remove(0);
        let plots = table_plots(&definition, &table, &sources);
        let (_, plot) = plots.iter().find(|(name, _)| name == plot).unwrap();
        assert_eq!(plot.faults(), []);
        plot.texts().collect::<Vec<_>>().join("\n")
    }

    fn has_frontier(texts: &str) -> bool {
        texts.lines().any(|text| text == FRONTIER)
    }

    /// Stores of the methods `a` and `b`, which is 1 dB better, and takes twice the time and twice the Gaussians.
    fn two_stores() -> [Results; 2] {
        let [first, mut second] =
            ["a", "b"].map(|method| results(vec![preset("re10k-2v-256")], vec![atsplat(method, |_| ())]));
        for row in &mut second.targets {
            row.scores.values_mut().for_each(|score| *score += 1.0);
        }
        second.trials.iter_mut().for_each(|trial| trial.gaussians = Some(46_080));
        second.timings.iter_mut().flat_map(|row| &mut row.encode).for_each(|secs| *secs *= 2.0);
        [first, second]
    }

    #[test]
    fn times_of_different_machines_have_no_frontier() {
        let [first, mut second] = two_stores();
        let said = texts(&[&first, &second], Mixing::Apart, "re10k-seconds");
        assert!(has_frontier(&said) && said.contains("; timed on a processor, 2 threads"), "{said}");
        second.timings.iter_mut().for_each(|row| row.machine.processor = "another processor".to_owned());
        let said = texts(&[&first, &second], Mixing::Apart, "re10k-seconds");
        assert!(!has_frontier(&said), "{said}");
        for expected in [
            "; ATSplat (a): timed on a processor, 2 threads on 2 logical processors",
            "; ATSplat (b): timed on another processor, 2 threads on 2 logical processors",
            "The measured rows have no frontier, because times are of different machines or devices.",
        ] {
            assert!(said.contains(expected), "{expected}: {said}");
        }
        assert!(has_frontier(&texts(&[&first, &second], Mixing::Apart, "re10k-gaussians")), "Gaussians compare");
    }

    /// The whole published protocol, 4 of its 7194 entries, and a stand-in.
    #[test]
    fn titles_say_that_published_numbers_are_of_another_setting() {
        let title = |results: &Results, plot| texts(&[results], Mixing::Apart, plot).lines().next().unwrap().to_owned();
        let [part, _] = two_stores();
        let mut whole = part.clone();
        whole.provenance.presets[0].entries_of_index = whole.provenance.presets[0].entries;
        whole.provenance.skipped.clear();
        assert_eq!(title(&whole, "re10k-gaussians"), "PSNR against Gaussians");
        assert_eq!(title(&whole, "re10k-seconds"), "PSNR against time; published times are from other machines");
        let rooms = results(vec![preset("rooms-2v-128")], vec![atsplat("a", |_| ())]);
        let other = "published numbers are of other data or settings";
        for results in [&part, &rooms] {
            assert_eq!(title(results, "re10k-gaussians"), format!("PSNR against Gaussians; {other}"));
            let said = title(results, "re10k-seconds");
            assert_eq!(said, format!("PSNR against time; {other}; published times are from other machines"));
        }
    }

    #[test]
    fn a_device_is_that_of_its_method() {
        let [first, mut second] = two_stores();
        second.timings.iter_mut().for_each(|row| row.network_adapter = Some("card".to_owned()));
        let said = texts(&[&first, &second], Mixing::Apart, "re10k-seconds");
        assert!(said.contains("; ATSplat (b): network on card") && !has_frontier(&said), "{said}");
        assert!(!texts(&[&first, &second], Mixing::Apart, "re10k-gaussians").contains("card"));
    }

    #[test]
    fn rows_over_other_targets_or_protocols_have_no_frontier() {
        let [first, mut second] = two_stores();
        second.trials.retain(|row| row.key.scene != SCENES[1]);
        second.targets.retain(|row| row.key.scene != SCENES[1]);
        let said = texts(&[&first, &second], Mixing::Apart, "re10k-gaussians");
        assert!(!has_frontier(&said) && said.contains("because rows are over different scenes or targets."), "{said}");
        let [first, mut second] = two_stores();
        second.provenance.presets[0].hash = "another".to_owned();
        let said = texts(&[&first, &second], Mixing::Forced, "re10k-gaussians");
        assert!(!has_frontier(&said) && said.contains("because rows are of different protocols."), "{said}");
    }

    /// The second network is cheaper and worse, and first fails in one scene.
    #[test]
    fn rows_that_are_not_ranked_are_on_no_frontier() {
        let methods = vec![atsplat("dear", |_| ()), atsplat("cheap", |_| ())];
        let mut results = results_over(vec![preset("re10k-2v-256")], methods, 4);
        let cheap = results.trials.iter_mut().filter(|trial| trial.key.method == "cheap");
        cheap.for_each(|trial| trial.gaussians = Some(11_520));
        let said = |results: &Results| texts(&[results], Mixing::Apart, "re10k-gaussians");
        let incomplete = said(&results);
        assert!(!has_frontier(&incomplete), "a mean without a scene");
        let why = "Not ranked, because their means lack targets or trials: ATSplat (cheap).";
        assert!(incomplete.contains(why), "{incomplete}");
        results.trials.iter_mut().for_each(|trial| trial.status = TrialStatus::Done);
        for row in results.targets.iter_mut().filter(|row| row.status == TargetStatus::Failed) {
            (row.status, row.scores) = (TargetStatus::Scored, [("psnr".to_owned(), 20.0)].into());
        }
        assert!(has_frontier(&said(&results)) && !said(&results).contains("Not ranked"));
        results.provenance.methods[1].untrained = true;
        assert!(!has_frontier(&said(&results)), "random weights");
        assert!(said(&results).lines().any(|text| text == "ATSplat (cheap), untrained"), "{}", said(&results));
    }

    /// Two methods of the paper have no time, and the nearest view has neither cost; its row without leaked targets is not named.
    #[test]
    fn rows_without_a_cost_are_named_with_the_reason() {
        let results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), nearest_view()]);
        let said = |plot| texts(&[&results], Mixing::Apart, plot);
        let (gaussians, seconds) = (said("re10k-gaussians"), said("re10k-seconds"));
        let of = |text: &str| text.lines().filter(|line| line.contains("No point")).collect::<Vec<_>>().join(" ");
        assert!(of(&gaussians).ends_with("No point against Gaussians: Nearest view (no Gaussians)."), "{gaussians}");
        assert_eq!(of(&gaussians).matches("No point").count(), 1, "{gaussians}");
        let expected = "No point against time: GS-LRM, LongLRM (not published). \
                        No point against time: Nearest view (the method makes no Gaussians from images).";
        assert!(of(&seconds).ends_with(expected), "{seconds}");
    }

    /// A method that only renders has nothing to make before its first image.
    #[test]
    fn a_row_whose_cost_is_0_is_named() {
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), nearest_view()]);
        results.timings.clear();
        for (method, encode) in results.provenance.methods.iter_mut().zip([0.25, 0.0]) {
            let seconds = Some(StatedSeconds { encode, render: Some(0.5), machine: "a card".to_owned() });
            method.stated.insert("re10k-2v-256".to_owned(), StatedCost { gaussians: None, seconds });
        }
        let said = texts(&[&results], Mixing::Apart, "re10k-seconds");
        assert!(said.contains("No point against time: Nearest view (0 seconds)."), "{said}");
    }

    /// Answers take 0.26 s; of that, the process says, its encoder takes 0.005 s.
    #[test]
    fn times_of_processes_say_what_they_cover() {
        let both = |states: bool| {
            let mut results = results_over(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ())], 4);
            results.provenance.methods[0].kind = "exec".to_owned();
            for row in &mut results.timings {
                row.stages = if states { [("encode".to_owned(), vec![0.005; 5])].into() } else { [].into() };
            }
            ["re10k-seconds", "re10k-gaussians"].map(|plot| texts(&[&results], Mixing::Apart, plot))
        };
        for (states, mark, remark) in
            [(true, "ATSplat †", "† as the method states"), (false, "ATSplat ‡", "‡ the whole answer")]
        {
            let [seconds, gaussians] = both(states);
            assert!(seconds.contains(mark) && seconds.contains(remark), "{seconds}");
            assert!(!gaussians.contains(['†', '‡']), "{gaussians}");
        }
    }

    #[test]
    fn a_mean_of_trainings_is_named_with_what_its_interval_covers() {
        let trained = |seed: &str| MethodRecord {
            weights_sha256: Some(seed.repeat(16)),
            training: Some(TrainingRecord { data: "RE10K".to_owned(), seed: Some(seed.to_owned()) }),
            ..atsplat(seed, |_| ())
        };
        let said = |count| {
            let results = results_over(vec![preset("re10k-2v-256")], vec![trained("1"), trained("2")], count);
            texts(&[&results], Mixing::Apart, "re10k-gaussians")
        };
        let (many, few) = (said(8), said(4));
        let covered = "Bars: 95 % intervals over scenes. The interval of a mean of trainings is over these too.";
        assert!(many.lines().any(|text| text == "ATSplat, mean of 2 trainings") && many.contains(covered), "{many}");
        assert!(!few.contains("interval"), "{few}");
    }
}
