use atsplat_train::Event;

use crate::progress::StepProgress;

/// Live progress.
#[derive(Debug)]
pub(super) struct Live {
    progress: StepProgress,
    steps: u64,
    /// Exponential moving averages.
    loss: Option<f64>,
    secs: Option<f64>,
}

impl Live {
    pub(super) fn new(steps: u64, done: u64) -> Self {
        Self { progress: StepProgress::new(steps, done), steps, loss: None, secs: None }
    }

    pub(super) fn show(&mut self, event: &Event<'_>) {
        match event {
            Event::Step(record) => {
                if let Some(terms) = record.terms {
                    self.loss = Some(smoothed(self.loss, terms.total));
                }
                self.secs = Some(smoothed(self.secs, record.secs));
                if let Some(fault) = &record.fault {
                    self.progress.print(&format!("skipped: {fault}"));
                }
                self.progress.reach(record.step + 1, self.steps, self.line(record.step + 1, record.rate));
            }
            Event::Evaluation(record) => self.progress.print(&format!(
                "after {} steps: {:.2} dB, SSIM {:.3} on {} held-out targets; nearest view {:.2} dB, {:.3}; gain {:+.2} dB",
                record.step,
                record.psnr,
                record.ssim,
                record.targets,
                record.nearest_view_psnr,
                record.nearest_view_ssim,
                record.gain()
            )),
            Event::Checkpoint(_) => {}
            Event::Notice(text) => self.progress.print(text),
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

fn smoothed(mean: Option<f64>, value: f64) -> f64 {
    mean.map_or(value, |mean| 0.95 * mean + 0.05 * value)
}
