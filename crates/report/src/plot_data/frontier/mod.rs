mod merge;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use atsplat_numeric::grouped;
use atsplat_results::PresetRecord;
use atsplat_results::statistics::{Identical, Leaked, MIN_SCENES, MetricQuery, summary};
use atsplat_results::times::{Times, times};
use atsplat_results::tradeoff::{Axis, Incomplete, Note, Tradeoff, tradeoffs};

use super::first_metric;
use super::subject::{FewerTargets, fewer_targets, subject, title_of, unfinished};
use super::timed::Timed;
use super::without_point::without_point;
use crate::ReportError;
use crate::file_names::{plain, unused};
use crate::plot::{Drawing, Estimate, FrontierPoint, Frontiers, Origin};
use crate::table::{BUSY, Source, TimeScope, is_same_data};
use merge::{merged_results, remove_untrained};

/// Accuracy against time and against Gaussians, by name: one plot for each protocol with at least two methods or settings
/// in all stores together; methods with random weights have no point. Stores of different images under one name do not share a
/// plot.
///
/// # Errors
/// [`ReportError::Store`] for an invalid protocol in a store.
pub fn frontier_plots(sources: &[Source<'_>]) -> Result<Vec<(String, Drawing)>, ReportError> {
    let mut groups: Vec<(&PresetRecord, Vec<Source<'_>>)> = Vec::new();
    for source in sources {
        for preset in &source.results.provenance.presets {
            let name = preset.name.as_str();
            let has_same_data = |other: &Source<'_>| is_same_data([(other.results, name), (source.results, name)]);
            let is_same = |first: &PresetRecord| identity(first) == identity(preset);
            let fitting = groups.iter().position(|(first, others)| is_same(first) && others.iter().all(has_same_data));
            match fitting {
                Some(at) => groups[at].1.push(*source),
                None => groups.push((preset, vec![*source])),
            }
        }
    }
    let mut plots: Vec<(String, Drawing)> = Vec::new();
    for (preset, stores) in groups {
        if let Some(plot) = frontier(&stores, preset)? {
            // Stores may have other protocols or images under the same name.
            let is_taken = |name: &str| plots.iter().any(|(other, _)| other == name);
            let name = unused(&format!("frontier-{}", plain(&preset.name)), is_taken);
            plots.push((name, plot));
        }
    }
    Ok(plots)
}

/// What two records of the same protocol on the same index share.
fn identity(preset: &PresetRecord) -> (&str, &str, &str) {
    (&preset.name, &preset.hash, &preset.index_sha256)
}

fn frontier(sources: &[Source<'_>], preset: &PresetRecord) -> Result<Option<Drawing>, ReportError> {
    let mut results = merged_results(sources, preset);
    let titles: BTreeMap<String, String> =
        results.provenance.methods.iter().map(|method| (method.name.clone(), title_of(&results, method))).collect();
    let untrained = remove_untrained(&mut results);
    let Some(metric) = first_metric(&results, preset) else { return Ok(None) };
    let aggregation = preset.protocol()?.aggregation;
    let found = tradeoffs(&results, &[metric.id], Leaked::Included)?;
    let Some(tradeoff) = found.first() else { return Ok(None) };
    let shown = || tradeoff.frontiers.iter().filter(|frontier| !frontier.points.is_empty());
    if shown().all(|frontier| frontier.points.len() < 2) {
        return Ok(None);
    }
    let title = |name: &str| titles.get(name).cloned().unwrap_or_else(|| name.to_owned());
    let interval = |method: &str| {
        let (leaked, identical) = (Leaked::Included, Identical::Excluded);
        let query = MetricQuery { preset: &preset.name, method, metric: metric.id, leaked, identical };
        summary(&results, &query, aggregation).interval
    };
    let mut timed = Timed::default();
    let mut panels = Vec::new();
    for frontier in shown() {
        let is_time = frontier.axis == Axis::Seconds;
        let mut points = Vec::new();
        for setting in &frontier.points {
            let name = title(&setting.label);
            let times = if is_time { times(&results, &preset.name, &setting.label).ok() } else { None };
            if let Some(Times { machine, device, trials, trials_there, .. }) = &times {
                timed.add(&name, machine, device.as_deref());
                timed.trials(&name, [*trials, *trials_there]);
                timed.mark(setting.whole_answer.then_some(WHOLE_ANSWER), setting.busy);
            }
            let whole_answer = setting.whole_answer.then_some(WHOLE_ANSWER.mark());
            let marks = whole_answer.into_iter().chain(setting.busy.then_some(BUSY)).filter(|_| is_time);
            points.push(FrontierPoint {
                label: marks.fold(name, |label, mark| format!("{label} {mark}")),
                cost: setting.cost,
                spread: times.as_ref().and_then(Times::quartiles),
                quality: Estimate { value: setting.quality, interval: interval(&setting.label) },
                origin: Origin::Measured,
                standing: Some(setting.standing),
                ranked: true,
                highlighted: frontier.knee.as_deref() == Some(&setting.label),
            });
        }
        panels.push((frontier.axis, points));
    }
    let mut notes = note(tradeoff, &title);
    if !untrained.is_empty() {
        let titles: Vec<String> = untrained.iter().map(|name| title(name)).collect();
        notes.push(format!("No point: {} (random weights).", titles.join(", ")));
    }
    let lacking = lacking(sources, preset);
    if !lacking.is_empty() {
        notes.push(format!("Incomplete: {}.", lacking.join("; ")));
    }
    let plot = Frontiers {
        title: title_over(metric.name, panels.iter().map(|(cost, _)| *cost)),
        subtitle: format!("{}{}", subject(&results, preset), timed.in_words()),
        quality: metric.into(),
        panels,
        note: notes.join(" "),
    };
    Ok(Some(plot.draw()))
}

/// `PSNR against time to the first image and against Gaussians`, with the costs that have a panel.
fn title_over(metric: &str, costs: impl Iterator<Item = Axis>) -> String {
    let costs = costs.map(|cost| match cost {
        Axis::Seconds => "against time to the first image",
        Axis::Gaussians => "against Gaussians",
    });
    format!("{metric} {}", costs.collect::<Vec<_>>().join(" and "))
}

/// Time to the first image counts all that a process does for it.
const WHOLE_ANSWER: TimeScope = TimeScope::WholeAnswer;

/// What stores lack of their runs under a protocol, after their labels if there are several.
fn lacking(sources: &[Source<'_>], preset: &PresetRecord) -> Vec<String> {
    let of_store = |source: &Source<'_>| {
        let store = if sources.len() > 1 { format!("{}, ", source.label) } else { String::new() };
        let unfinished = unfinished(source.results, |name, _| name == preset.name);
        unfinished.into_iter().map(|text| format!("{store}{text}")).collect::<Vec<_>>()
    };
    sources.iter().flat_map(of_store).collect()
}

/// The methods on each frontier, what bold and question mark mean, means over fewer targets, and the methods without a point.
fn note(tradeoff: &Tradeoff, title: &dyn Fn(&str) -> String) -> Vec<String> {
    let Tradeoff { frontiers, targets, leaked, incomplete, notes, .. } = tradeoff;
    let mut parts = Vec::new();
    if *leaked > 0 {
        parts.push(format!("{leaked} of {targets} targets are context views, which an optimisation fits."));
    }
    for frontier in frontiers {
        let on: Vec<String> =
            frontier.points.iter().filter(|point| point.on_frontier()).map(|point| title(&point.label)).collect();
        if !on.is_empty() {
            parts.push(format!("Frontier against {}: {}.", name(frontier.axis), on.join(", then ")));
        }
    }
    parts.push(
        "Bold: on the frontier, by a paired difference whose 95 % interval excludes 0; ?: the interval contains 0."
            .to_owned(),
    );
    let points = || frontiers.iter().flat_map(|frontier| &frontier.points);
    if points().filter_map(|point| point.against.as_ref()).any(|against| against.difference.interval.is_none()) {
        parts.push(format!("With fewer than {MIN_SCENES} scenes there is no interval: nothing is distinguishable."));
    }
    let fewer = |Incomplete { label, counts, of_scenes, of_targets }: &Incomplete| FewerTargets {
        title: title(label),
        scenes: [counts.scenes, *of_scenes],
        targets: [counts.targets, *of_targets],
    };
    parts.extend(fewer_targets(&incomplete.iter().map(fewer).collect::<Vec<_>>()));
    let of_settings = notes.iter().filter_map(|Note { label, text }| Some((text, title(label.as_ref()?))));
    parts.extend(grouped(of_settings).into_iter().map(|(text, titles)| format!("{}: {text}.", titles.join(", "))));
    parts.extend(notes.iter().filter(|note| note.label.is_none()).map(|Note { text, .. }| format!("{text}.")));
    for frontier in frontiers {
        let left_out = frontier.left_out.iter().map(|(label, why)| (why.clone(), title(label)));
        parts.extend(without_point(name(frontier.axis), left_out));
    }
    parts
}

const fn name(axis: Axis) -> &'static str {
    match axis {
        Axis::Seconds => "time",
        Axis::Gaussians => "Gaussians",
    }
}
