//! What changes from step to step: the order of views, the background, the degree, the check that an epoch saw anything.

use super::Fit;
use crate::random::{Purpose, stream};
use crate::{Background, FitError, StopReason};

impl Fit {
    /// The view of a step: a random permutation of all views in each epoch.
    pub(super) fn view_of(&self, step: u64) -> usize {
        let count = self.views.len() as u64;
        let (epoch, position) = ((step - 1) / count, (step - 1) % count);
        let order = stream(self.config.seed, Purpose::Order, epoch).permutation(self.views.len());
        #[expect(clippy::expect_used, reason = "a remainder is below the number of views")]
        usize::try_from(position)
            .ok()
            .and_then(|position| order.get(position).copied())
            .expect("a position of the order")
    }

    /// The background of a step; for `None` that of other renders, black instead of a random one.
    pub(super) fn background(&self, step: Option<u64>) -> [f64; 3] {
        match (self.config.background, step) {
            (Background::White, _) => [1.0; 3],
            (Background::Colour(rgb), _) => rgb,
            (Background::Random, Some(step)) => {
                let mut random = stream(self.config.seed, Purpose::Background, step);
                std::array::from_fn(|_| random.unit())
            }
            (Background::Black, _) | (Background::Random, None) => [0.0; 3],
        }
    }

    /// Highest degree of the spherical harmonics in a step that follows. A plan of more steps raises it later, and does not lower it.
    pub(crate) fn degree_of(&self, step: u64) -> u8 {
        self.degree.max(self.schedule.degree(self.first_degree, self.config.sh_degree, step))
    }

    /// Whether `step` ends an epoch in which no Gaussian was drawn. One view may see none of them; if none does, no step changes
    /// anything.
    pub(super) fn sees_nothing(&mut self, step: u64) -> bool {
        let epoch = self.views.len() as u64;
        if step % epoch == 1 % epoch {
            self.empty_steps = 0;
        }
        self.empty_steps += u64::from(self.gradients.screen.drawn.is_empty());
        self.empty_steps == epoch
    }

    /// Fails a run that ended before its first epoch did and saw nothing until then.
    pub(crate) fn check_short_run(&self) -> Result<(), FitError> {
        if self.step == 0 || self.empty_steps < self.step {
            return Ok(());
        }
        Err(self.stopped(self.step, self.view_of(self.step), self.nothing_visible()))
    }

    /// That the views show no Gaussian, with the counts of the last step of this process.
    pub(super) const fn nothing_visible(&self) -> StopReason {
        StopReason::NothingVisible { near: self.options.constants.near, counts: self.gradients.counts }
    }
}
