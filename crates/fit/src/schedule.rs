use crate::Rates;

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
