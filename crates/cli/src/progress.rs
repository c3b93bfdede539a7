use std::io::{IsTerminal as _, stderr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::print::print_status;

/// When plain lines are printed, where there is no terminal: one in every [`Self::INTERVAL`].
#[derive(Debug)]
struct PlainLines {
    begin: Instant,
    /// Milliseconds from the begin to the last line.
    last: AtomicU64,
}

impl PlainLines {
    const INTERVAL: Duration = Duration::from_secs(30);

    /// `None` on a terminal, which has a bar.
    fn without_terminal() -> Option<Self> {
        (!stderr().is_terminal()).then(|| Self { begin: Instant::now(), last: AtomicU64::new(0) })
    }

    /// Whether a line is due; true for only one of the callers at a time.
    fn is_due(&self) -> bool {
        self.is_due_after(self.begin.elapsed())
    }

    fn is_due_after(&self, elapsed: Duration) -> bool {
        let millis = |duration: Duration| u64::try_from(duration.as_millis()).unwrap_or(u64::MAX);
        let (now, last) = (millis(elapsed), self.last.load(Ordering::Relaxed));
        now.saturating_sub(last) >= millis(Self::INTERVAL)
            && self.last.compare_exchange(last, now, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

/// Progress on standard error: a bar with the remaining time on a terminal, a plain line every half minute elsewhere.
#[derive(Debug)]
pub(crate) struct Progress {
    bar: ProgressBar,
    what: &'static str,
    plain: Option<PlainLines>,
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
        Self { bar, what, plain: PlainLines::without_terminal() }
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
        let (Some(plain), Some(total)) = (&self.plain, self.bar.length()) else { return };
        if plain.is_due() {
            print_status(&format!("{}: {}/{total}", self.what, self.bar.position()));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Progress of steps on standard error: a bar on a terminal, a plain line every half minute elsewhere.
#[derive(Debug)]
pub(crate) struct StepProgress {
    bar: ProgressBar,
    plain: Option<PlainLines>,
}

impl StepProgress {
    pub(crate) fn new(steps: u64, done: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        bar.set_position(done);
        Self { bar, plain: PlainLines::without_terminal() }
    }

    /// Shows how many steps are done, and a line about the last one.
    pub(crate) fn reach(&self, done: u64, steps: u64, line: String) {
        self.bar.set_length(steps);
        self.bar.set_position(done);
        if self.plain.as_ref().is_some_and(PlainLines::is_due) {
            print_status(&format!("step {done}/{steps} {line}"));
        }
        self.bar.set_message(line);
    }

    pub(crate) fn print(&self, text: &str) {
        if self.plain.is_some() { print_status(text) } else { self.bar.println(text) }
    }
}

impl Drop for StepProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_due_every_half_minute() {
        let lines = PlainLines { begin: Instant::now(), last: AtomicU64::new(0) };
        let due = [1, 29, 30, 31, 59, 61, 90, 91].map(|secs| lines.is_due_after(Duration::from_secs(secs)));
        assert_eq!(due, [false, false, true, false, false, true, false, true]);
    }
}
