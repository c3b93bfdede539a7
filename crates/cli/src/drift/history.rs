//! `atsplat drift --history`: plots one number over the accepted runs.

use anyhow::Context as _;
use atsplat_eval::Results;
use atsplat_eval::drift::{Baseline, DriftReport, NumberHistory, histories};
use atsplat_report::figures::of_drift;

use crate::plot::PlotFile;
use crate::print::print_status;

#[derive(Debug, clap::Args)]
pub(super) struct HistoryArgs {
    /// Plot a number over the accepted runs and this one, as .svg or .png. --preset, --method and --metric select it; of
    /// several, the one with the worst verdict, PSNR first.
    #[arg(long, value_name = "FILE", value_parser = PlotFile::parser())]
    history: Option<PlotFile>,

    /// Preset of the number that --history draws.
    #[arg(long, value_name = "NAME", requires = "history")]
    preset: Option<String>,

    /// Method of the number that --history draws.
    #[arg(long, value_name = "NAME", requires = "history")]
    method: Option<String>,

    /// Metric that --history draws.
    #[arg(long, value_name = "ID", requires = "history")]
    metric: Option<String>,
}

impl HistoryArgs {
    /// Draws the requested plot, if any.
    pub(super) fn draw(&self, baseline: &Baseline, results: &Results, report: &DriftReport) -> anyhow::Result<()> {
        let Some(file) = &self.history else { return Ok(()) };
        let histories = histories(baseline, results, report);
        let selected = self.selected(&histories).with_context(|| self.not_found(&histories))?;
        let NumberHistory { preset, method, metric, .. } = selected;
        let drawing = of_drift(selected).with_context(|| format!("unknown metric {metric}"))?;
        file.open()?.finish(|format| drawing.encode(format))?;
        print_status(&format!("{metric} of {method} under {preset} into {}", file.path().display()));
        Ok(())
    }

    fn selected<'a>(&self, histories: &'a [NumberHistory]) -> Option<&'a NumberHistory> {
        let matches = |name: &Option<String>, own: &str| name.as_deref().is_none_or(|name| name == own);
        let candidates = histories.iter().filter(|own| {
            matches(&self.preset, &own.preset)
                && matches(&self.method, &own.method)
                && matches(&self.metric, &own.metric)
        });
        // `max_by_key` returns the last of equals.
        candidates.rev().max_by_key(|own| (own.verdict, own.metric.starts_with("psnr")))
    }

    fn not_found(&self, histories: &[NumberHistory]) -> String {
        let name = |name: &Option<String>| name.clone().unwrap_or_else(|| "any".to_owned());
        let known = histories.iter().map(|own| format!("{} of {} under {}", own.metric, own.method, own.preset));
        let known = known.take(12).collect::<Vec<_>>().join("; ");
        let (preset, method, metric) = (name(&self.preset), name(&self.method), name(&self.metric));
        format!(
            "--history: expected a number of the baseline ({known}), found metric {metric} of method {method} under preset {preset}"
        )
    }
}
