use crate::{Rates, Strategy};

/// When things happen, in steps counted from 1. The published schedule is for 30 000 steps; it scales with their number,
/// but density changes at most every [`Schedule::SHORTEST_INTERVAL`] steps, because it needs gradients of many views, and
/// new Gaussians need time to settle before theirs count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Number of steps.
    pub steps: u64,
    /// Steps between two increments of the degree of the spherical harmonics: 1000 of 30 000.
    pub degree_every: u64,
    /// Density control begins after this step: 500 of 30 000.
    pub density_from: u64,
    /// Density control ends before this step: half of the run.
    pub density_until: u64,
    /// As `density_until` for MCMC, which goes on for five sixths of the run.
    pub relocation_until: u64,
    /// Steps between two changes of density: 100 of 30 000.
    pub density_every: u64,
    /// Steps between two resets of the opacities: 3000 of 30 000, but at least [`Schedule::SHORTEST_RESET`].
    pub reset_every: u64,
}

impl Schedule {
    /// Number of steps of the published schedule.
    pub const PUBLISHED: u64 = 30_000;
    /// Fewest steps between two changes of density.
    pub const SHORTEST_INTERVAL: u64 = 100;

    /// Fewest steps between two resets: opacities need more than a hundred steps to rise again.
    pub const SHORTEST_RESET: u64 = 300;

    /// The schedule of a run of this many steps.
    pub fn of(steps: u64) -> Self {
        let scaled = |published: u64| {
            let share = u128::from(published) * u128::from(steps) / u128::from(Self::PUBLISHED);
            u64::try_from(share).unwrap_or(u64::MAX).max(1)
        };
        Self {
            steps,
            degree_every: scaled(1000),
            density_from: scaled(500),
            density_until: scaled(15_000),
            relocation_until: scaled(25_000),
            density_every: scaled(100).max(Self::SHORTEST_INTERVAL),
            reset_every: scaled(3000).max(Self::SHORTEST_RESET),
        }
    }

    /// Whether density changes in this step, for a strategy that does so until a step.
    pub(crate) const fn changes_density(&self, step: u64, until: u64) -> bool {
        step > self.density_from && step < until && step.is_multiple_of(self.density_every)
    }

    /// Whether 3DGS and Mip-Splatting reset the opacities in this step. On white they also do when density control begins, as
    /// published, unless the next reset would follow within [`Self::SHORTEST_RESET`] steps.
    pub const fn resets_opacities(&self, step: u64, on_white: bool) -> bool {
        let has_time = self.reset_every >= self.density_from.saturating_add(Self::SHORTEST_RESET);
        let begins = on_white && has_time && step == self.density_from;
        step < self.density_until && (begins || step.is_multiple_of(self.reset_every))
    }

    /// The last step, up to this one, in which a strategy resets the opacities; `None` if there is none.
    pub fn last_reset(&self, strategy: Strategy, on_white: bool, step: u64) -> Option<u64> {
        let resets = matches!(strategy, Strategy::Gaussians3d | Strategy::MipSplatting);
        resets.then_some(1..=step)?.rev().find(|step| self.resets_opacities(*step, on_white))
    }

    /// How often a strategy changes the density after a step.
    pub fn density_changes(&self, strategy: Strategy, after: u64) -> u64 {
        let until = match strategy {
            Strategy::Gaussians3d | Strategy::MipSplatting => self.density_until,
            Strategy::Mcmc => self.relocation_until,
            Strategy::Fixed => return 0,
        };
        let from = self.density_from.max(after);
        (until.saturating_sub(1) / self.density_every).saturating_sub(from / self.density_every)
    }

    /// Fewest steps of a run in which a strategy changes the density; `None` if it never does.
    pub fn fewest_steps(strategy: Strategy) -> Option<u64> {
        (1..=Self::PUBLISHED).find(|steps| Self::of(*steps).density_changes(strategy, 0) > 0)
    }

    /// Learning rate of the means in this step, for a scene of extent 1: log-linear from the first to the last
    /// (graphdeco-inria/gaussian-splatting `utils/general_utils.py`).
    pub fn means_rate(&self, rates: &Rates, step: u64) -> f64 {
        let share = (step as f64 / self.steps as f64).clamp(0.0, 1.0);
        (rates.means.ln() * (1.0 - share) + rates.final_means.ln() * share).exp()
    }

    /// Highest degree that is evaluated in this step, if the initial Gaussians had degree `first`.
    pub fn degree(&self, first: u8, last: u8, step: u64) -> u8 {
        let raised = u64::from(first) + step / self.degree_every;
        u8::try_from(raised).map_or(last, |degree| degree.min(last))
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn published_schedule_and_its_scaling() {
        let published = Schedule::of(30_000);
        assert_eq!((published.degree_every, published.density_from, published.density_until), (1000, 500, 15_000));
        assert_eq!((published.density_every, published.reset_every, published.relocation_until), (100, 3000, 25_000));
        let short = Schedule::of(3000);
        assert_eq!((short.degree_every, short.density_every, short.reset_every), (100, 100, 300));
        assert_eq!((Schedule::of(60_000).density_every, Schedule::of(300).reset_every), (200, 300));
    }

    #[test]
    fn changes_of_density_are_counted_as_they_are_due() {
        for steps in [1, 60, 121, 122, 201, 202, 3000, 30_000, 90_001] {
            let schedule = Schedule::of(steps);
            let ends = [
                (Strategy::Gaussians3d, schedule.density_until),
                (Strategy::MipSplatting, schedule.density_until),
                (Strategy::Mcmc, schedule.relocation_until),
                (Strategy::Fixed, 0),
            ];
            for (strategy, until) in ends {
                for after in [0, steps / 3, steps] {
                    let due = (after + 1..=steps).filter(|step| schedule.changes_density(*step, until)).count() as u64;
                    assert_eq!(schedule.density_changes(strategy, after), due, "{strategy:?}, {steps}, {after}");
                }
            }
        }
        assert_eq!(Schedule::of(3000).density_changes(Strategy::Mcmc, 0), 24);
        assert_eq!(Strategy::ALL.map(Schedule::fewest_steps), [Some(202), Some(202), Some(122), None]);
    }

    /// Until the next reset, opacities need [`Schedule::SHORTEST_RESET`] steps to rise again.
    #[test]
    fn opacities_are_reset_at_the_beginning_on_white_if_there_is_time() {
        let resets = |steps: u64, on_white: bool| {
            let schedule = Schedule::of(steps);
            (1..=steps).filter(|step| schedule.resets_opacities(*step, on_white)).collect::<Vec<_>>()
        };
        let regular = [3000, 6000, 9000, 12_000];
        assert_eq!(resets(30_000, false), regular);
        assert_eq!(resets(30_000, true), [&[500][..], &regular].concat());
        for on_white in [false, true] {
            assert!([20, 201, 600].iter().all(|steps| resets(*steps, on_white).is_empty()), "{on_white}");
            assert_eq!(resets(3000, on_white), [300, 600, 900, 1200], "{on_white}");
        }
        let fewest = (1..9999).find(|steps| resets(*steps, true).len() > resets(*steps, false).len());
        assert_eq!(fewest, Some(3590));
    }

    #[test]
    fn the_last_reset_is_that_of_the_schedule() {
        let schedule = Schedule::of(3000);
        let last = |step: u64| schedule.last_reset(Strategy::MipSplatting, false, step);
        assert_eq!([0, 299, 300, 599, 600, 3000].map(last), [None, None, Some(300), Some(300), Some(600), Some(1200)]);
        assert_eq!(
            [Strategy::Mcmc, Strategy::Fixed].map(|strategy| schedule.last_reset(strategy, true, 3000)),
            [None; 2]
        );
        let white = [false, true].map(|white| Schedule::of(30_000).last_reset(Strategy::Gaussians3d, white, 600));
        assert_eq!(white, [None, Some(500)]);
    }

    #[test]
    fn rate_of_means_falls_exponentially() {
        let (rates, schedule) = (Rates::default(), Schedule::of(1000));
        let close = Tolerance { absolute: 0.0, relative: 1e-12 };
        close.assert([schedule.means_rate(&rates, 0)], [1.6e-4], "at the start");
        close.assert([schedule.means_rate(&rates, 500)], [1.6e-5], "half-way, the geometric mean");
        close.assert([schedule.means_rate(&rates, 1000)], [1.6e-6], "at the end");
    }

    #[test]
    fn degree_rises_from_that_of_the_start() {
        let schedule = Schedule::of(30_000);
        assert_eq!([1, 999, 1000, 2999, 3000, 9000].map(|step| schedule.degree(0, 3, step)), [0, 0, 1, 2, 3, 3]);
        assert_eq!(schedule.degree(2, 3, 1), 2);
    }
}
