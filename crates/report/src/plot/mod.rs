//! Plots: plain data becomes a [`Drawing`], which is encoded as SVG or PNG. The font is bundled, so that plots look the
//! same everywhere and equal data gives equal bytes.

mod ablation;
mod budget_histogram;
mod contact_sheet;
pub(crate) mod drawing;
mod drift_history;
mod effect_costs;
mod estimator_scatter;
mod expansion_strips;
mod extrapolation;
mod frontier;
mod histograms;
mod k_scaling;
mod learning_curve;
mod optimisation;
mod overlap_bins;
mod overlap_curves;
mod overlap_histogram;
mod scatter;
mod stage_time;
mod stress_errors;
#[cfg(test)]
mod tests;
mod token_expansion;
mod uncertainty;

pub use ablation::{Ablation, AblationRow};
pub use budget_histogram::{BudgetHistogram, BudgetSeries};
pub use contact_sheet::{ContactRow, ContactSheet};
pub use drawing::check::{FaultKind, PlotFault};
pub use drawing::render::PlotFormat;
pub use drawing::series::{Estimate, Origin, QualityMetric};
pub use drawing::shape::Drawing;
pub use drawing::theme::{COLOURS, GREY, colour};
pub use drift_history::{DriftHistory, DriftRun};
pub use effect_costs::{EffectCostRow, EffectCosts};
pub use estimator_scatter::{EstimatePoint, EstimatorPanel, EstimatorScatter};
pub use expansion_strips::{ExpansionStrip, ExpansionStrips, StripImage};
pub use extrapolation::{ExtrapolationDecay, ExtrapolationPoint, ExtrapolationSeries};
pub use frontier::{FrontierPoint, Frontiers};
pub use histograms::{HistogramPanel, Histograms};
pub use k_scaling::{KPoint, KScaling};
pub use learning_curve::LearningCurve;
pub use optimisation::{OptimisationCurves, OptimisationPanel, OptimisationPoint};
pub use overlap_bins::{OverlapBinMeans, OverlapBinSeries};
pub use overlap_curves::{OverlapBin, OverlapCurves, OverlapSeries};
pub use overlap_histogram::OverlapHistogram;
pub use scatter::{ScatterPanel, ScatterPoint, SceneScatter};
pub use stage_time::{StageTime, StageTimeRow};
pub use stress_errors::{StressError, StressErrors};
pub use token_expansion::TokenExpansion;
pub use uncertainty::{UncertaintyRow, UncertaintyTriplets};
