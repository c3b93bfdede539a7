use std::time::{Duration, Instant};

use atsplat_splat::Gaussians;

use crate::{Fit, FitConfig, FitDevice, FitError, StepRecord, TrainingView};

/// How long an optimisation runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// This many steps: the result is the same everywhere.
    Steps(u64),
    /// About this many seconds: a number of steps is planned by timing a few, and the run stops when the time is over.
    Seconds(f64),
}

/// Share of the time that goes into timing steps.
const TRIAL_SHARE: f64 = 0.05;
/// Steps become slower as Gaussians are added.
const GROWTH: f64 = 1.5;

impl Budget {
    /// Number of steps on a device, for which schedules are made, and when to stop.
    ///
    /// # Errors
    /// As [`Fit::new`] and [`Fit::step`].
    pub fn plan(
        self,
        config: &FitConfig,
        views: &[TrainingView],
        start: &Gaussians,
        device: &FitDevice,
    ) -> Result<(u64, Option<Instant>), FitError> {
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
        let mut trial = Fit::new(config, views.to_vec(), start)?.on(device.clone());
        // Not timed: the first step allocates, and compiles the kernels of an adapter.
        trial.step()?;
        let trial_begin = Instant::now();
        let mut count = 0u32;
        while count < 3 || (trial_begin.elapsed() < limit.mul_f64(TRIAL_SHARE) && count < 200) {
            trial.step()?;
            count += 1;
        }
        let each = trial_begin.elapsed().as_secs_f64() / f64::from(count) * GROWTH;
        let left = limit.saturating_sub(begin.elapsed()).as_secs_f64();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive number, rounded down")]
        let steps = (left / each) as u64;
        Ok((steps.max(1), Some(begin + limit)))
    }
}

impl Fit {
    /// Takes steps until the last one or a deadline, and shows each to `on_step`.
    ///
    /// # Errors
    /// As [`Fit::step`], and those of `on_step`.
    pub fn run<E: From<FitError>>(
        &mut self,
        deadline: Option<Instant>,
        mut on_step: impl FnMut(&mut Self, &StepRecord) -> Result<(), E>,
    ) -> Result<(), E> {
        while !self.is_complete() && deadline.is_none_or(|deadline| Instant::now() < deadline) {
            let record = self.step()?;
            on_step(self, &record)?;
        }
        Ok(())
    }
}
