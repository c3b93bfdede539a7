use std::collections::BTreeSet;

use atsplat_metrics::Definition;
use atsplat_protocol::{BinRule, OverlapBins};
use atsplat_results::MethodRecord;
use atsplat_results::statistics::{Binned, by_overlap};

use super::{ProtocolResults, estimate};
use crate::plot::{Drawing, OverlapBin, OverlapCurves, OverlapSeries};
use crate::{ReportError, counted};

/// Points of a curve over the range of overlap.
const STEPS: usize = 10;

impl<'a> ProtocolResults<'a> {
    /// The first metric against overlap, with the protocol's bins; for another estimator, with a third of the overlaps in each.
    pub(super) fn overlap(&self, metric: &'static Definition) -> Result<Option<Drawing>, ReportError> {
        let Some(bins) = self.protocol.overlap_bins.clone() else { return Ok(None) };
        let aggregation = self.protocol.aggregation;
        let trials = || self.results.trials.iter().filter(|trial| trial.key.preset == self.preset.name);
        let overlaps: Vec<f64> = trials().filter_map(|trial| trial.overlap).collect();
        let estimators = &self.preset.overlap_estimators;
        let thirds =
            bins.mismatched_estimator(estimators).map(|_| OverlapBins::thirds(&overlaps, &estimators.join(" and ")));
        let estimator = thirds.as_ref().and_then(OverlapBins::estimator);
        let by = estimator.map_or_else(String::new, |name| format!("; overlaps by {name}, a third in each bin"));
        let bins = thirds.unwrap_or(bins);
        let (low, high) = (bins.edges()[0], bins.edges()[bins.names().len()]);
        let edges: Vec<f64> = (0..=STEPS).map(|step| low + (high - low) * step as f64 / STEPS as f64).collect();
        let names = (0..STEPS).map(|step| step.to_string()).collect();
        let fine = OverlapBins::new(BinRule::Strict, names, edges.clone())?;
        let series = |method: &'a MethodRecord| {
            let binned = by_overlap(self.results, &self.query(&method.name, metric), &fine, aggregation);
            let middles = edges.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
            let points =
                middles.zip(&binned.bins).filter_map(|(middle, (_, summary))| Some((middle, estimate(summary)?)));
            OverlapSeries { label: self.title(method), points: points.collect() }
        };
        let series: Vec<OverlapSeries> = self.methods().map(series).filter(|series| series.points.len() > 1).collect();
        // Scenes with a score, of the method that has most of them; a scene may have several trials.
        let of_method =
            |method: &'a MethodRecord| by_overlap(self.results, &self.query(&method.name, metric), &bins, aggregation);
        let binned: Vec<Binned> = self.methods().map(of_method).collect();
        let scenes =
            |at: usize| binned.iter().filter_map(|binned| Some(binned.bins.get(at)?.1.scenes)).max().unwrap_or(0);
        let shown = bins.names().iter().zip(bins.edges().windows(2)).enumerate().map(|(at, (name, edges))| {
            OverlapBin { name: name.clone(), edges: [edges[0], edges[1]], scenes: scenes(at) }
        });
        let is_outside = |overlap: Option<f64>| overlap.and_then(|overlap| bins.name_of(overlap)).is_none();
        let outside = trials().filter(|trial| is_outside(trial.overlap));
        let outside: BTreeSet<(&str, u32)> = outside.map(|trial| (trial.key.scene.as_str(), trial.key.entry)).collect();
        let outside = match outside.len() as u64 {
            0 => String::new(),
            count => format!("; {} outside the bins", counted(count, "trial")),
        };
        let plot = OverlapCurves {
            title: format!("{} against overlap", metric.name),
            subtitle: format!("{}; means over tenths of the range of overlap{by}{outside}", self.subject_of_means()),
            quality: metric.into(),
            bins: shown.collect(),
            step: (high - low) / STEPS as f64,
            series,
        };
        Ok((!overlaps.is_empty() && !plot.series.is_empty()).then(|| plot.draw()))
    }
}

#[cfg(test)]
mod tests {
    use atsplat_results::{Results, TargetStatus};

    use crate::plot_data::store_plots;
    use crate::sample::{HOSTILE, atsplat, floor, preset, results};
    use crate::table::Source;

    fn said(results: &Results) -> String {
        let plots = store_plots(&Source { label: "run", results }).unwrap();
        let (_, plot) = plots.iter().find(|(name, _)| name == "run-re10k-overlap-overlap").unwrap();
        plot.texts().collect::<Vec<_>>().join("\n")
    }

    /// The overlaps of the four scenes are 0.1, 0.3, 0.5 and 0.7: small, small, medium and large.
    #[test]
    fn bins_count_the_scenes_that_have_a_score() {
        let mut results = results(vec![preset("re10k-overlap")], vec![atsplat("a", |_| ()), floor()]);
        let first = |scene: &str| scene == "aa11";
        let more: Vec<_> = results.trials.iter().filter(|row| first(&row.key.scene)).cloned().collect();
        results.trials.extend(more.into_iter().map(|mut row| {
            row.key.entry = 1;
            row
        }));
        let more: Vec<_> = results.targets.iter().filter(|row| first(&row.key.scene)).cloned().collect();
        results.targets.extend(more.into_iter().map(|mut row| {
            row.key.entry = 1;
            row
        }));
        // The first method fails in the second scene, both in the third.
        for row in &mut results.targets {
            if row.key.scene == "cc33" || (row.key.scene == "bb22" && row.key.method == "a") {
                (row.status, row.scores) = (TargetStatus::Failed, [].into());
            }
        }
        let texts = said(&results);
        for expected in ["small · 2", "medium · 0", "large · 1"] {
            assert!(texts.lines().any(|text| text == expected), "{expected}: {texts}");
        }
        assert!(!texts.contains("outside the bins"), "{texts}");
        let is_last = |scene: &str| scene == HOSTILE;
        results.trials.iter_mut().filter(|row| is_last(&row.key.scene)).for_each(|row| row.overlap = Some(0.9));
        results.targets.iter_mut().filter(|row| is_last(&row.key.scene)).for_each(|row| row.overlap = Some(0.9));
        let texts = said(&results);
        assert!(texts.contains("; 1 trial outside the bins") && texts.contains("large · 0"), "{texts}");
    }
}
