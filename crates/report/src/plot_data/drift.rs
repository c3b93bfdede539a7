use atsplat_drift::{DriftVerdict, HistoricRun, NumberHistory, signed_change};
use atsplat_metrics::definition;

use crate::counted;
use crate::numbers::with_minus_sign;
use crate::plot::{Drawing, DriftHistory, DriftRun, QualityMetric};

/// How a number moved over the accepted runs and the current one; `None` for an unknown metric.
pub fn drift_plot(history: &NumberHistory) -> Option<Drawing> {
    let NumberHistory { preset, method, metric, runs, unknown, verdict, of_run } = history;
    let quality: QualityMetric = definition(metric)?.into();
    let verdict = match verdict {
        DriftVerdict::Drifted => "drifted",
        _ if *of_run == DriftVerdict::Drifted => "drifted, but not in this number",
        DriftVerdict::Same => "not moved",
        DriftVerdict::Within => "within limits",
        DriftVerdict::Nothing => "nothing compared",
    };
    let gap = match *unknown {
        0 => String::new(),
        more => format!("; {} without it", counted(more as u64, "acceptance")),
    };
    let count = counted(runs.len() as u64, "run");
    let plot = DriftHistory {
        title: format!("{} over accepted runs", quality.name),
        subtitle: format!("{method} on {preset}; {count}; now: {verdict}{gap}"),
        quality,
        runs: runs.iter().map(|run| drift_run(run, metric)).collect(),
    };
    Some(plot.draw())
}

fn drift_run(run: &HistoricRun, metric: &str) -> DriftRun {
    let drifted = run.verdict == Some(DriftVerdict::Drifted);
    let moved = run.moved.filter(|by| by.abs() > 0.0).map(|by| with_minus_sign(&signed_change(metric, by)));
    let reasons: Vec<String> = [moved, run.why.clone()].into_iter().flatten().collect();
    DriftRun {
        label: run.label.clone(),
        mean: run.mean,
        limits: run.limits,
        drift: drifted.then(|| reasons.join(": ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_printed_as_in_reports_of_drift() {
        let label = |metric: &str, by: f64| {
            let run = HistoricRun {
                label: "now".to_owned(),
                mean: 20.0,
                limits: None,
                verdict: Some(DriftVerdict::Drifted),
                moved: Some(by),
                why: Some("a fix".to_owned()),
            };
            drift_run(&run, metric).drift.unwrap()
        };
        assert_eq!(label("psnr", -0.25), "−0.250 dB: a fix");
        assert_eq!(label("psnr", 0.0012), "+0.0012 dB: a fix");
        assert_eq!(label("ssim", -0.03), "−0.0300: a fix");
        assert_eq!(label("psnr", 0.0), "a fix");
    }

    /// Scenes differ by 7 dB, and means may by 0.24.
    #[test]
    fn the_axis_shows_limits_not_differences_between_scenes() {
        let run = |label: &str, mean: f64| HistoricRun {
            label: label.to_owned(),
            mean,
            limits: Some([21.88, 22.12]),
            verdict: None,
            moved: None,
            why: None,
        };
        let plot = drift_plot(&NumberHistory {
            preset: "p".to_owned(),
            method: "m".to_owned(),
            metric: "psnr".to_owned(),
            runs: vec![run("first", 22.0), run("now", 22.05)],
            unknown: 0,
            verdict: DriftVerdict::Within,
            of_run: DriftVerdict::Within,
        });
        let texts: Vec<String> = plot.unwrap().texts().map(str::to_owned).collect();
        let ticks: Vec<f64> = texts.iter().filter_map(|text| text.parse().ok()).collect();
        assert!(ticks.len() > 1 && ticks.iter().all(|tick| (21.5..22.5).contains(tick)), "{texts:?}");
    }
}
