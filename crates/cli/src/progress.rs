use std::io::{IsTerminal as _, stderr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use atsplat_eval::runner::Step;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::print::{print_status, warn};

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

/// How far some work is.
#[derive(Clone, Copy, Debug)]
struct State {
    finished: u64,
    total: u64,
    /// Finished items for which there was nothing to do.
    known: u64,
    failed: u64,
    elapsed: Duration,
}

impl State {
    /// Items a second, without those for which there was nothing to do; `None` before the first.
    fn rate(self) -> Option<f64> {
        let done = self.finished.saturating_sub(self.known);
        (done > 0 && !self.elapsed.is_zero()).then(|| done as f64 / self.elapsed.as_secs_f64())
    }

    /// `139 failed`, if any did.
    fn failures(self) -> Option<String> {
        (self.failed > 0).then(|| format!("{} failed", self.failed))
    }

    /// `3 min left`, if there is anything left and the rate is known.
    fn time_left(self) -> Option<String> {
        let left = self.total.saturating_sub(self.finished);
        let left = Duration::try_from_secs_f64(left as f64 / self.rate()?).ok().filter(|left| !left.is_zero())?;
        let minutes = (left.as_secs() + 30) / 60;
        Some(match left.as_secs() {
            secs @ 0..60 => format!("{} s left", secs.max(1)),
            60..3600 => format!("{minutes} min left"),
            _ => format!("{} h {} min left", minutes / 60, minutes % 60),
        })
    }

    /// `results: 229/300, 139 failed, 3 min left`.
    fn line(self, what: &str) -> String {
        let Self { finished, total, .. } = self;
        let count = format!("{what}: {finished}/{total}");
        [Some(count), self.failures(), self.time_left()].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }

    /// `139 failed, 0.46/s, 3 min left`: what follows a bar.
    fn remarks(self) -> String {
        let rate = self.rate().map(rate_in_words);
        [self.failures(), rate, self.time_left()].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

/// Items a second in two significant digits, or in a minute or an hour if they are few: `79/s`, `0.46/s`, `2.1/min`.
fn rate_in_words(rate: f64) -> String {
    const MIN: f64 = 0.1;
    let units = [(rate, "s"), (60.0 * rate, "min")];
    let few = (3600.0 * rate, "h");
    let (value, unit) = units.into_iter().find(|(value, _)| *value >= MIN).unwrap_or(few);
    let digits = match value {
        9.95.. => 0,
        0.995.. => 1,
        _ => 2,
    };
    format!("{value:.digits$}/{unit}")
}

/// Progress on standard error: a bar with the remaining time on a terminal, a plain line every half minute elsewhere.
#[derive(Debug)]
pub(crate) struct Progress {
    bar: ProgressBar,
    what: &'static str,
    plain: Option<PlainLines>,
    begin: Instant,
    known: AtomicU64,
    failed: AtomicU64,
}

impl Progress {
    /// Starts counting towards `total` items of `what`, e.g. "scenes".
    pub(crate) fn new(what: &'static str, total: usize) -> Self {
        let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{prefix} {bar:32} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        bar.set_prefix(what);
        bar.enable_steady_tick(Duration::from_millis(200));
        let (plain, begin) = (PlainLines::without_terminal(), Instant::now());
        Self { bar, what, plain, begin, known: AtomicU64::new(0), failed: AtomicU64::new(0) }
    }

    /// Counts a step of a run; may be called from any thread. The first failure is a warning, so that a run in which everything fails
    /// need not be waited for.
    pub(crate) fn result(&self, step: Step<'_>) {
        match step {
            Step::Nothing => _ = self.known.fetch_add(1, Ordering::Relaxed),
            Step::Done => {}
            Step::Failed(row) => {
                if self.failed.fetch_add(1, Ordering::Relaxed) == 0 {
                    let why = row.detail.as_deref().unwrap_or("no reason recorded");
                    let first = format!("the first {} result: {}: {why}", row.status.name(), row.key);
                    self.bar.suspend(|| warn(&first));
                }
            }
        }
        self.step();
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
        match &self.plain {
            Some(plain) if plain.is_due() => print_status(&self.state().line(self.what)),
            Some(_) => {}
            None => self.bar.set_message(self.state().remarks()),
        }
    }

    fn state(&self) -> State {
        let [known, failed] = [&self.known, &self.failed].map(|count| count.load(Ordering::Relaxed));
        let (finished, total) = (self.bar.position(), self.bar.length().unwrap_or(0));
        State { finished, total, known, failed, elapsed: self.begin.elapsed() }
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

/// Does something that reports no progress. If it takes longer than a few seconds, says on standard error what is waited for, and
/// again every half minute.
pub(crate) fn waiting_for<T>(what: &str, work: impl FnOnce() -> T) -> T {
    const FIRST: Duration = Duration::from_secs(3);
    let say = |waited: Duration| print_status(&format!("waiting for {what}: {} s so far", waited.as_secs()));
    while_saying(&say, FIRST, work)
}

fn while_saying<T>(say: &(dyn Fn(Duration) + Sync), first: Duration, work: impl FnOnce() -> T) -> T {
    let (end, ended) = channel::<()>();
    thread::scope(|scope| {
        // It waits, and computes nothing: none of rayon's threads is kept from work.
        scope.spawn(move || {
            let (begin, mut pause) = (Instant::now(), first);
            while ended.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                say(begin.elapsed());
                pause = PlainLines::INTERVAL;
            }
        });
        let done = work();
        drop(end);
        done
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_wait_is_said_and_a_short_one_is_not() {
        let said = |first: Duration, waits: bool| {
            let count = AtomicU64::new(0);
            let say = |_: Duration| {
                count.fetch_add(1, Ordering::Relaxed);
            };
            let work = || {
                while waits && count.load(Ordering::Relaxed) == 0 {
                    thread::sleep(Duration::from_millis(1));
                }
                7
            };
            (while_saying(&say, first, work), count.load(Ordering::Relaxed))
        };
        assert_eq!(said(Duration::from_millis(20), true), (7, 1), "the next is half a minute later");
        assert_eq!(said(Duration::from_mins(1), false), (7, 0), "it does not wait for the first either");
    }

    /// 200 of 300 results were there before; of 50 others in 100 seconds, some failed.
    #[test]
    fn the_time_left_does_not_count_what_was_there_before() {
        let state = State { finished: 250, total: 300, known: 200, failed: 7, elapsed: Duration::from_secs(100) };
        assert_eq!(state.line("results"), "results: 250/300, 7 failed, 2 min left");
        assert_eq!(state.remarks(), "7 failed, 0.50/s, 2 min left");
        let unknown = State { finished: 200, failed: 0, ..state };
        assert_eq!((unknown.line("results"), unknown.remarks()), ("results: 200/300".to_owned(), String::new()));
        let done = State { finished: 300, failed: 0, ..state };
        assert_eq!(done.line("results"), "results: 300/300");
        let left = |total: u64| State { finished: 1, total, known: 0, failed: 0, ..state }.time_left().unwrap();
        assert_eq!([2, 3, 40, 400].map(left), ["2 min left", "3 min left", "1 h 5 min left", "11 h 5 min left"]);
        let fast = State { elapsed: Duration::from_millis(50), known: 0, ..state };
        assert_eq!(fast.time_left().unwrap(), "1 s left");
    }

    #[test]
    fn a_rate_has_two_digits() {
        let rates = [78.5651, 9.96, 1.2345, 0.4567, 0.0321, 0.0005].map(rate_in_words);
        assert_eq!(rates, ["79/s", "10/s", "1.2/s", "0.46/s", "1.9/min", "1.8/h"]);
    }

    #[test]
    fn a_line_is_due_every_half_minute() {
        let lines = PlainLines { begin: Instant::now(), last: AtomicU64::new(0) };
        let due = [1, 29, 30, 31, 59, 61, 90, 91].map(|secs| lines.is_due_after(Duration::from_secs(secs)));
        assert_eq!(due, [false, false, true, false, false, true, false, true]);
    }
}
