use std::collections::{BTreeMap, BTreeSet};

use atsplat_metrics::Definition;
use atsplat_numeric::mean;
use atsplat_protocol::{BinRule, OverlapBins};
use atsplat_results::MethodRecord;
use atsplat_results::statistics::{Binned, Summary, by_overlap};

use super::{ProtocolResults, estimate};
use crate::plot::{Drawing, Estimate, OverlapBin, OverlapCurves, OverlapSeries};
use crate::{ReportError, counted};

/// About how many points a curve has over the range of overlap.
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
        let edges = edges_of_steps(bins.edges());
        let names = (1..edges.len()).map(|step| step.to_string()).collect();
        let fine = OverlapBins::new(BinRule::Strict, names, edges)?;
        let series = |method: &'a MethodRecord| OverlapSeries {
            label: self.title(method),
            points: self.points(&method.name, metric, &fine),
        };
        let series: Vec<OverlapSeries> = self.methods().map(series).filter(|series| series.points.len() > 1).collect();
        // Scenes with a score, of the method that has most of them; a scene may have several trials.
        let of_method = |method: &'a MethodRecord| {
            by_overlap(self.results, &self.query_of_curve(&method.name, metric), &bins, aggregation)
        };
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
            subtitle: format!("{}; means over steps of overlap{by}{outside}", self.subject_of_curves()),
            quality: metric.into(),
            bins: shown.collect(),
            // No point is below the first edge, but one may be on it.
            edges: fine.edges().iter().skip(1).copied().collect(),
            series,
        };
        Ok((!overlaps.is_empty() && !plot.series.is_empty()).then(|| plot.draw()))
    }

    /// The mean of a metric in each step of overlap that has one, at the mean overlap of its trials.
    fn points(&self, method: &'a str, metric: &'static Definition, steps: &OverlapBins) -> Vec<(f64, Estimate)> {
        let binned = by_overlap(self.results, &self.query_of_curve(method, metric), steps, self.protocol.aggregation);
        let overlaps = self.scored_overlaps(method, metric);
        let point = |(step, summary): &(String, Summary)| {
            let of_step = overlaps.iter().copied().filter(|overlap| steps.name_of(*overlap) == Some(step.as_str()));
            Some((mean(of_step)?, estimate(summary)?))
        };
        binned.bins.iter().filter_map(point).collect()
    }

    /// The overlap of each trial of a method that has a score.
    fn scored_overlaps(&self, method: &str, metric: &Definition) -> Vec<f64> {
        let targets = self.results.targets_of(&self.preset.name, method);
        let scored = targets.filter(|row| !row.leaked && row.scores.contains_key(metric.id));
        let overlaps: BTreeMap<(&str, u32), f64> =
            scored.filter_map(|row| Some(((row.key.scene.as_str(), row.key.entry), row.overlap?))).collect();
        overlaps.into_values().collect()
    }
}

/// The edges of steps of about equal width, of which none crosses an edge of a bin.
fn edges_of_steps(bins: &[f64]) -> Vec<f64> {
    let (Some(first), Some(last)) = (bins.first(), bins.last()) else { return Vec::new() };
    let step = (last - first) / STEPS as f64;
    let mut edges = Vec::new();
    for pair in bins.windows(2) {
        let (low, width) = (pair[0], pair[1] - pair[0]);
        // The nearest whole number of steps.
        let count = (1..=STEPS).take_while(|count| (*count as f64 - 0.5) * step <= width).count().max(1);
        edges.extend((0..count).map(|at| low + width * at as f64 / count as f64));
    }
    edges.push(*last);
    edges
}

#[cfg(test)]
mod tests {
    use atsplat_results::{Results, TargetStatus};

    use atsplat_numeric::Tolerance;

    use super::{BinRule, OverlapBins, edges_of_steps};
    use crate::plot_data::store_plots;
    use crate::sample::{HOSTILE, SCENES, atsplat, nearest_view, preset, results};
    use crate::table::Source;

    /// A step of a tenth of the range would go from 0.5 to 0.575, over the edge at 0.55.
    #[test]
    fn no_step_crosses_an_edge_of_a_bin() {
        let near = |found: &[f64], expected: &[f64]| {
            assert_eq!(found.len(), expected.len(), "{found:?}");
            Tolerance::absolute(1e-9).assert(found.iter().copied(), expected.iter().copied(), "edges");
        };
        let thirds = [0.05, 0.05 + 0.25 / 3.0, 0.05 + 0.5 / 3.0];
        let expected: Vec<f64> =
            [0.0, 0.25, 0.5].iter().flat_map(|by| thirds.map(|edge| edge + by)).chain([0.8]).collect();
        near(&edges_of_steps(&[0.05, 0.3, 0.55, 0.8]), &expected);
        // A narrow bin is one step.
        near(&edges_of_steps(&[0.0, 0.01, 0.2, 1.0]), &[0.0, 0.01, 0.105, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]);
    }

    /// Two of four trials share a step, from 0.4667 to 0.55; their point is at the mean of their overlaps.
    #[test]
    fn a_point_is_at_the_mean_overlap_of_its_trials() {
        let mut results = results(vec![preset("re10k-overlap")], vec![atsplat("a", |_| ()), nearest_view()]);
        for (scene, overlap) in [("bb22", 0.48), ("cc33", 0.548)] {
            results.targets.iter_mut().filter(|row| row.key.scene == scene).for_each(|row| row.overlap = Some(overlap));
        }
        let record = results.provenance.presets[0].clone();
        let protocol =
            super::ProtocolResults { results: &results, preset: &record, protocol: record.protocol().unwrap() };
        let bins = protocol.protocol.overlap_bins.as_ref().unwrap();
        let edges = edges_of_steps(bins.edges());
        let names = (1..edges.len()).map(|step| step.to_string()).collect();
        let steps = OverlapBins::new(BinRule::Strict, names, edges).unwrap();
        let points = protocol.points("a", atsplat_metrics::definition("psnr").unwrap(), &steps);
        let overlaps = points.iter().map(|(overlap, _)| *overlap);
        Tolerance::absolute(1e-12).assert(overlaps, [0.1, 0.514, 0.7], "0.48 and 0.548 have one point");
        // The targets of a scene are 27, 27.25 and 27.5 dB, less 2 dB for each scene before it; the last of the first scene is a
        // context frame.
        let means = points.iter().map(|(_, mean)| mean.value);
        Tolerance::absolute(1e-12).assert(means, [27.125, 24.25, 21.25], "of scenes");
    }

    /// Steps are a twelfth wide. Those of 0.13 and 0.22 have an empty one between them, those of 0.5 and 0.56 are neighbours.
    #[test]
    fn no_line_crosses_an_empty_step() {
        let mut results = results(vec![preset("re10k-overlap")], vec![atsplat("a", |_| ()), nearest_view()]);
        for (scene, overlap) in SCENES.into_iter().zip([0.13, 0.22, 0.5, 0.56]) {
            results.trials.iter_mut().filter(|row| row.key.scene == scene).for_each(|row| row.overlap = Some(overlap));
            results.targets.iter_mut().filter(|row| row.key.scene == scene).for_each(|row| row.overlap = Some(overlap));
        }
        let plots = store_plots(&Source { label: "run", results: &results }).unwrap();
        let (_, plot) = plots.iter().find(|(name, _)| name == "run-re10k-overlap-overlap").unwrap();
        let svg = plot.to_svg().unwrap();
        let lines: Vec<&str> =
            svg.lines().filter(|line| line.starts_with("<polyline") && line.contains("data-role=\"data\"")).collect();
        // The second method failed in the third scene.
        assert!(lines.len() == 1 && lines[0].contains("data-series=\"ATSplat"), "{lines:?}");
    }

    fn said(results: &Results) -> String {
        let plots = store_plots(&Source { label: "run", results }).unwrap();
        let (_, plot) = plots.iter().find(|(name, _)| name == "run-re10k-overlap-overlap").unwrap();
        plot.texts().collect::<Vec<_>>().join("\n")
    }

    /// The overlaps of the four scenes are 0.1, 0.3, 0.5 and 0.7: small, small, medium and large.
    #[test]
    fn bins_count_the_scenes_that_have_a_score() {
        let mut results = results(vec![preset("re10k-overlap")], vec![atsplat("a", |_| ()), nearest_view()]);
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
