//! Why a run as it is planned cannot change the number of Gaussians as its strategy is meant to.

use super::mcmc::grown;
use crate::{Fit, Schedule, Strategy};

impl Fit {
    /// Why the run as it is planned will not change the number of Gaussians as its strategy is meant to: it is too short for
    /// any change, or MCMC cannot grow to the limit. `None` if nothing keeps it from that.
    pub fn density_warning(&self) -> Option<String> {
        self.density_warning_from(self.step, self.len())
    }

    /// [`Self::density_warning`] before the first step, with this many Gaussians: the same for a run that was resumed.
    pub fn first_density_warning(&self, gaussians: usize) -> Option<String> {
        self.density_warning_from(0, gaussians)
    }

    fn density_warning_from(&self, step: u64, count: usize) -> Option<String> {
        let (strategy, steps) = (self.config.strategy, self.config.steps);
        let fewest = Schedule::fewest_steps(strategy)?;
        let name = strategy.name();
        if self.schedule.density_changes(strategy, 0) == 0 {
            let changes = if strategy == Strategy::Mcmc { "moves or adds" } else { "clones, splits or prunes" };
            return Some(format!("{name} never {changes} Gaussians in {steps} steps, but in {fewest} or more"));
        }
        if strategy != Strategy::Mcmc {
            return None;
        }
        let most = self.config.max_gaussians;
        let left = self.schedule.density_changes(strategy, step);
        if left == 0 {
            // Of a resumed run: nothing about its number of Gaussians is to come.
            return None;
        }
        let reached = self.reached(count, left);
        if reached < self.limit {
            return Some(format!(
                "{name} grows from {count} to at most {reached} of {most} Gaussians (max-gaussians): by 5 % at each change of \
                 density, due {left} times until step {steps}"
            ));
        }
        let memory = self.config.memory_limit;
        (reached < most).then(|| {
            format!(
                "{name} grows to at most {reached} of {most} Gaussians (max-gaussians): no more fit into {memory} bytes \
                 (memory-limit)"
            )
        })
    }

    /// Most Gaussians that MCMC makes of `count` in this many changes of density.
    fn reached(&self, mut count: usize, changes: u64) -> usize {
        for _ in 0..changes {
            let more = grown(count, self.limit);
            if more <= count {
                break;
            }
            count = more;
        }
        count
    }
}
