use atsplat_eval::drift::{HistoricRun, NumberHistory, Verdict};
use atsplat_metrics::definition;

use crate::plot::{Drawing, DriftHistory, DriftRun, Estimate, Figure};

/// How a number moved over the runs that were accepted, and the present one; `None` for a metric that is not known here.
pub fn of_drift(history: &NumberHistory) -> Option<Drawing> {
    let NumberHistory { preset, method, metric, runs, unknown, verdict } = history;
    let quality: Figure = definition(metric)?.into();
    let verdict = match verdict {
        Verdict::Same => "no number moved",
        Verdict::Within => "within limits",
        Verdict::Nothing => "nothing compared",
        Verdict::Drifted => "drifted",
    };
    let gap = match unknown {
        0 => String::new(),
        1 => "; 1 acceptance without it".to_owned(),
        more => format!("; {more} acceptances without it"),
    };
    let plot = DriftHistory {
        title: format!("{} over accepted runs", quality.name),
        subtitle: format!("{method} on {preset}; now: {verdict}{gap}"),
        quality,
        runs: runs.iter().map(|run| drawn(run, quality)).collect(),
    };
    Some(plot.draw())
}

fn drawn(run: &HistoricRun, quality: Figure) -> DriftRun {
    let moved = |by: f64| {
        let sign = if by < 0.0 { "−" } else { "+" };
        let digits = if by.abs() < 0.005 { format!("{:.1e}", by.abs()) } else { format!("{:.3}", by.abs()) };
        format!("{sign}{digits} {}", quality.unit).trim_end().to_owned()
    };
    let drifted = run.verdict == Some(Verdict::Drifted);
    let words = [run.moved.map(moved), run.why.clone()].into_iter().flatten().collect::<Vec<_>>();
    DriftRun {
        label: run.label.clone(),
        quality: Estimate { value: run.mean, interval: run.interval },
        limits: run.limits,
        drift: drifted.then(|| words.join(": ")),
    }
}
