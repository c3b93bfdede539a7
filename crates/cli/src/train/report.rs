use atsplat_train::Event;
use atsplat_train::logs::EvaluationRecord;
use atsplat_train::samples::ReplacedDraws;

use crate::log;
use crate::progress::StepProgress;

/// Live progress.
#[derive(Debug)]
pub(super) struct Live {
    progress: StepProgress,
    steps: u64,
    /// Whether the evaluation's scenes, by their names, are not trained on, neither now nor before.
    held_out: bool,
    /// Exponential moving averages.
    loss: Option<f64>,
    secs: Option<f64>,
}

impl Live {
    pub(super) fn new(steps: u64, done: u64, held_out: bool) -> Self {
        Self { progress: StepProgress::new(steps, done), steps, held_out, loss: None, secs: None }
    }

    pub(super) fn show(&mut self, event: &Event<'_>) {
        match event {
            Event::Step(record) => {
                if let Some(terms) = record.terms {
                    self.loss = Some(smoothed(self.loss, terms.total));
                }
                self.secs = Some(smoothed(self.secs, record.secs));
                if let Some(reason) = &record.skip_reason {
                    self.progress.print(&format!("skipped: {reason}"));
                }
                self.progress.reach(record.step + 1, self.steps, self.line(record.step + 1, record.rate));
            }
            Event::Evaluation(record) => self.progress.print(&described(record, self.held_out)),
            Event::Checkpoint(_) => {}
            Event::Notice(text) => self.progress.print(text),
            Event::Replaced(draws) => self.progress.print(&replaced(draws, log::is_on())),
        }
    }

    fn line(&self, done: u64, rate: f64) -> String {
        let left = self.steps.saturating_sub(done) as f64;
        let loss = self.loss.map_or_else(|| "unknown".to_owned(), |loss| format!("{loss:.4}"));
        let time = self
            .secs
            .map_or_else(String::new, |secs| format!(", {secs:.2} s per step, {:.0} min left", left * secs / 60.0));
        format!("loss {loss}, rate {rate:.1e}{time}")
    }
}

fn described(record: &EvaluationRecord, held_out: bool) -> String {
    let kind = if held_out { "held-out" } else { "evaluation" };
    let identical = match record.identical {
        0 => String::new(),
        count => format!("; {count} more identical to a context view or their render"),
    };
    format!(
        "after {} steps: {:.2} dB, SSIM {:.3} on {} {kind} targets; nearest view {:.2} dB, {:.3}; gain {:+.2} \
         dB{identical}",
        record.step,
        record.psnr,
        record.ssim,
        record.targets,
        record.nearest_view_psnr,
        record.nearest_view_ssim,
        record.gain()
    )
}

/// Replaced draws, and what logs more of them, unless it is logged.
fn replaced(draws: &ReplacedDraws, is_logged: bool) -> String {
    let advice = if is_logged { "" } else { "; `-v` logs the reason for each scene" };
    format!("{draws}{advice}")
}

fn smoothed(mean: Option<f64>, value: f64) -> f64 {
    mean.map_or(value, |mean| 0.95 * mean + 0.05 * value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_held_out_scenes_are_called_so_and_identical_targets_are_counted() {
        let record = EvaluationRecord {
            step: 20,
            psnr: 21.0,
            ssim: 0.75,
            nearest_view_psnr: 16.5,
            nearest_view_ssim: 0.5,
            targets: 3,
            identical: 0,
            secs: 2.0,
            samples_sha256: None,
        };
        let expected =
            "after 20 steps: 21.00 dB, SSIM 0.750 on 3 held-out targets; nearest view 16.50 dB, 0.500; gain +4.50 dB";
        assert_eq!(described(&record, true), expected);
        assert_eq!(described(&record, false), expected.replace("held-out", "evaluation"));
        let one = EvaluationRecord { identical: 1, ..record };
        assert!(described(&one, true).ends_with("; 1 more identical to a context view or their render"));
    }
}
