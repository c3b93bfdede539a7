//! The steps of a run: progress, comparisons with the held-out photos, checkpoints.

use atsplat_fit::density::Changes;
use atsplat_fit::{Background, Deadline, Evaluation, Fit, Schedule, StepRecord, TrainingView};
use atsplat_numeric::counted;

use super::Args;
use crate::progress::StepProgress;

/// Comparisons with the held-out photos in a run whose number of steps stays as it is, if no option says how often.
const COMPARISONS: u64 = 8;

impl Args {
    /// Takes steps until the last one or the deadline.
    pub(super) fn optimise(&self, fit: &mut Fit, deadline: Option<Deadline>, log: &mut Log<'_>) -> anyhow::Result<()> {
        fit.run(deadline, |fit, step| {
            // Before the checkpoint, which contains the comparison with the held-out photos.
            log.step(fit, step)?;
            let is_due = is_written(step.step, fit.config().steps, self.checkpoint_every);
            if let Some(path) = self.checkpoint.as_deref().filter(|_| is_due) {
                fit.checkpoint(path)?;
            }
            Ok(())
        })
    }
}

/// Whether a run of so many steps writes its checkpoint after a step: at intervals, and at the end.
fn is_written(step: u64, steps: u64, every: u64) -> bool {
    step == steps || step.is_multiple_of(every)
}

/// Follows a run: progress and held-out views.
pub(super) struct Log<'a> {
    held_out: &'a [TrainingView],
    /// Steps between two comparisons, if it was given.
    every: Option<u64>,
    last_reset: Option<u64>,
    progress: StepProgress,
}

impl<'a> Log<'a> {
    pub(super) fn new(fit: &Fit, held_out: &'a [TrainingView], every: Option<u64>) -> Self {
        let (config, done) = (fit.config(), fit.step_count());
        let on_white = config.background == Background::White;
        Self {
            held_out,
            every,
            last_reset: Schedule::of(config.steps).last_reset(config.strategy, on_white, done),
            progress: StepProgress::new(config.steps, done),
        }
    }

    fn step(&mut self, fit: &mut Fit, record: &StepRecord) -> anyhow::Result<()> {
        let psnr = fit.history().last_steps().psnr.map_or_else(String::new, |psnr| format!("{psnr:.2} dB, "));
        let line = format!("loss {:.4}, {psnr}{} Gaussians", record.terms.total, record.gaussians);
        // With --seconds, the planned number of steps changes during the run.
        let (step, steps) = (record.step, fit.config().steps);
        self.progress.reach(step, steps, line);
        if record.changes.reset {
            self.last_reset = Some(step);
        }
        let last = fit.history().evaluations.last().map_or(0, |evaluation| evaluation.step);
        if self.every.map_or_else(|| due(step, steps, last, self.last_reset), |every| step.is_multiple_of(every)) {
            self.evaluate(fit)?;
        }
        Ok(())
    }

    /// Scores the held-out views, unless they were scored after this step already.
    pub(super) fn evaluate(&self, fit: &mut Fit) -> anyhow::Result<()> {
        let Some(Evaluation { step, gaussians, score }) = fit.evaluate(self.held_out)? else { return Ok(()) };
        let Changes { cloned, split, pruned, relocated, added, .. } = fit.history().changes;
        self.progress.print(&format!(
            "after {}: {}; {gaussians} Gaussians; last change: {cloned} cloned, {split} split, {pruned} \
             pruned, {relocated} relocated, {added} added",
            counted(step, "step"),
            score.on(&counted(self.held_out.len() as u64, "held-out view"))
        ));
        Ok(())
    }
}

/// Whether the held-out photos are compared after a step, if no option says how often: an eighth of the run as it is planned now
/// after the `last` comparison (0 for none), but not before opacities have risen again after a reset.
fn due(step: u64, steps: u64, last: u64, last_reset: Option<u64>) -> bool {
    let has_risen = |reset: u64| step.saturating_sub(reset) >= Schedule::of(steps).reset_every / 2;
    step.saturating_sub(last) >= steps.div_ceil(COMPARISONS) && last_reset.is_none_or(has_risen)
}

#[cfg(test)]
mod tests {
    use atsplat_fit::Strategy;

    use super::*;

    /// Steps after which a run compares; its number of steps is planned again at every step. The last step always compares.
    fn compared(plan: impl Fn(u64) -> u64, strategy: Strategy) -> Vec<u64> {
        let (mut found, mut step) = (Vec::<u64>::new(), 0);
        while step < plan(step) {
            step += 1;
            let (steps, last) = (plan(step), found.last().copied().unwrap_or(0));
            let last_reset = Schedule::of(steps).last_reset(strategy, false, step);
            if due(step, steps, last, last_reset) || step == steps {
                found.push(step);
            }
        }
        found
    }

    #[test]
    fn photos_are_compared_about_eight_times_whatever_the_plan_becomes() {
        let planned =
            |first: u64, then: u64| compared(move |step| if step < 100 { first } else { then }, Strategy::Fixed);
        assert_eq!(planned(400, 400), [50, 100, 150, 200, 250, 300, 350, 400]);
        assert_eq!(planned(15, 15), [2, 4, 6, 8, 10, 12, 14, 15]);
        assert_eq!(planned(3, 3), [1, 2, 3]);
        assert_eq!(planned(250, 700), [32, 64, 96, 184, 272, 360, 448, 536, 624, 700]);
        assert_eq!(planned(4000, 200), [100, 125, 150, 175, 200]);
    }

    #[test]
    fn a_checkpoint_is_written_at_intervals_and_at_the_end() {
        let written = |steps: u64, every: u64| -> Vec<u64> {
            (1..=steps).filter(|step| is_written(*step, steps, every)).collect()
        };
        assert_eq!(written(20, 500), [20]);
        assert_eq!(written(12, 5), [5, 10, 12]);
        assert_eq!(written(6, 3), [3, 6]);
    }

    /// Every 300 steps opacities are reset, until step 1200.
    #[test]
    fn photos_are_not_compared_just_after_a_reset() {
        assert_eq!(compared(|_| 2400, Strategy::Gaussians3d), [450, 750, 1050, 1350, 1650, 1950, 2250, 2400]);
        assert_eq!(compared(|_| 2400, Strategy::Mcmc), [300, 600, 900, 1200, 1500, 1800, 2100, 2400]);
    }
}
