//! `atsplat drift --history`: plots one number over the accepted runs.

use anyhow::Context as _;
use atsplat_drift::{Baseline, DriftReport, NumberHistory, histories};
use atsplat_report::plot_data::drift_plot;
use atsplat_results::statistics::is_psnr;

use crate::parse;
use crate::plot::{PendingPlot, PlotFile};
use crate::print::print_status;

#[derive(Debug, clap::Args)]
pub(super) struct HistoryArgs {
    /// Plot a number over the accepted runs and this one, as .svg or .png. --preset, --method and --metric select it; of
    /// several, the one with the worst verdict, PSNR first.
    #[arg(long, value_name = "FILE", value_parser = PlotFile::parser())]
    history: Option<PlotFile>,

    /// Preset of the number that --history plots.
    #[arg(long, value_name = "NAME", requires = "history")]
    preset: Option<String>,

    /// Method of the number that --history plots.
    #[arg(long, value_name = "NAME", requires = "history")]
    method: Option<String>,

    /// Metric that --history plots.
    #[arg(long, value_name = "ID", requires = "history", value_parser = parse::metric)]
    metric: Option<String>,
}

impl HistoryArgs {
    /// The requested plot, if any; fails before the comparison if its file cannot be written.
    pub(super) fn open(&self) -> anyhow::Result<Option<PendingPlot>> {
        self.history.as_ref().map(PlotFile::open).transpose()
    }

    /// Draws the requested plot.
    pub(super) fn draw(&self, plot: PendingPlot, baseline: &Baseline, report: &DriftReport) -> anyhow::Result<()> {
        let histories = histories(baseline, report);
        let selected = self.selected(&histories).with_context(|| self.not_found(&histories))?;
        let NumberHistory { preset, method, metric, .. } = selected;
        let drawing = drift_plot(selected).with_context(|| format!("unknown metric {metric}"))?;
        let done = format!("{metric} of {method} under {preset} written to {}", plot.path().display());
        plot.finish(|format| drawing.encode(format))?;
        print_status(&done);
        Ok(())
    }

    fn selected<'a>(&self, histories: &'a [NumberHistory]) -> Option<&'a NumberHistory> {
        let matches = |selected: &Option<String>, name: &str| selected.as_deref().is_none_or(|text| text == name);
        let candidates = histories.iter().filter(|number| {
            matches(&self.preset, &number.preset)
                && matches(&self.method, &number.method)
                && matches(&self.metric, &number.metric)
        });
        // `max_by_key` returns the last of equals.
        candidates.rev().max_by_key(|number| (number.verdict, is_psnr(&number.metric)))
    }

    fn not_found(&self, histories: &[NumberHistory]) -> String {
        let known = histories
            .iter()
            .map(|NumberHistory { metric, method, preset, .. }| format!("{metric} of {method} under {preset}"));
        let known = known.take(12).collect::<Vec<_>>().join("; ");
        let selected = |name: &Option<String>| name.clone().unwrap_or_else(|| "any".to_owned());
        format!(
            "--history: expected a number of the baseline ({known}), found metric {} of method {} under preset {}",
            selected(&self.metric),
            selected(&self.method),
            selected(&self.preset)
        )
    }
}

#[cfg(test)]
mod tests {
    use atsplat_drift::DriftVerdict;

    use super::*;

    #[test]
    fn of_equal_verdicts_the_first_psnr_of_images_is_plotted() {
        let number = |metric: &str, verdict| NumberHistory {
            preset: "p".to_owned(),
            method: "m".to_owned(),
            metric: metric.to_owned(),
            runs: Vec::new(),
            unknown: 0,
            verdict,
            of_run: verdict,
        };
        let args = HistoryArgs { history: None, preset: None, method: None, metric: None };
        let selected = |numbers: &[NumberHistory]| args.selected(numbers).map(|number| number.metric.clone());
        let same = |metrics: [&str; 4]| selected(&metrics.map(|metric| number(metric, DriftVerdict::Same)));
        assert_eq!(same(["lpips", "psnr-of-depth", "psnr", "psnr-unclipped"]).as_deref(), Some("psnr"));
        let worse = [number("psnr", DriftVerdict::Same), number("ssim", DriftVerdict::Drifted)];
        assert_eq!(selected(&worse).as_deref(), Some("ssim"));
    }
}
