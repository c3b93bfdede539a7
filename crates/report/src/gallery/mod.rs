//! Every plot from synthetic data, for tests and for `examples/gallery.rs`, which includes this file. No number here is a
//! result.

mod costs;
mod distributions;
mod images;
mod odd;
mod scores;

use atsplat_metrics::definition;
use atsplat_results::tradeoff::Axis;
use costs::{effect_costs, frontier, frontiers, k_scaling, optimisation, stage_time};
use distributions::{budget_histogram, estimators, histograms, learning_curve, overlap_histogram, scatter, stress};
use images::{contact_sheet, strips, token_expansion, uncertainty};
pub(crate) use odd::odd_gallery;
use scores::{ablation, drift_history, extrapolation, overlap_bins, overlap_curves};

use crate::plot::{Drawing, Estimate, QualityMetric};

const SYNTHETIC: &str = "synthetic data of 8 scenes";

/// Every plot by name.
pub(crate) fn gallery() -> Vec<(&'static str, Drawing)> {
    vec![
        ("frontiers", frontiers().draw()),
        ("optimisation", optimisation().draw()),
        ("frontier-gaussians", frontier(Axis::Gaussians).draw()),
        ("frontier-seconds", frontier(Axis::Seconds).draw()),
        ("overlap-curves", overlap_curves().draw()),
        ("overlap-bins", overlap_bins().draw()),
        ("extrapolation", extrapolation().draw()),
        ("ablation", ablation().draw()),
        ("dynamic-budget", budget_histogram().draw()),
        ("k-scaling", k_scaling().draw()),
        ("scatter", scatter().draw()),
        ("drift-history", drift_history().draw()),
        ("stage-time", stage_time().draw()),
        ("token-expansion", token_expansion().draw()),
        ("expansion-strips", strips().draw()),
        ("uncertainty", uncertainty().draw()),
        ("effect-costs", effect_costs().draw()),
        ("estimators", estimators().draw()),
        ("histograms", histograms().draw()),
        ("overlap-histogram", overlap_histogram()),
        ("learning-curve", learning_curve()),
        ("contact-sheet", contact_sheet().draw()),
        ("stress", stress()),
    ]
}

fn metric(id: &str) -> QualityMetric {
    definition(id).unwrap().into()
}

/// A pseudo-random number in [0, 1), the same on every platform.
fn noise(seed: usize) -> f64 {
    let mixed = (seed as u64).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((mixed ^ (mixed >> 29)) >> 40) as f64 / (1u64 << 24) as f64
}

fn around(value: f64, half: f64) -> Estimate {
    Estimate { value, interval: Some([value - half, value + half]) }
}
