mod overlap;
mod time;

use std::collections::BTreeSet;

use atsplat_metrics::Definition;
use atsplat_numeric::decimals_of_interval;
use atsplat_protocol::{Aggregation, Preset};
use atsplat_results::statistics::{
    Identical, Leaked, MetricQuery, Summary, by_distance_steps, paired, paired_scene_means,
};
use atsplat_results::{MethodRecord, PresetRecord, RecordKind, Results, TargetStatus};

use super::first_metric;
use super::subject::{leaked_targets, scenes_of_trials, subject_over, title_of, unfinished};
use crate::file_names::plain;
use crate::numbers::{signed, with_minus_sign};
use crate::plot::{
    Drawing, Estimate, ExtrapolationDecay, ExtrapolationPoint, ExtrapolationSeries, ScatterPanel, ScatterPoint,
    SceneScatter,
};
use crate::table::{Source, has_trials};
use crate::{ReportError, counted};

/// The plots of each protocol in a store, by name: its PSNR by overlap, by distance from the window and by scene, and the time; the first
/// computed metric in place of a PSNR that was not scored.
///
/// # Errors
/// [`ReportError::Store`] for an invalid protocol in the store.
pub fn store_plots(source: &Source<'_>) -> Result<Vec<(String, Drawing)>, ReportError> {
    let mut plots = Vec::new();
    for preset in &source.results.provenance.presets {
        let protocol = ProtocolResults { results: source.results, preset, protocol: preset.protocol()? };
        let name = |kind: &str| format!("{}-{}-{kind}", plain(source.label), plain(&preset.name));
        if let Some(metric) = protocol.metric() {
            plots.extend(protocol.overlap(metric)?.map(|plot| (name("overlap"), plot)));
            plots.extend(protocol.extrapolation(metric).map(|plot| (name("extrapolation"), plot)));
            plots.extend(protocol.scatter(metric).map(|plot| (name("scenes"), plot)));
        }
        plots.extend(protocol.time().map(|plot| (name("time"), plot)));
    }
    Ok(plots)
}

/// The results of one protocol in a store.
struct ProtocolResults<'a> {
    results: &'a Results,
    preset: &'a PresetRecord,
    /// The protocol that the record contains as text.
    protocol: Preset,
}

impl<'a> ProtocolResults<'a> {
    fn query(&self, method: &'a str, metric: &'static Definition) -> MetricQuery<'a> {
        let (leaked, identical) = (Leaked::Included, Identical::Excluded);
        MetricQuery { preset: &self.preset.name, method, metric: metric.id, leaked, identical }
    }

    /// Of a curve, where the mean of few targets is a point: a single copied context frame, of 100 dB, would be its height.
    fn query_of_curve(&self, method: &'a str, metric: &'static Definition) -> MetricQuery<'a> {
        MetricQuery { leaked: Leaked::Excluded, ..self.query(method, metric) }
    }

    fn methods(&self) -> impl Iterator<Item = &'a MethodRecord> {
        let ran = |method: &&MethodRecord| has_trials(self.results, &self.preset.name, &method.name);
        self.results.provenance.methods.iter().filter(ran)
    }

    fn title(&self, method: &MethodRecord) -> String {
        title_of(self.results, method)
    }

    fn metric(&self) -> Option<&'static Definition> {
        first_metric(self.results, self.preset)
    }

    /// Protocol, scenes, and what the store lacks of its run: what every plot of the protocol is about.
    fn subject(&self) -> String {
        self.subject_over(None)
    }

    /// The same for a plot of so many of the scenes.
    fn subject_over(&self, shown: Option<u64>) -> String {
        let lacking = unfinished(self.results, |preset, _| preset == self.preset.name);
        let lacking: String = lacking.into_iter().map(|text| format!("; {text}")).collect();
        format!("{}{lacking}", subject_over(self.results, self.preset, shown))
    }

    /// Which of the targets are context frames; empty if none is.
    fn leaked_targets(&self, leaked_are: Leaked) -> String {
        leaked_targets([(self.results, self.preset.name.as_str())], leaked_are)
    }

    /// What a plot of curves is about.
    fn subject_of_curves(&self) -> String {
        format!("{}{}", self.subject(), self.leaked_targets(Leaked::Excluded))
    }

    /// `; 2 scenes without a score of ATSplat`, for each of these methods that lacks any; empty if none does.
    fn scenes_without_score(&self, methods: [&MethodRecord; 2], metric: &Definition) -> String {
        let all = scenes_of_trials(self.results, &self.preset.name).len() as u64;
        let without = |method: &MethodRecord| {
            let targets = self.results.targets_of(&self.preset.name, &method.name);
            let scored = targets.filter(|row| row.status == TargetStatus::Scored && row.scores.contains_key(metric.id));
            let scenes: BTreeSet<&str> = scored.map(|row| row.key.scene.as_str()).collect();
            let count = all.saturating_sub(scenes.len() as u64);
            (count > 0).then(|| format!("; {} without a score of {}", counted(count, "scene"), self.title(method)))
        };
        methods.into_iter().filter_map(without).collect()
    }

    fn extrapolation(&self, metric: &'static Definition) -> Option<Drawing> {
        let targets = self.results.targets.iter().filter(|row| row.key.preset == self.preset.name);
        let distances = targets.map(|row| row.signed_distance).filter(|distance| *distance != 0);
        let distances: BTreeSet<i64> = distances.collect();
        let step = step_of(&distances)?;
        let series = |method: &'a MethodRecord| {
            let query = self.query_of_curve(&method.name, metric);
            let steps = by_distance_steps(self.results, &query, step, self.protocol.aggregation);
            let point = |(distance, summary): &(f64, Summary)| {
                Some(ExtrapolationPoint { distance: *distance, mean: estimate(summary)?, scenes: summary.scenes })
            };
            ExtrapolationSeries { label: self.title(method), points: steps.iter().filter_map(point).collect() }
        };
        let together = if step > 1 { format!("{step} distances together, ") } else { String::new() };
        let over = match self.protocol.aggregation {
            Aggregation::SceneMeans => "scenes",
            Aggregation::AllImages => "targets",
        };
        let plot = ExtrapolationDecay {
            title: format!("{} outside the window", metric.name),
            subtitle: format!("{}; {together}means over {over}", self.subject_of_curves()),
            quality: metric.into(),
            step: f64::from(step),
            series: self.methods().map(series).filter(|series| !series.points.is_empty()).collect(),
        };
        (!plot.series.is_empty()).then(|| plot.draw())
    }

    /// The first ATSplat method, or else the first method, against each of the others.
    fn scatter(&self, metric: &'static Definition) -> Option<Drawing> {
        const NAMED: usize = 3;
        let methods: Vec<&MethodRecord> = self.methods().collect();
        let first = methods.iter().find(|method| method.record_kind() == RecordKind::Network).or(methods.first())?;
        let aggregation = self.protocol.aggregation;
        let against = |other: &&'a MethodRecord| {
            let queries = [first, other].map(|method| self.query(&method.name, metric));
            let pair = paired(self.results, &queries[0], &queries[1], aggregation)?;
            let decimals = decimals_of_interval(pair.interval, metric.scale.decimals());
            let signed = |value: f64| with_minus_sign(&signed(value, decimals));
            let interval = pair.interval.map(|ends| ends.map(signed));
            let interval = interval.map_or_else(String::new, |[low, high]| format!(" [{low}, {high}]"));
            let x = self.title(other);
            let difference = format!(
                "{}{interval} against {x}; better in {} of {}, sign test p {}{}",
                signed(pair.difference),
                pair.wins,
                counted(pair.scenes, "scene"),
                p_value(pair.sign_test),
                self.scenes_without_score([*first, *other], metric)
            );
            let means = paired_scene_means(self.results, &queries[0], &queries[1], aggregation);
            let points: Vec<ScatterPoint> =
                means.into_iter().map(|(scene, [y, x])| ScatterPoint { scene, x, y }).collect();
            (!points.is_empty()).then_some((ScatterPanel { x, difference, points }, pair.interval.is_some()))
        };
        let others = methods.iter().filter(|other| other.name != first.name);
        let (panels, has_interval): (Vec<ScatterPanel>, Vec<bool>) = others.filter_map(against).unzip();
        let shown = panels.iter().flat_map(|panel| &panel.points).map(|point| point.scene.as_str());
        let shown = shown.collect::<BTreeSet<_>>().len() as u64;
        let intervals = if has_interval.contains(&true) { " with their 95 % intervals over scenes" } else { "" };
        let plot = SceneScatter {
            title: format!("{} scene by scene: {} against the others", metric.name, self.title(first)),
            subtitle: format!(
                "{}{}; mean differences{intervals}",
                self.subject_over(Some(shown)),
                self.leaked_targets(Leaked::Included)
            ),
            quality: metric.into(),
            y: self.title(first),
            panels,
            named: NAMED,
        };
        (!plot.panels.is_empty()).then(|| plot.draw())
    }
}

fn estimate(summary: &Summary) -> Option<Estimate> {
    Some(Estimate { value: summary.mean?, interval: summary.interval })
}

/// How many distances share a point, a round number, so that each side has at most ten points; `None` without distances.
fn step_of(distances: &BTreeSet<i64>) -> Option<u32> {
    const MAX: u64 = 10;
    let farthest = distances.iter().map(|distance| distance.unsigned_abs()).max()?;
    let round = (0..9).flat_map(|power| [1, 2, 5].map(|digit| digit * 10u32.pow(power)));
    round.into_iter().find(|step| farthest.div_ceil(u64::from(*step)) <= MAX)
}

/// A probability of three decimals after its relation; none is printed as zero.
fn p_value(probability: f64) -> String {
    if probability < 0.001 { "< 0.001".to_owned() } else { format!("= {probability:.3}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{atsplat, nearest_view, preset, results, results_over};

    #[test]
    fn trainings_of_one_title_are_told_apart() {
        let results = results(vec![preset("re10k-2v-256")], ["one", "two"].map(|name| atsplat(name, |_| ())).to_vec());
        let plots = store_plots(&Source { label: "run", results: &results }).unwrap();
        assert!(plots.len() > 2, "distances, scenes and times");
        for (name, plot) in plots {
            let texts = plot.texts().collect::<Vec<_>>().join("\n");
            assert!(["ATSplat (one)", "ATSplat (two)"].iter().all(|title| texts.contains(title)), "{name}: {texts}");
        }
    }

    /// ATSplat is 3 dB worse, and its SSIM is 3 / 32 less, in the three scenes on which it did not fail.
    #[test]
    fn a_difference_has_the_decimals_of_its_metric_and_a_title_keeps_its_hyphens() {
        let other = MethodRecord { title: "re-render".to_owned(), ..nearest_view() };
        let mut results = results(vec![preset("re10k-2v-256")], vec![other, atsplat("atsplat", |_| ())]);
        for difference in ["−3.00", "−0.094"] {
            let expected = format!("{difference} against re-render; better in 0 of 3 scenes");
            let plots = store_plots(&Source { label: "run", results: &results }).unwrap();
            let (_, scenes) = plots.iter().find(|(name, _)| name == "run-re10k-2v-256-scenes").unwrap();
            assert!(scenes.texts().any(|text| text.starts_with(&expected)), "{:?}", scenes.texts().collect::<Vec<_>>());
            results.targets.iter_mut().for_each(|row| row.scores.retain(|metric, _| metric != "psnr"));
        }
    }

    /// All scenes but the one that failed are worse: of 10, with a probability of 2⁻⁹; of 12, of 2⁻¹¹.
    #[test]
    fn no_probability_is_printed_as_zero() {
        for (scenes, expected) in [(10, "sign test p = 0.002"), (12, "sign test p < 0.001")] {
            let methods = vec![nearest_view(), atsplat("atsplat", |_| ())];
            let results = results_over(vec![preset("re10k-2v-256")], methods, scenes + 1);
            let plots = store_plots(&Source { label: "run", results: &results }).unwrap();
            let (_, plot) = plots.iter().find(|(name, _)| name == "run-re10k-2v-256-scenes").unwrap();
            let texts = plot.texts().collect::<Vec<_>>();
            let said = format!("better in 0 of {scenes} scenes, {expected}; 1 scene without a score of ATSplat");
            assert!(texts.iter().any(|text| text.ends_with(&said)), "{said}: {texts:?}");
            let counted = format!("; {scenes} of {} scenes, ", scenes + 1);
            assert!(texts.iter().any(|text| text.contains(&counted)), "{counted}: {texts:?}");
        }
        assert_eq!([0.0, 0.000_999, 0.001, 1.0].map(p_value), ["< 0.001", "< 0.001", "= 0.001", "= 1.000"]);
    }

    #[test]
    fn far_distances_go_together_in_round_steps() {
        let step = |distances: &[i64]| step_of(&distances.iter().copied().collect());
        assert_eq!([step(&[]), step(&[-10, 4]), step(&[-11]), step(&[35, -42])], [None, Some(1), Some(2), Some(5)]);
    }

    /// With four scenes there is no interval.
    #[test]
    fn intervals_are_promised_where_they_are_drawn() {
        let says = |scenes, kind: &str| {
            let methods = vec![atsplat("atsplat", |_| ()), nearest_view()];
            let results = results_over(vec![preset("re10k-2v-256")], methods, scenes);
            let plots = store_plots(&Source { label: "run", results: &results }).unwrap();
            let (_, plot) = plots.iter().find(|(name, _)| *name == format!("run-re10k-2v-256-{kind}")).unwrap();
            let texts = plot.texts().collect::<Vec<_>>().join("\n");
            let left_out = texts.contains("; without 1 of ") && texts.contains("which is a context frame");
            assert!(left_out == (kind == "extrapolation") && texts.contains("is a context frame"), "{texts}");
            texts.contains("95 % intervals over scenes")
        };
        assert_eq!([4, 8].map(|scenes| says(scenes, "scenes")), [false, true]);
        assert_eq!([4, 8].map(|scenes| says(scenes, "extrapolation")), [false, true]);
    }
}
