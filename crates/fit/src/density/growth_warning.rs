//! Why a run as it is planned cannot change the number of Gaussians as its strategy is meant to.

use super::mcmc::grown;
use crate::{Fit, Schedule, Strategy};

impl Fit {
    /// Why the run as it is planned will not change the number of Gaussians as its strategy is meant to: it is too short for
    /// any change, or MCMC cannot grow to the limit. `None` if nothing keeps it from that.
    pub fn density_warning(&self) -> Option<String> {
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
        let (count, most) = (self.len(), self.config.max_gaussians);
        let left = self.schedule.density_changes(strategy, self.step);
        let reached = self.reached(left);
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

    /// Most Gaussians after this many changes of density by MCMC.
    fn reached(&self, changes: u64) -> usize {
        let mut count = self.len();
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
