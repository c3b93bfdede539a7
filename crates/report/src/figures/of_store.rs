use std::collections::BTreeMap;

use atsplat_eval::statistics::{Identical, Leaked, MetricQuery, Summary, by_distance, by_overlap, paired, scene_means};
use atsplat_eval::timing::{Times, machine_of, times};
use atsplat_eval::{MethodRecord, PresetRecord, Results};
use atsplat_metrics::{Definition, definitions};
use atsplat_protocol::{BinRule, OverlapBins};

use crate::ReportError;
use crate::plot::{
    Drawing, Estimate, ExtrapolationDecay, ExtrapolationSeries, Origin, OverlapBin, OverlapCurves, OverlapSeries,
    ScatterPoint, SceneScatter, StageTime, StageTimeRow,
};
use crate::table::{BUSY, Source, has_trials};

/// The plots of each protocol in a store, by name: overlap, extrapolation and scatter plots of the first computed metric,
/// and time.
///
/// # Errors
/// [`ReportError::Store`] for an invalid protocol in the store.
pub fn of_store(source: &Source<'_>) -> Result<Vec<(String, Drawing)>, ReportError> {
    let mut plots = Vec::new();
    for preset in &source.results.provenance.presets {
        let view = View { results: source.results, preset };
        let name = |kind: &str| format!("{}-{}-{kind}", plain(source.label), plain(&preset.name));
        if let Some(metric) = view.metric() {
            plots.extend(view.overlap(metric)?.map(|plot| (name("overlap"), plot)));
            plots.extend(view.extrapolation(metric).map(|plot| (name("extrapolation"), plot)));
            plots.extend(view.scatters(metric).into_iter().map(|(methods, plot)| (name(&methods), plot)));
        }
        plots.extend(view.time().map(|plot| (name("time"), plot)));
    }
    Ok(plots)
}

/// The results of one protocol in a store.
struct View<'a> {
    results: &'a Results,
    preset: &'a PresetRecord,
}

impl<'a> View<'a> {
    fn question(&self, method: &'a str, metric: &'static Definition) -> MetricQuery<'a> {
        let (leaked, identical) = (Leaked::Included, Identical::Excluded);
        MetricQuery { preset: &self.preset.name, method, metric: metric.id, leaked, identical }
    }

    fn methods(&self) -> impl Iterator<Item = &'a MethodRecord> {
        let ran = |method: &&MethodRecord| has_trials(self.results, &self.preset.name, &method.name);
        self.results.provenance.methods.iter().filter(ran)
    }

    fn metric(&self) -> Option<&'static Definition> {
        let targets = || self.results.targets.iter().filter(|row| row.key.preset == self.preset.name);
        definitions().iter().find(|metric| targets().any(|row| row.scores.contains_key(metric.id)))
    }

    fn overlap(&self, metric: &'static Definition) -> Result<Option<Drawing>, ReportError> {
        const STEPS: usize = 10;
        let Some(bins) = self.preset.protocol()?.overlap_bins else { return Ok(None) };
        let trials = || self.results.trials.iter().filter(|trial| trial.key.preset == self.preset.name);
        let overlaps: Vec<f64> = trials().filter_map(|trial| trial.overlap).collect();
        let estimators = &self.preset.overlap_estimators;
        let own = bins.foreign(estimators).map(|_| OverlapBins::thirds(&overlaps, &estimators.join(" and ")));
        let by = own.as_ref().and_then(OverlapBins::estimator);
        let by = by.map_or_else(String::new, |estimator| format!("; overlaps by {estimator}, a third in each bin"));
        let bins = own.unwrap_or(bins);
        let (low, high) = (bins.edges()[0], bins.edges()[bins.names().len()]);
        let edges: Vec<f64> = (0..=STEPS).map(|step| low + (high - low) * step as f64 / STEPS as f64).collect();
        let names = (0..STEPS).map(|step| step.to_string()).collect();
        let fine = OverlapBins::new(BinRule::Strict, names, edges.clone())?;
        let series = |method: &'a MethodRecord| {
            let binned = by_overlap(self.results, &self.question(&method.name, metric), &fine);
            let middles = edges.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
            let points =
                middles.zip(&binned.bins).filter_map(|(middle, (_, summary))| Some((middle, estimate(summary)?)));
            OverlapSeries { label: method.title.clone(), points: points.collect(), origin: Origin::Measured }
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
                "{}; tenths of the range of overlap, bands are 95 % intervals over scenes{by}",
                self.preset.title
            ),
            quality: metric.into(),
            bins: shown.collect(),
            series,
        };
        Ok((!overlaps.is_empty() && !plot.series.is_empty()).then(|| plot.draw()))
    }

    fn extrapolation(&self, metric: &'static Definition) -> Option<Drawing> {
        let outside = |row: &atsplat_eval::TargetRow| row.key.preset == self.preset.name && row.signed_distance != 0;
        if !self.results.targets.iter().any(outside) {
            return None;
        }
        let series = |method: &'a MethodRecord| ExtrapolationSeries {
            label: method.title.clone(),
            points: by_distance(self.results, &self.question(&method.name, metric))
                .iter()
                .filter_map(|(distance, summary)| Some((*distance, estimate(summary)?)))
                .collect(),
            origin: Origin::Measured,
        };
        let plot = ExtrapolationDecay {
            title: format!("{} outside the window", metric.name),
            subtitle: format!("{}; bands are 95 % intervals over scenes", self.preset.title),
            quality: metric.into(),
            series: self.methods().map(series).filter(|series| !series.points.is_empty()).collect(),
        };
        (!plot.series.is_empty()).then(|| plot.draw())
    }

    /// The first ATSplat method, or else the first method, against each of the others.
    fn scatters(&self, metric: &'static Definition) -> Vec<(String, Drawing)> {
        const NAMED: usize = 5;
        const MOST: usize = 4;
        let methods: Vec<&MethodRecord> = self.methods().collect();
        let Some(own) = methods.iter().find(|method| method.kind == "atsplat").or(methods.first()) else {
            return Vec::new();
        };
        let means = |method: &'a MethodRecord| scene_means(self.results, &self.question(&method.name, metric));
        let against = |other: &&'a MethodRecord| {
            let (a, b) = (means(own), means(other));
            let point = |own: &atsplat_eval::statistics::SceneMean| {
                let other = b.iter().find(|other| other.scene == own.scene)?;
                Some(ScatterPoint { scene: own.scene.clone(), x: other.mean, y: own.mean })
            };
            let points: Vec<ScatterPoint> = a.iter().filter_map(point).collect();
            let pair = paired(self.results, &self.question(&own.name, metric), &self.question(&other.name, metric))?;
            let interval = pair.interval.map_or_else(String::new, |[low, high]| format!(" [{low:+.3}, {high:+.3}]"));
            let plot = SceneScatter {
                title: format!("{} scene by scene", metric.name),
                subtitle: format!(
                    "difference {:+.3}{interval} over {} scenes, sign test p = {:.3}",
                    pair.difference, pair.scenes, pair.sign_test
                ),
                quality: metric.into(),
                x: other.title.clone(),
                y: own.title.clone(),
                points,
                named: NAMED,
            };
            (!plot.points.is_empty())
                .then(|| (format!("{}-against-{}", plain(&own.name), plain(&other.name)), plot.draw()))
        };
        methods.iter().filter(|other| other.name != own.name).filter_map(against).take(MOST).collect()
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
            title: "Where the time goes until the first picture".to_owned(),
            subtitle: format!("{}; medians and quartiles; {machine}{busy}", self.preset.title),
            rows: methods.into_iter().map(|(method, times)| stage_time_row(method, times)).collect(),
        };
        (!plot.rows.is_empty()).then(|| plot.draw())
    }
}

fn stage_time_row(method: &MethodRecord, times: Result<Times, String>) -> StageTimeRow {
    let label = method.title.clone();
    let times = match times {
        Ok(times) => times,
        Err(reason) => return StageTimeRow { label, stages: Vec::new(), spread: None, untimed: Some(reason) },
    };
    let mut stages: Vec<(String, f64)> =
        in_order(&times.stages).into_iter().map(|(name, spread)| (name.clone(), spread.median)).collect();
    if let Some(encode) = times.encode.filter(|_| stages.is_empty()) {
        stages.push(("encode".to_owned(), encode.median));
    }
    stages.extend(times.render.map(|spread| ("render a view".to_owned(), spread.median)));
    StageTimeRow {
        label: if times.busy { format!("{label} {BUSY}") } else { label },
        untimed: stages.is_empty().then(|| "no stage was timed".to_owned()),
        stages,
        spread: times.first_picture.map(|spread| spread.quartiles),
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

/// A name that is valid on every file system.
fn plain(text: &str) -> String {
    text.chars()
        .map(|letter| if letter.is_ascii_alphanumeric() || ".-_".contains(letter) { letter } else { '-' })
        .collect()
}
