use std::io::{IsTerminal as _, stderr};
use std::time::{Duration, Instant};

use atsplat_train::Event;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::output::warn;

/// Interval of lines if standard error is not a terminal.
const LOG_INTERVAL: Duration = Duration::from_secs(30);

/// Live progress: a bar on a terminal, a line every [`LOG_INTERVAL`] elsewhere.
#[derive(Debug)]
pub(super) struct Live {
    bar: ProgressBar,
    steps: u64,
    plain: bool,
    last_line: Instant,
    /// Exponential moving averages.
    loss: Option<f64>,
    secs: Option<f64>,
}

impl Live {
    pub(super) fn new(steps: u64, done: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        bar.set_position(done);
        Self { bar, steps, plain: !stderr().is_terminal(), last_line: Instant::now(), loss: None, secs: None }
    }

    pub(super) fn show(&mut self, event: &Event<'_>) {
        match event {
            Event::Step(record) => {
                if let Some(terms) = record.terms {
                    self.loss = Some(smoothed(self.loss, terms.total));
                }
                self.secs = Some(smoothed(self.secs, record.secs));
                let line = self.line(record.step + 1, record.rate);
                self.bar.set_position(record.step + 1);
                self.bar.set_message(line.clone());
                if let Some(fault) = &record.fault {
                    self.print(&format!("skipped: {fault}"));
                }
                if self.plain && self.last_line.elapsed() >= LOG_INTERVAL {
                    self.last_line = Instant::now();
                    warn(&format!("step {}/{} {line}", record.step + 1, self.steps));
                }
            }
            Event::Evaluation(record) => self.print(&format!(
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
            Event::Notice(text) => self.print(text),
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

    fn print(&self, text: &str) {
        if self.plain { warn(text) } else { self.bar.println(text) }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

fn smoothed(mean: Option<f64>, value: f64) -> f64 {
    mean.map_or(value, |mean| 0.95 * mean + 0.05 * value)
}
