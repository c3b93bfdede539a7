use std::io::{IsTerminal as _, stderr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::print::print_status;

/// Progress on standard error: a bar with the remaining time on a terminal, a plain line per tenth elsewhere.
#[derive(Debug)]
pub(crate) struct Progress {
    bar: ProgressBar,
    what: &'static str,
    plain_tenths: Option<AtomicU64>,
}

impl Progress {
    /// Starts counting towards `total` items of `what`, e.g. "scenes".
    pub(crate) fn new(what: &'static str, total: usize) -> Self {
        let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template("{msg} {bar:32} {pos}/{len} {per_sec} eta {eta}");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.set_message(what);
        bar.enable_steady_tick(Duration::from_millis(200));
        let plain_tenths = (!stderr().is_terminal()).then(|| AtomicU64::new(0));
        Self { bar, what, plain_tenths }
    }

    /// Counts one finished item; may be called from any thread.
    pub(crate) fn step(&self) {
        self.bar.inc(1);
        self.report();
    }

    /// Sets how many items are finished.
    #[cfg(feature = "opencv")]
    pub(crate) fn reach(&self, finished: usize) {
        self.bar.set_position(finished as u64);
        self.report();
    }

    fn report(&self) {
        let (Some(reported), Some(total)) = (&self.plain_tenths, self.bar.length()) else { return };
        let done = self.bar.position();
        let tenths = done * 10 / total.max(1);
        // Work on few items is not logged.
        if total >= 100 && reported.fetch_max(tenths, Ordering::Relaxed) < tenths {
            print_status(&format!("{}: {done}/{total}", self.what));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Progress of steps on standard error: a bar on a terminal, a line every [`Self::INTERVAL`] elsewhere.
#[derive(Debug)]
pub(crate) struct StepProgress {
    bar: ProgressBar,
    plain: bool,
    last_line: Instant,
}

impl StepProgress {
    const INTERVAL: Duration = Duration::from_secs(30);

    pub(crate) fn new(steps: u64, done: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        bar.set_position(done);
        Self { bar, plain: !stderr().is_terminal(), last_line: Instant::now() }
    }

    /// Shows how many steps are done, and a line about the last one.
    pub(crate) fn reach(&mut self, done: u64, steps: u64, line: String) {
        self.bar.set_length(steps);
        self.bar.set_position(done);
        if self.plain && self.last_line.elapsed() >= Self::INTERVAL {
            self.last_line = Instant::now();
            print_status(&format!("step {done}/{steps} {line}"));
        }
        self.bar.set_message(line);
    }

    pub(crate) fn print(&self, text: &str) {
        if self.plain { print_status(text) } else { self.bar.println(text) }
    }
}

impl Drop for StepProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
