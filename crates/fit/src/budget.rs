use std::fmt;
use std::str::FromStr;
use std::time::{Duration, Instant};

use atsplat_files::InvalidText;
use atsplat_splat::Gaussians;

use crate::{Fit, FitConfig, FitDevice, FitError, StepRecord, TrainingViews};

/// How long an optimisation runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// This many steps: the result is the same everywhere.
    Steps(u64),
    /// About this many seconds: a number of steps is planned by timing a few, and planned again as they become faster or slower,
    /// until the time is over.
    Seconds(f64),
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Steps(steps) => steps.fmt(f),
            Self::Seconds(seconds) => write!(f, "{seconds}s"),
        }
    }
}

impl FromStr for Budget {
    type Err = InvalidText;

    /// `3000` steps, or `10s`.
    fn from_str(text: &str) -> Result<Self, InvalidText> {
        let budget = match text.strip_suffix('s') {
            Some(seconds) => {
                seconds.parse().ok().filter(|secs: &f64| secs.is_finite() && *secs > 0.0).map(Self::Seconds)
            }
            None => text.parse().ok().filter(|steps| *steps > 0).map(Self::Steps),
        };
        budget.ok_or_else(|| InvalidText::new("a number of steps or of seconds, such as 3000 or 10s", text))
    }
}

/// When a run stops that has a number of seconds.
#[derive(Clone, Copy, Debug)]
pub struct Deadline {
    begin: Instant,
    limit: Duration,
}

/// Share of the time that goes into timing steps.
const TRIAL_SHARE: f64 = 0.05;
/// Share of the time after which the number of steps is planned again. Random Gaussians are large at first, and slow to render;
/// later, density control adds others.
const REPLAN_SHARE: f64 = 0.05;

impl Budget {
    /// Number of steps on a device, for which schedules are made, and when to stop.
    ///
    /// # Errors
    /// As [`Fit::new`] and [`Fit::step`].
    pub fn plan(
        self,
        config: &FitConfig,
        views: &TrainingViews,
        start: &Gaussians,
        device: &FitDevice,
    ) -> Result<(u64, Option<Deadline>), FitError> {
        let seconds = match self {
            Self::Steps(steps) => return Ok((steps, None)),
            Self::Seconds(seconds) => seconds,
        };
        let limit = Duration::try_from_secs_f64(seconds).ok().filter(|limit| !limit.is_zero());
        let limit = limit.ok_or_else(|| FitError::Setting {
            name: "seconds",
            expected: "a positive number".to_owned(),
            found: seconds.to_string(),
        })?;
        let begin = Instant::now();
        // Long enough that no schedule begins.
        let config = FitConfig { steps: 30_000, ..config.clone() };
        let mut trial = Fit::new(config, views.clone(), start)?.on(device.clone());
        // Not timed: the first step allocates, and compiles the kernels of an adapter.
        trial.step()?;
        let trial_begin = Instant::now();
        let mut count = 0u32;
        while count < 3 || (trial_begin.elapsed() < limit.mul_f64(TRIAL_SHARE) && count < 200) {
            trial.step()?;
            count += 1;
        }
        let each = trial_begin.elapsed().as_secs_f64() / f64::from(count);
        let left = limit.saturating_sub(begin.elapsed()).as_secs_f64();
        Ok((whole_steps(left / each).max(1), Some(Deadline { begin, limit })))
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive number, rounded down")]
const fn whole_steps(steps: f64) -> u64 {
    steps as u64
}

/// Plans the steps that are left from the speed of the last ones.
#[derive(Debug)]
struct Pace {
    limit: Duration,
    /// Step and time of the last plan.
    planned: (u64, Duration),
    /// When the last step ended.
    ended: Duration,
    /// How long the shortest step took.
    shortest: Duration,
}

impl Pace {
    const fn new(limit: Duration, step: u64, elapsed: Duration) -> Self {
        Self { limit, planned: (step, elapsed), ended: elapsed, shortest: Duration::MAX }
    }

    /// The new total number of steps after `step` of `steps`, if it is time for another plan. A plan that is complete is made
    /// again while there is time for a step: those before it may have been slower.
    fn replanned(&mut self, [step, steps]: [u64; 2], elapsed: Duration) -> Option<u64> {
        self.shortest = self.shortest.min(elapsed.saturating_sub(self.ended));
        self.ended = elapsed;
        let (since, at) = self.planned;
        let (done, spent) = (step.saturating_sub(since), elapsed.saturating_sub(at));
        let left = self.limit.saturating_sub(elapsed);
        // The last plans follow each other faster, so that the schedule ends with the time even if steps become slower.
        let is_due = step >= steps || spent >= self.limit.mul_f64(REPLAN_SHARE).min(left);
        if done == 0 || spent.is_zero() || !is_due {
            return None;
        }
        self.planned = (step, elapsed);
        let more = whole_steps(left.as_secs_f64() * done as f64 / spent.as_secs_f64());
        // After a pause, the pace would leave no time for any step.
        let least = u64::from(left >= self.shortest);
        Some(step.saturating_add(more.max(least)))
    }
}

impl Fit {
    /// Takes steps until the last one, and shows each to `on_step`. With a deadline, the schedule follows the time: the number of
    /// steps changes while the run goes on, which ends when there is no time for another step.
    ///
    /// # Errors
    /// As [`Fit::step`], and those of `on_step`.
    pub fn run<E: From<FitError>>(
        &mut self,
        deadline: Option<Deadline>,
        mut on_step: impl FnMut(&mut Self, &StepRecord) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut timed =
            deadline.map(|Deadline { begin, limit }| (begin, Pace::new(limit, self.step_count(), begin.elapsed())));
        while !self.is_complete() && timed.as_ref().is_none_or(|(begin, pace)| begin.elapsed() < pace.limit) {
            let record = self.step()?;
            on_step(self, &record)?;
            if let Some((begin, pace)) = &mut timed
                && let Some(steps) = pace.replanned([self.step_count(), self.config().steps], begin.elapsed())
            {
                self.plan_steps(steps);
            }
        }
        Ok(self.check_short_run()?)
    }
}

#[cfg(test)]
mod tests {
    use std::ops::RangeInclusive;

    use super::*;

    #[derive(Debug)]
    struct Outcome {
        secs: f64,
        steps: u64,
        /// Where in the schedule the last step was, from 0 to 1.
        end: f64,
    }

    impl Outcome {
        /// The schedule ended with the run, too.
        fn assert_within(&self, secs: RangeInclusive<f64>, steps: RangeInclusive<u64>) {
            assert!(secs.contains(&self.secs) && steps.contains(&self.steps) && self.end > 0.99, "{self:?}");
        }
    }

    /// A run whose steps take `millis`, first planned as `steps`.
    fn run(limit: u64, mut steps: u64, millis: impl Fn(u64) -> u64) -> Outcome {
        let mut pace = Pace::new(Duration::from_secs(limit), 0, Duration::ZERO);
        let (mut step, mut elapsed, mut end) = (0, Duration::ZERO, 0.0);
        while step < steps && elapsed < pace.limit {
            elapsed += Duration::from_millis(millis(step));
            step += 1;
            end = step as f64 / steps as f64;
            steps = pace.replanned([step, steps], elapsed).unwrap_or(steps);
        }
        assert_eq!(step, steps, "the last plan is what was done");
        Outcome { secs: elapsed.as_secs_f64(), steps: step, end }
    }

    #[test]
    fn parses_steps_and_seconds() {
        assert_eq!(("3000".parse(), "0.5s".parse()), (Ok(Budget::Steps(3000)), Ok(Budget::Seconds(0.5))));
        assert_eq!([Budget::Steps(3000), Budget::Seconds(0.5)].map(|budget| budget.to_string()), ["3000", "0.5s"]);
        for broken in ["", "0", "-1s", "0s", "infs", "NaNs", "ten", "1.5"] {
            assert!(broken.parse::<Budget>().is_err(), "{broken:?}");
        }
    }

    #[test]
    fn steps_that_become_faster_or_slower_fill_the_time() {
        // 100 steps of 40 ms and 600 of 10 ms make ten seconds; from the first ones, 250 were planned.
        run(10, 250, |step| if step < 100 { 40 } else { 10 }).assert_within(9.95..=10.0, 695..=700);
        run(10, 1000, |step| 10 + step / 20).assert_within(9.9..=10.05, 460..=480);
        run(10, 1000, |_| 10).assert_within(9.95..=10.0, 995..=1000);
    }

    #[test]
    fn a_plan_from_a_slow_trial_is_not_the_end() {
        // The machine stood still while the trial's steps were timed.
        run(6, 4, |_| 5).assert_within(5.98..=6.0, 1196..=1200);
        // It stands still for more than half of the time: at this pace, nothing could be done in what is left.
        run(6, 1200, |step| if step == 300 { 3500 } else { 5 }).assert_within(5.98..=6.0, 495..=501);
    }

    #[test]
    fn a_run_that_slows_down_in_its_last_moments_ends_its_schedule() {
        run(10, 1000, |step| if step < 960 { 10 } else { 40 }).assert_within(9.95..=10.04, 968..=971);
        // No step is begun that would take longer than what is left.
        run(1, 1, |_| 700).assert_within(0.7..=0.7, 1..=1);
    }

    #[test]
    fn a_plan_is_kept_until_enough_time_has_passed() {
        let mut pace = Pace::new(Duration::from_secs(100), 10, Duration::from_secs(20));
        let mut replanned = |step, secs| pace.replanned([step, 1000], Duration::from_secs(secs));
        assert_eq!(replanned(30, 24), None);
        assert_eq!(replanned(10, 30), None, "no step was taken");
        assert_eq!(replanned(40, 30), Some(40 + 210));
        assert_eq!(replanned(45, 34), None, "less than a twentieth since the last plan");
        assert_eq!(replanned(220, 97), Some(220 + 8));
        assert_eq!(replanned(222, 99), Some(222 + 1), "more time has passed since than is left");
    }
}
