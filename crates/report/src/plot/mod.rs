//! Plots: plain data becomes a [`Drawing`], which is encoded as SVG or PNG. The font is bundled, so that plots look the
//! same everywhere and equal data gives equal bytes.

mod ablation;
mod axes;
mod budget_histogram;
mod drift_history;
mod estimator_scatter;
mod expansion_strips;
mod extrapolation;
mod font;
mod frontier;
mod histograms;
mod k_scaling;
mod labels;
mod learning_curve;
mod native;
mod overlap_bins;
mod overlap_curves;
mod overlap_histogram;
mod picture_grid;
mod render;
mod scale;
mod scatter;
mod series;
mod shape;
mod stage_time;
mod stress_errors;
#[cfg(test)]
mod tests;
mod theme;
mod token_expansion;
mod uncertainty;

pub use ablation::{Ablation, AblationRow};
pub use budget_histogram::{BudgetHistogram, BudgetSeries};
pub use drift_history::{DriftHistory, DriftRun};
pub use estimator_scatter::{EstimatePoint, EstimatorPanel, EstimatorScatter};
pub use expansion_strips::{ExpansionStrip, ExpansionStrips, StripPicture};
pub use extrapolation::{ExtrapolationDecay, ExtrapolationSeries};
pub use font::{FONT, register_fonts};
pub use frontier::{CostAxis, Frontier, FrontierPoint};
pub use histograms::{HistogramPanel, Histograms};
pub use k_scaling::{KPoint, KScaling};
pub use learning_curve::LearningCurve;
pub use overlap_bins::{OverlapBinMeans, OverlapBinSeries};
pub use overlap_curves::{OverlapBin, OverlapCurves, OverlapSeries};
pub use overlap_histogram::OverlapHistogram;
pub use render::{PlotFormat, image_of, svg_of};
pub use scatter::{ScatterPoint, SceneScatter};
pub use series::{Estimate, Figure, Origin};
pub use shape::Drawing;
pub use stage_time::{StageTime, StageTimeRow};
pub use stress_errors::{StressError, StressErrors};
pub use theme::{COLOURS, GREY, colour};
pub use token_expansion::{Expansion, TokenExpansion};
pub use uncertainty::{UncertaintyRow, UncertaintyTriplets};
