use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::statistics::{
    Identical, Leaked, MetricQuery, Summary, by_distance_steps, by_overlap, paired, paired_scene_means,
};
use atsplat_eval::timing::{Times, machine_of, times};
use atsplat_eval::{MethodRecord, PresetRecord, Results};
use atsplat_metrics::Definition;
use atsplat_numeric::Extremes as _;
use atsplat_protocol::{BinRule, OverlapBins};

use crate::file_names::plain;
use crate::plot::{
    Drawing, Estimate, ExtrapolationDecay, ExtrapolationSeries, OverlapBin, OverlapCurves, OverlapSeries, ScatterPanel,
    ScatterPoint, SceneScatter, StageTime, StageTimeRow,
};
use crate::table::{BUSY, Source, has_trials};
use crate::{ReportError, counted};

use super::{first_metric, subject, title_of};

/// The plots of each protocol in a store, by name: the first computed metric by overlap, by distance from the window and
/// by scene, and the time.
///
/// # Errors
/// [`ReportError::Store`] for an invalid protocol in the store.
pub fn of_store(source: &Source<'_>) -> Result<Vec<(String, Drawing)>, ReportError> {
    let mut plots = Vec::new();
    for preset in &source.results.provenance.presets {
        let protocol = ProtocolResults { results: source.results, preset };
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
}

impl<'a> ProtocolResults<'a> {
    fn query(&self, method: &'a str, metric: &'static Definition) -> MetricQuery<'a> {
        let (leaked, identical) = (Leaked::Included, Identical::Excluded);
        MetricQuery { preset: &self.preset.name, method, metric: metric.id, leaked, identical }
    }

    fn methods(&self) -> impl Iterator<Item = &'a MethodRecord> {
        let ran = |method: &&MethodRecord| has_trials(self.results, &self.preset.name, &method.name);
        self.results.provenance.methods.iter().filter(ran)
    }

    fn title(&self, method: &MethodRecord) -> String {
        title_of(self.results, method)
    }

    fn metric(&self) -> Option<&'static Definition> {
        first_metric(self.results, &self.preset.name)
    }

    /// Protocol and scenes: what every plot of the protocol is about.
    fn subject(&self) -> String {
        subject(self.results, self.preset)
    }

    fn overlap(&self, metric: &'static Definition) -> Result<Option<Drawing>, ReportError> {
        const STEPS: usize = 10;
        let Some(bins) = self.preset.protocol()?.overlap_bins else { return Ok(None) };
        let trials = || self.results.trials.iter().filter(|trial| trial.key.preset == self.preset.name);
        let overlaps: Vec<f64> = trials().filter_map(|trial| trial.overlap).collect();
        let estimators = &self.preset.overlap_estimators;
        let own =
            bins.mismatched_estimator(estimators).map(|_| OverlapBins::thirds(&overlaps, &estimators.join(" and ")));
        let by = own.as_ref().and_then(OverlapBins::estimator);
        let by = by.map_or_else(String::new, |estimator| format!("; overlaps by {estimator}, a third in each bin"));
        let bins = own.unwrap_or(bins);
        let (low, high) = (bins.edges()[0], bins.edges()[bins.names().len()]);
        let edges: Vec<f64> = (0..=STEPS).map(|step| low + (high - low) * step as f64 / STEPS as f64).collect();
        let names = (0..STEPS).map(|step| step.to_string()).collect();
        let fine = OverlapBins::new(BinRule::Strict, names, edges.clone())?;
        let series = |method: &'a MethodRecord| {
            let binned = by_overlap(self.results, &self.query(&method.name, metric), &fine);
            let middles = edges.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
            let points =
                middles.zip(&binned.bins).filter_map(|(middle, (_, summary))| Some((middle, estimate(summary)?)));
            OverlapSeries { label: self.title(method), points: points.collect() }
        };
        let series: Vec<OverlapSeries> = self.methods().map(series).filter(|series| series.points.len() > 1).collect();
        let first_method = self.methods().next().map(|method| method.name.as_str());
        let scenes = |name: &str| {
            let of_method = trials().filter(|trial| Some(trial.key.method.as_str()) == first_method);
            let overlaps = of_method.filter_map(|trial| trial.overlap);
            overlaps.filter(|overlap| bins.name_of(*overlap) == Some(name)).count() as u64
        };
        let shown = bins.names().iter().zip(bins.edges().windows(2)).map(|(name, edges)| OverlapBin {
            name: name.clone(),
            edges: [edges[0], edges[1]],
            scenes: scenes(name),
        });
        let plot = OverlapCurves {
            title: format!("{} against overlap", metric.name),
            subtitle: format!(
                "{}; means over tenths of the range of overlap with their 95 % intervals over scenes{by}",
                self.subject()
            ),
            quality: metric.into(),
            bins: shown.collect(),
            step: (high - low) / STEPS as f64,
            series,
        };
        Ok((!overlaps.is_empty() && !plot.series.is_empty()).then(|| plot.draw()))
    }

    fn extrapolation(&self, metric: &'static Definition) -> Option<Drawing> {
        let own = self.results.targets.iter().filter(|row| row.key.preset == self.preset.name);
        let distances: BTreeSet<i64> = own.map(|row| row.signed_distance).filter(|distance| *distance != 0).collect();
        let step = step_of(&distances)?;
        let series = |method: &'a MethodRecord| ExtrapolationSeries {
            label: self.title(method),
            points: by_distance_steps(self.results, &self.query(&method.name, metric), step)
                .iter()
                .filter_map(|(distance, summary)| Some((*distance, estimate(summary)?)))
                .collect(),
        };
        let together = if step > 1 { format!("{step} distances together, ") } else { String::new() };
        let plot = ExtrapolationDecay {
            title: format!("{} outside the window", metric.name),
            subtitle: format!("{}; {together}means with their 95 % intervals over scenes", self.subject()),
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
        let own = methods.iter().find(|method| method.kind == "atsplat").or(methods.first())?;
        let against = |other: &&'a MethodRecord| {
            let queries = [own, other].map(|method| self.query(&method.name, metric));
            let pair = paired(self.results, &queries[0], &queries[1])?;
            let decimals = if metric.unit == "dB" { 2 } else { 3 };
            let signed = |value: f64| format!("{value:+.decimals$}").replace('-', "−");
            let interval = pair.interval.map(|ends| ends.map(signed));
            let interval = interval.map_or_else(String::new, |[low, high]| format!(" [{low}, {high}]"));
            let x = self.title(other);
            let difference = format!(
                "{}{interval} to {x}; better in {} of {}, sign test p {}",
                signed(pair.difference),
                pair.wins,
                counted(pair.scenes, "scene"),
                p_value(pair.sign_test)
            );
            let means = paired_scene_means(self.results, &queries[0], &queries[1]);
            let points: Vec<ScatterPoint> =
                means.into_iter().map(|(scene, [y, x])| ScatterPoint { scene, x, y }).collect();
            (!points.is_empty()).then_some(ScatterPanel { x, difference, points })
        };
        let plot = SceneScatter {
            title: format!("{} scene by scene: {} against the others", metric.name, self.title(own)),
            subtitle: format!("{}; mean differences with their 95 % intervals over scenes", self.subject()),
            quality: metric.into(),
            y: self.title(own),
            panels: methods.iter().filter(|other| other.name != own.name).filter_map(against).collect(),
            named: NAMED,
        };
        (!plot.panels.is_empty()).then(|| plot.draw())
    }

    /// The times of the timing pass, with a reason for each method without times; `None` without a timing pass.
    fn time(&self) -> Option<Drawing> {
        let machine = machine_of(self.results, &self.preset.name)?;
        let methods: Vec<(&MethodRecord, Result<Times, String>)> =
            self.methods().map(|method| (method, times(self.results, &self.preset.name, &method.name))).collect();
        let busy = if methods.iter().any(|(_, times)| times.as_ref().is_ok_and(|times| times.busy)) {
            format!("; {BUSY} the machine was busy")
        } else {
            String::new()
        };
        let plot = StageTime {
            title: "Where the time goes until the first image".to_owned(),
            subtitle: format!("{}; medians and quartiles; {machine}{busy}", self.subject()),
            rows: methods
                .into_iter()
                .map(|(method, times)| stage_time_row(self.title(method), method.is_process(), times))
                .collect(),
        };
        (!plot.rows.is_empty()).then(|| plot.draw())
    }
}

/// The stages of a process are those that it states; what else its answers take is shown as the rest of them.
fn stage_time_row(label: String, is_process: bool, times: Result<Times, String>) -> StageTimeRow {
    let times = match times {
        Ok(times) => times,
        Err(reason) => return StageTimeRow { label, stages: Vec::new(), spread: None, untimed: Some(reason) },
    };
    let mut stages: Vec<(String, f64)> =
        in_order(&times.stages).into_iter().map(|(name, spread)| (name.clone(), spread.median)).collect();
    if let Some(encode) = times.encode {
        let stated: f64 = stages.iter().map(|(_, secs)| secs).sum();
        let rest = (encode.median - stated).maximum_of(0.0);
        stages.extend(match (is_process, stages.is_empty()) {
            (true, true) => Some(("the whole answer".to_owned(), encode.median)),
            (true, false) => Some(("the rest of the answer".to_owned(), rest)),
            (false, true) => Some(("encode".to_owned(), encode.median)),
            (false, false) => None,
        });
    }
    stages.extend(times.render.map(|spread| ("render a view".to_owned(), spread.median)));
    StageTimeRow {
        label: if times.busy { format!("{label} {BUSY}") } else { label },
        untimed: stages.is_empty().then(|| "no stage was timed".to_owned()),
        stages,
        spread: times.first_image.map(|spread| spread.quartiles),
    }
}

/// The network's stages in the order in which they run; a store keeps them sorted by name.
fn in_order<T>(stages: &BTreeMap<String, T>) -> Vec<(&String, &T)> {
    const ORDER: [&str; 5] = ["coarse", "anchors", "fine", "decoder", "head"];
    let mut stages: Vec<_> = stages.iter().collect();
    stages.sort_by_key(|(name, _)| ORDER.iter().position(|known| known == name).unwrap_or(ORDER.len()));
    stages
}

fn estimate(summary: &Summary) -> Option<Estimate> {
    Some(Estimate { value: summary.mean?, interval: summary.interval })
}

/// How many distances share a point, a round number, so that each side has at most ten points; `None` without distances.
fn step_of(distances: &BTreeSet<i64>) -> Option<u32> {
    const MOST: u64 = 10;
    let farthest = distances.iter().map(|distance| distance.unsigned_abs()).max()?;
    let round = (0..9).flat_map(|power| [1, 2, 5].map(|digit| digit * 10u32.pow(power)));
    round.into_iter().find(|step| farthest.div_ceil(u64::from(*step)) <= MOST)
}

/// A probability of three decimals after its relation; none is printed as zero.
fn p_value(probability: f64) -> String {
    if probability < 0.001 { "< 0.001".to_owned() } else { format!("= {probability:.3}") }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::sample::{atsplat, floor, preset, results, results_over};

    #[test]
    fn trainings_of_one_title_are_told_apart() {
        let results = results(vec![preset("re10k-2v-256")], ["one", "two"].map(|name| atsplat(name, |_| ())).to_vec());
        let plots = of_store(&Source { label: "run", results: &results }).unwrap();
        assert!(plots.len() > 2, "distances, scenes and times");
        for (name, plot) in plots {
            let texts = plot.texts().collect::<Vec<_>>().join("\n");
            assert!(["ATSplat (one)", "ATSplat (two)"].iter().all(|title| texts.contains(title)), "{name}: {texts}");
        }
    }

    /// Answers take 0.26 s, of which the process states 0.005 s for its encoder.
    #[test]
    fn the_bar_of_a_process_is_as_long_as_its_answers() {
        let stages = |is_process, stated: &[(&str, f64)]| {
            let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ())]);
            for row in &mut results.timings {
                row.stages = stated.iter().map(|(name, secs)| ((*name).to_owned(), vec![*secs; 5])).collect();
            }
            let times = times(&results, "re10k-2v-256", "atsplat");
            let stages = stage_time_row(String::new(), is_process, times).stages;
            let secs: Vec<f64> = stages.iter().map(|(_, secs)| *secs).collect();
            (stages.into_iter().map(|(name, _)| name).collect::<Vec<_>>().join(", "), secs)
        };
        let (names, secs) = stages(true, &[]);
        assert_eq!(names, "the whole answer, render a view");
        Tolerance::F64.assert(secs, [0.26, 0.005], "an answer without stages");
        let (names, secs) = stages(true, &[("encode", 0.005)]);
        assert_eq!(names, "encode, the rest of the answer, render a view");
        Tolerance::F64.assert(secs, [0.005, 0.255, 0.005], "an answer with its encoder");
        let (names, secs) = stages(false, &[("coarse", 0.2)]);
        assert_eq!(names, "coarse, render a view");
        Tolerance::F64.assert(secs, [0.2, 0.005], "a method within this process");
    }

    /// ATSplat is 3 dB worse, and its SSIM is 3 / 32 less, in the three scenes on which it did not fail.
    #[test]
    fn a_difference_has_the_decimals_of_its_metric_and_a_title_keeps_its_hyphens() {
        let other = MethodRecord { title: "re-render".to_owned(), ..floor() };
        let mut results = results(vec![preset("re10k-2v-256")], vec![other, atsplat("atsplat", |_| ())]);
        for difference in ["−3.00", "−0.094"] {
            let expected = format!("{difference} to re-render; better in 0 of 3 scenes");
            let plots = of_store(&Source { label: "run", results: &results }).unwrap();
            let (_, scenes) = plots.iter().find(|(name, _)| name == "run-re10k-2v-256-scenes").unwrap();
            assert!(scenes.texts().any(|text| text.starts_with(&expected)), "{:?}", scenes.texts().collect::<Vec<_>>());
            results.targets.iter_mut().for_each(|row| row.scores.retain(|metric, _| metric != "psnr"));
        }
    }

    /// All scenes but the one that failed are worse: of 10, with a probability of 2⁻⁹; of 12, of 2⁻¹¹.
    #[test]
    fn no_probability_is_printed_as_zero() {
        for (scenes, expected) in [(10, "sign test p = 0.002"), (12, "sign test p < 0.001")] {
            let methods = vec![floor(), atsplat("atsplat", |_| ())];
            let results = results_over(vec![preset("re10k-2v-256")], methods, scenes + 1);
            let plots = of_store(&Source { label: "run", results: &results }).unwrap();
            let (_, plot) = plots.iter().find(|(name, _)| name == "run-re10k-2v-256-scenes").unwrap();
            let texts = plot.texts().collect::<Vec<_>>();
            let said = format!("better in 0 of {scenes} scenes, {expected}");
            assert!(texts.iter().any(|text| text.ends_with(&said)), "{said}: {texts:?}");
        }
        assert_eq!([0.0, 0.000_999, 0.001, 1.0].map(p_value), ["< 0.001", "< 0.001", "= 0.001", "= 1.000"]);
    }

    #[test]
    fn far_distances_go_together_in_round_steps() {
        let step = |distances: &[i64]| step_of(&distances.iter().copied().collect());
        assert_eq!([step(&[]), step(&[-10, 4]), step(&[-11]), step(&[35, -42])], [None, Some(1), Some(2), Some(5)]);
    }
}
