//! `atsplat drift --history`: how one number moved from acceptance to acceptance.

use anyhow::Context as _;
use atsplat_eval::Results;
use atsplat_eval::drift::{Baseline, DriftReport, NumberHistory, histories};
use atsplat_report::figures::of_drift;
use clap::Args;

use crate::output::{PendingFile, complain};
use crate::plot::PlotFile;

#[derive(Debug, Args)]
pub(super) struct HistoryWords {
    /// Draw how a number moved over accepted runs to this one, as .svg or .png: the one that --preset, --method and
    /// --metric name, of several the one whose verdict is worst, a PSNR before others.
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

impl HistoryWords {
    /// Draws what was asked for, if anything was.
    pub(super) fn draw(&self, baseline: &Baseline, results: &Results, report: &DriftReport) -> anyhow::Result<()> {
        let Some(file) = &self.history else { return Ok(()) };
        let histories = histories(baseline, results, report);
        let chosen = self.chosen(&histories).with_context(|| self.absent(&histories))?;
        let NumberHistory { preset, method, metric, .. } = chosen;
        let drawing = of_drift(chosen).with_context(|| format!("the metric {metric} is not known here"))?;
        PendingFile::open(&file.path)?.finish(&drawing.encode(file.format)?)?;
        complain(&format!("{metric} of {method} under {preset} into {}", file.path.display()));
        Ok(())
    }

    fn chosen<'a>(&self, histories: &'a [NumberHistory]) -> Option<&'a NumberHistory> {
        let asked = |wanted: &Option<String>, own: &str| wanted.as_deref().is_none_or(|wanted| wanted == own);
        let wanted = histories.iter().filter(|own| {
            asked(&self.preset, &own.preset) && asked(&self.method, &own.method) && asked(&self.metric, &own.metric)
        });
        // Of equals, `max_by_key` takes the last.
        wanted.rev().max_by_key(|own| (own.verdict, own.metric.starts_with("psnr")))
    }

    fn absent(&self, histories: &[NumberHistory]) -> String {
        let said = |word: &Option<String>| word.clone().unwrap_or_else(|| "any".to_owned());
        let known = histories.iter().map(|own| format!("{} of {} under {}", own.metric, own.method, own.preset));
        let known = known.take(12).collect::<Vec<_>>().join("; ");
        let (preset, method, metric) = (said(&self.preset), said(&self.method), said(&self.metric));
        format!(
            "--history: expected a number of the baseline ({known}), found metric {metric} of method {method} under preset {preset}"
        )
    }
}
