use atsplat_numeric::Tolerance;

/// How far one target's score of a deterministic method may lie from the baseline's on another machine type: 0.001 dB, and
/// 1e-5 for everything else. Processors that fuse multiplications otherwise change the last bits of networks and renders;
/// what moves a score by more is a token that was chosen otherwise, or a change.
pub fn metric_bound(metric: &str) -> Tolerance {
    let decibels = atsplat_metrics::definition(metric).is_some_and(|definition| definition.unit == "dB");
    Tolerance::absolute(if decibels { 1e-3 } else { 1e-5 })
}
