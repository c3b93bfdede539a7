//! The plots with missing, broken, long or many values.

use atsplat_results::tradeoff::Axis;

use super::{
    ablation, around, budget_histogram, contact_sheet, drift_history, effect_costs, estimators, extrapolation,
    frontier, frontiers, histograms, k_scaling, optimisation, overlap_bins, overlap_curves, scatter, stage_time,
    strips, token_expansion, uncertainty,
};
use crate::plot::{
    Ablation, BudgetHistogram, ContactSheet, Drawing, DriftHistory, EstimatorScatter, ExpansionStrips,
    ExtrapolationDecay, Frontiers, Histograms, KScaling, OptimisationCurves, OverlapBinMeans, OverlapSeries,
    SceneScatter, StageTime, StressErrors, TokenExpansion, UncertaintyTriplets,
};

/// The same plots without data, with one point, with equal values and with overlong names.
pub(crate) fn odd_gallery() -> Vec<(&'static str, Drawing)> {
    let long = "a name that is much longer than any column, axis or margin that a plot could reserve for it ".repeat(3);
    let mut one_point = frontier(Axis::Gaussians);
    one_point.panels[0].1.truncate(1);
    let mut broken = frontier(Axis::Seconds);
    broken.panels[0].1.iter_mut().for_each(|point| point.quality.value = f64::NAN);
    let mut level = scatter();
    for panel in &mut level.panels {
        panel.points.iter_mut().for_each(|point| (point.x, point.y) = (1.0, 1.0));
        panel.x.clone_from(&long);
    }
    let mut unmeasured = ablation();
    unmeasured.rows.iter_mut().for_each(|row| (row.measured, row.gap) = (None, None));
    let mut named = overlap_curves();
    named.series.iter_mut().enumerate().for_each(|(at, series)| series.label = format!("{at} {long}"));
    let mut empty = [overlap_curves(), overlap_curves()];
    let mut lost = estimators();
    lost.panels.iter_mut().for_each(|panel| panel.points.iter_mut().for_each(|point| point.truth = f64::NAN));
    let mut level_groups = histograms();
    level_groups.panels.iter_mut().for_each(|panel| panel.values = vec![vec![f64::NAN], vec![2.0; 5]]);
    level_groups.groups.iter_mut().enumerate().for_each(|(at, name)| *name = format!("{at} {long}"));
    let mut crowded = frontiers();
    crowded
        .panels
        .iter_mut()
        .for_each(|(_, points)| points.iter_mut().for_each(|point| point.label.push_str(" and its setting")));
    let mut several = optimisation();
    several.panels.extend(several.panels.clone());
    several.panels[1].curves[0].1[2].held_out.value = f64::NAN;
    let mut single = optimisation();
    single.panels.truncate(1);
    single.panels[0].curves.truncate(1);
    single.panels[0].curves[0].0.clone_from(&long);
    single.palette[0].clone_from(&long);
    single.panels[0].curves[0].1.iter_mut().for_each(|point| point.context = None);
    let mut free = effect_costs();
    free.rows.iter_mut().for_each(|row| row.millis = None);
    free.rows[0].effect.clone_from(&long);
    let none = OptimisationCurves { panels: Vec::new(), ..optimisation() };
    let mut many = overlap_curves();
    many.series =
        (0..14).map(|at| OverlapSeries { label: format!("method {at}"), ..many.series[at % 4].clone() }).collect();
    let mut outlier = overlap_curves();
    outlier.series[2].points[10].1 = around(100.0, 30.0);
    let mut gaps = overlap_curves();
    gaps.series[0].points.drain(4..7);
    gaps.series[1].points[5].1.interval = None;
    gaps.series[2].points[6].0 += 0.025;
    let mut stages = stage_time();
    stages.rows[0].stages = (0..12).map(|at| (format!("stage {at}"), 1e-5 * f64::from(at + 1))).collect();
    let mut untimed = stage_time();
    untimed.rows[3].untimed = Some(format!("{}\n", long.trim()).repeat(4));
    empty[0].series.clear();
    empty[1].series.iter_mut().for_each(|series| series.points.clear());
    vec![
        ("no points", Frontiers { panels: vec![(Axis::Gaussians, Vec::new())], ..frontier(Axis::Gaussians) }.draw()),
        ("many panels", several.draw()),
        ("one curve", single.draw()),
        ("no panels", none.draw()),
        ("nothing costs", free.draw()),
        ("one point", one_point.draw()),
        ("no numbers", broken.draw()),
        ("equal scenes", level.draw()),
        ("nothing measured", unmeasured.draw()),
        ("no variants", Ablation { rows: Vec::new(), ..ablation() }.draw()),
        ("long names", named.draw()),
        ("no curves", empty[0].draw()),
        ("empty curves", empty[1].draw()),
        ("no bins", OverlapBinMeans { bins: Vec::new(), series: Vec::new(), ..overlap_bins() }.draw()),
        ("no distances", ExtrapolationDecay { series: Vec::new(), ..extrapolation() }.draw()),
        ("no scenes", SceneScatter { panels: Vec::new(), ..scatter() }.draw()),
        ("no runs", DriftHistory { runs: Vec::new(), ..drift_history() }.draw()),
        ("no methods", StageTime { rows: Vec::new(), ..stage_time() }.draw()),
        ("no budgets", BudgetHistogram { series: Vec::new(), fixed: Vec::new(), ..budget_histogram() }.draw()),
        ("no settings", KScaling { points: Vec::new(), ..k_scaling() }.draw()),
        (
            "no tokens",
            TokenExpansion { image: None, size: [0.0, 0.0], expansions: Vec::new(), ..token_expansion() }.draw(),
        ),
        ("no strips", ExpansionStrips { columns: Vec::new(), strips: Vec::new(), ..strips() }.draw()),
        ("no truth", lost.draw()),
        ("no estimators", EstimatorScatter { panels: Vec::new(), ..estimators() }.draw()),
        ("equal clips", level_groups.draw()),
        ("no measures", Histograms { panels: Vec::new(), ..histograms() }.draw()),
        ("crowded frontiers", crowded.draw()),
        ("no costs", Frontiers { panels: Vec::new(), ..frontiers() }.draw()),
        ("many methods", many.draw()),
        ("an outlier", outlier.draw()),
        ("gaps", gaps.draw()),
        ("many stages", stages.draw()),
        ("a long reason", untimed.draw()),
        ("no samples", ContactSheet { rows: Vec::new(), ..contact_sheet() }.draw()),
        ("no cases", StressErrors { errors: &[] }.draw()),
        ("no triplets", UncertaintyTriplets { rows: Vec::new(), ..uncertainty() }.draw()),
    ]
}
