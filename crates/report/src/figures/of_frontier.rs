use std::collections::BTreeMap;

use atsplat_eval::statistics::{Identical, Leaked, MIN_SCENES, MetricQuery, summary};
use atsplat_eval::tradeoff::{Axis, Frontier, Point, Tradeoff, tradeoffs};
use atsplat_eval::{MethodRecord, PresetRecord, Provenance, Results, TrialKey};

use super::{first_metric, subject, title_of};
use crate::ReportError;
use crate::file_names::{plain, unused};
use crate::plot::{CostAxis, Drawing, Estimate, FrontierPoint, Frontiers, Origin};
use crate::table::{BUSY, Source, TimeScope, is_same_data};

/// Accuracy against time and against Gaussians, by name: one plot for each protocol with at least two methods or settings
/// in all stores together. Stores of different images under one name do not share a plot.
///
/// # Errors
/// [`ReportError::Store`] for an invalid protocol in a store.
pub fn of_frontier(sources: &[Source<'_>]) -> Result<Vec<(String, Drawing)>, ReportError> {
    let mut groups: Vec<(&PresetRecord, Vec<Source<'_>>)> = Vec::new();
    for source in sources {
        for preset in &source.results.provenance.presets {
            let name = preset.name.as_str();
            let has_same_data = |other: &Source<'_>| is_same_data([(other.results, name), (source.results, name)]);
            let is_own = |first: &PresetRecord| identity(first) == identity(preset);
            let fits = groups.iter().position(|(first, others)| is_own(first) && others.iter().all(has_same_data));
            match fits {
                Some(at) => groups[at].1.push(*source),
                None => groups.push((preset, vec![*source])),
            }
        }
    }
    let mut plots: Vec<(String, Drawing)> = Vec::new();
    for (preset, stores) in groups {
        if let Some(plot) = frontier(&merged_results(&stores, preset), preset)? {
            // Stores may have other protocols or images under the same name.
            let is_taken = |name: &str| plots.iter().any(|(own, _)| own == name);
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

fn frontier(results: &Results, preset: &PresetRecord) -> Result<Option<Drawing>, ReportError> {
    let Some(metric) = first_metric(results, &preset.name) else { return Ok(None) };
    let aggregation = preset.protocol()?.aggregation;
    let title = |name: &str| {
        let method = results.provenance.methods.iter().find(|method| method.name == name);
        method.map_or_else(|| name.to_owned(), |method| title_of(results, method))
    };
    let point = |frontier: &Frontier, point: &Point| {
        let query = MetricQuery {
            preset: &preset.name,
            method: &point.label,
            metric: metric.id,
            leaked: Leaked::Included,
            identical: Identical::Excluded,
        };
        let whole_answer = point.whole_answer.then_some(WHOLE_ANSWER.mark());
        let marks =
            whole_answer.into_iter().chain(point.busy.then_some(BUSY)).filter(|_| frontier.axis == Axis::Seconds);
        let spread = [point.cost - point.cost_error, point.cost + point.cost_error];
        FrontierPoint {
            label: marks.fold(title(&point.label), |label, mark| format!("{label} {mark}")),
            cost: point.cost,
            spread: (point.cost_error > 0.0).then_some(spread),
            quality: Estimate { value: point.quality, interval: summary(results, &query, aggregation).interval },
            origin: Origin::Measured,
            standing: Some(point.standing),
            ranked: true,
            highlighted: frontier.knee.as_deref() == Some(&point.label),
        }
    };
    let found = tradeoffs(results, &[metric.id], Leaked::Included)?;
    let Some(tradeoff) = found.first() else { return Ok(None) };
    let shown = || tradeoff.frontiers.iter().filter(|frontier| !frontier.points.is_empty());
    if shown().all(|frontier| frontier.points.len() < 2) {
        return Ok(None);
    }
    let machine = tradeoff.machines.first().map_or_else(String::new, |machine| format!("; timed on {machine}"));
    let devices: String = tradeoff.devices.keys().map(|device| format!("; {device}")).collect();
    let points = || shown().flat_map(|frontier| &frontier.points);
    let whole_answer = points().any(|point| point.whole_answer);
    let whole_answer = if whole_answer { format!("; {}", WHOLE_ANSWER.explained()) } else { String::new() };
    let busy = if points().any(|point| point.busy) { format!("; {BUSY} the machine was busy") } else { String::new() };
    let plot = Frontiers {
        title: format!("{} against time to the first image and against Gaussians", metric.name),
        subtitle: format!(
            "{}; 95 % intervals over scenes{machine}{devices}{whole_answer}{busy}",
            subject(results, preset)
        ),
        quality: metric.into(),
        panels: shown()
            .map(|frontier| (cost(frontier.axis), frontier.points.iter().map(|own| point(frontier, own)).collect()))
            .collect(),
        note: note(tradeoff, title),
    };
    Ok(Some(plot.draw()))
}

/// Time to the first image counts all that a process does for it.
const WHOLE_ANSWER: TimeScope = TimeScope::WholeAnswer;

/// The methods on each frontier, what bold and question mark mean, and the methods without a point.
fn note(tradeoff: &Tradeoff, title: impl Fn(&str) -> String) -> String {
    let Tradeoff { frontiers, targets, leaked, .. } = tradeoff;
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
    for frontier in frontiers {
        let mut reasons: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for (label, why) in &frontier.left_out {
            reasons.entry(why).or_default().push(title(label));
        }
        for (why, labels) in reasons {
            parts.push(format!("No point against {}: {} ({why}).", name(frontier.axis), labels.join(", ")));
        }
    }
    parts.join(" ")
}

const fn name(axis: Axis) -> &'static str {
    match axis {
        Axis::Seconds => "time",
        Axis::Gaussians => "Gaussians",
    }
}

const fn cost(axis: Axis) -> CostAxis {
    match axis {
        Axis::Seconds => CostAxis::Seconds,
        Axis::Gaussians => CostAxis::Gaussians,
    }
}

/// The rows of a protocol from stores that have it. A method whose name an earlier store also has gets the name of its store
/// added.
fn merged_results(sources: &[Source<'_>], preset: &PresetRecord) -> Results {
    let mut all = Results::default();
    for source in sources {
        let Results { provenance, trials, targets, timings } = source.results;
        if all.provenance.presets.is_empty() {
            all.provenance = Provenance { presets: vec![preset.clone()], methods: Vec::new(), ..provenance.clone() };
        }
        let mut names: BTreeMap<&str, String> = BTreeMap::new();
        for method in &provenance.methods {
            let is_taken = all.provenance.methods.iter().any(|other| other.name == method.name);
            let named = |text: &str| if is_taken { format!("{text}, {}", source.label) } else { text.to_owned() };
            names.insert(&method.name, named(&method.name));
            let (name, title) = (named(&method.name), named(&method.title));
            all.provenance.methods.push(MethodRecord { name, title, ..method.clone() });
        }
        let renamed = |key: &TrialKey| {
            let name = names.get(key.method.as_str()).filter(|_| key.preset == preset.name)?;
            Some(TrialKey { method: name.clone(), ..key.clone() })
        };
        for row in trials {
            all.trials.extend(renamed(&row.key).map(|key| atsplat_eval::TrialRow { key, ..row.clone() }));
        }
        for row in targets {
            all.targets.extend(renamed(&row.key).map(|key| atsplat_eval::TargetRow { key, ..row.clone() }));
        }
        for row in timings {
            all.timings.extend(renamed(&row.key).map(|key| atsplat_eval::timing::TimingRow { key, ..row.clone() }));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{atsplat, floor, preset, results, results_over};

    #[test]
    fn settings_of_several_stores_are_on_one_frontier() {
        let own = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), floor()]);
        let more = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ())]);
        let sources = [Source { label: "own", results: &own }, Source { label: "more", results: &more }];
        let all = merged_results(&sources, &own.provenance.presets[0]);
        let names: Vec<&str> = all.provenance.methods.iter().map(|method| method.name.as_str()).collect();
        assert_eq!(names, ["atsplat", "nearest-view", "atsplat, more"]);
        assert_eq!(all.trials.len(), own.trials.len() + more.trials.len());
        let plots = of_frontier(&sources).unwrap();
        assert_eq!(plots.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["frontier-re10k-2v-256"]);
        let texts: Vec<&str> = plots[0].1.texts().collect();
        assert!(texts.iter().any(|text| text.contains("No point against Gaussians: Nearest view")), "{texts:?}");
        assert!(texts.iter().any(|text| text.contains("Frontier against time: ")), "{texts:?}");
        assert_eq!(plots[0].1.faults(), []);
    }

    #[test]
    fn times_of_whole_answers_are_marked_on_the_axis_of_time_alone() {
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), atsplat("b", |_| ())]);
        let texts = |results: &Results| {
            let plots = of_frontier(&[Source { label: "own", results }]).unwrap();
            assert_eq!(plots[0].1.faults(), []);
            plots[0].1.texts().map(str::to_owned).collect::<Vec<_>>()
        };
        assert!(!texts(&results).iter().any(|text| text.contains('‡')));
        results.provenance.methods[0].kind = "exec".to_owned();
        let texts = texts(&results);
        let count = |label: &str| texts.iter().filter(|text| text.trim_end_matches(" ?") == label).count();
        assert_eq!([count("ATSplat (a) ‡"), count("ATSplat (a)")], [1, 1], "{texts:?}");
        assert_eq!([count("ATSplat (b) ‡"), count("ATSplat (b)")], [0, 2], "{texts:?}");
        let said = texts.join(" ");
        assert!(said.contains("; ‡ the whole answer, with reading and writing of files"), "{said}");
    }

    /// The second method is 3 dB worse in every scene.
    #[test]
    fn few_scenes_are_named_as_the_reason_for_no_interval() {
        let methods = || vec![atsplat("a", |_| ()), atsplat("b", |_| ())];
        let says = |scenes| {
            let results = results_over(vec![preset("re10k-2v-256")], methods(), scenes);
            let plots = of_frontier(&[Source { label: "own", results: &results }]).unwrap();
            plots[0].1.texts().any(|text| text.contains("With fewer than 6 scenes there is no interval"))
        };
        // The third scene of the second method failed.
        assert_eq!([6, 7].map(says), [true, false]);
    }

    #[test]
    fn protocols_of_one_name_have_plots_of_their_own() {
        let own = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), atsplat("b", |_| ())]);
        let mut changed = own.clone();
        changed.provenance.presets[0].hash = "another".to_owned();
        let mut repainted = own.clone();
        repainted.trials.iter_mut().for_each(|row| row.data_hash = Some("other images".to_owned()));
        for other in [changed, repainted] {
            let sources = [Source { label: "own", results: &own }, Source { label: "elsewhere", results: &other }];
            let plots = of_frontier(&sources).unwrap();
            let names: Vec<&str> = plots.iter().map(|(name, _)| name.as_str()).collect();
            assert_eq!(names, ["frontier-re10k-2v-256", "frontier-re10k-2v-256-2"]);
            let texts: Vec<&str> = plots[0].1.texts().collect();
            assert!(texts.iter().any(|text| text.contains("ATSplat (a)")), "of one title: {texts:?}");
            assert!(!texts.iter().any(|text| text.contains("elsewhere")), "{texts:?}");
        }
    }
}
