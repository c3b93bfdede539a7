use atsplat_eval::overlap_estimators::{EstimatedPair, EstimatorReport, KINDS};
use atsplat_protocol::overlap::OverlapEstimator;
use atsplat_protocol::{BinRule, OverlapBins};

use crate::plot::{EstimatePoint, EstimatorPanel, EstimatorScatter};

/// Each estimator of a study against the true co-visibility.
pub fn estimator_scatter(report: &EstimatorReport, estimators: &[OverlapEstimator]) -> EstimatorScatter {
    let bins = OverlapBins::noposplat(BinRule::Strict);
    let point = |pair: &EstimatedPair, at: usize| {
        let kind = KINDS.iter().position(|kind| *kind == pair.kind)?;
        let estimate = pair.estimates.get(at).copied().flatten()?;
        Some(EstimatePoint { kind, truth: pair.truth, estimate })
    };
    let panel = |(at, estimator): (usize, &OverlapEstimator)| {
        let rank = |kind| {
            let mut rows = report.estimators.iter();
            rows.find(|row| row.kind == kind && row.estimator == estimator.name())?.rank_correlation
        };
        EstimatorPanel {
            estimator: estimator.name().to_owned(),
            points: report.pairs.iter().filter_map(|pair| point(pair, at)).collect(),
            rank_correlations: KINDS.map(rank).to_vec(),
        }
    };
    EstimatorScatter {
        title: "Estimated overlap against true co-visibility".to_owned(),
        subtitle: format!(
            "{} pairs of views of {} simulated scenes, {}; tinted squares: both in the same of NoPoSplat's bins",
            report.pairs.len(),
            report.scenes,
            report.size
        ),
        kinds: KINDS.map(|kind| kind.to_string()).to_vec(),
        bins: bins.names().to_vec(),
        edges: bins.edges().to_vec(),
        panels: estimators.iter().enumerate().map(panel).collect(),
    }
}
