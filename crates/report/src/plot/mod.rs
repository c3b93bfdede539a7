//! Plots: plain data becomes a [`Drawing`], which is encoded as SVG or PNG. The font is bundled, so that plots look the
//! same everywhere and equal data gives equal bytes.

mod ablation;
mod axes;
mod budget_histogram;
mod check;
mod contact_sheet;
mod drift_history;
mod effect_costs;
mod estimator_scatter;
mod expansion_strips;
mod extrapolation;
mod font;
mod frontier;
mod histograms;
mod image_grid;
mod k_scaling;
mod labels;
mod learning_curve;
mod optimisation;
mod overlap_bins;
mod overlap_curves;
mod overlap_histogram;
mod render;
mod scale;
mod scatter;
mod series;
mod shape;
mod stage_time;
mod stress_errors;
pub(crate) mod svg;
#[cfg(test)]
mod svg_reader;
#[cfg(test)]
mod tests;
mod theme;
mod token_expansion;
mod uncertainty;

pub use ablation::{Ablation, AblationRow};
pub use budget_histogram::{BudgetHistogram, BudgetSeries};
pub use check::{FaultKind, PlotFault};
pub use contact_sheet::{ContactRow, ContactSheet};
pub use drift_history::{DriftHistory, DriftRun};
pub use effect_costs::{EffectCostRow, EffectCosts};
pub use estimator_scatter::{EstimatePoint, EstimatorPanel, EstimatorScatter};
pub use expansion_strips::{ExpansionStrip, ExpansionStrips, StripImage};
pub use extrapolation::{ExtrapolationDecay, ExtrapolationSeries};
pub use frontier::{CostAxis, Frontier, FrontierPoint, Frontiers};
pub use histograms::{HistogramPanel, Histograms};
pub use k_scaling::{KPoint, KScaling};
pub use learning_curve::LearningCurve;
pub use optimisation::{OptimisationCurves, OptimisationPanel, OptimisationPoint};
pub use overlap_bins::{OverlapBinMeans, OverlapBinSeries};
pub use overlap_curves::{OverlapBin, OverlapCurves, OverlapSeries};
pub use overlap_histogram::OverlapHistogram;
pub use render::PlotFormat;
pub use scatter::{ScatterPanel, ScatterPoint, SceneScatter};
pub use series::{Estimate, Origin, QualityMetric};
pub use shape::Drawing;
pub use stage_time::{StageTime, StageTimeRow};
pub use stress_errors::{StressError, StressErrors};
pub use theme::{COLOURS, GREY, colour};
pub use token_expansion::{Expansion, TokenExpansion};
pub use uncertainty::{UncertaintyRow, UncertaintyTriplets};
