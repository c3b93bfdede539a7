use std::fmt::{self, Display, Formatter};
use std::time::Instant;

use serde::Serialize;

use super::{EFFECTS, EffectPlan, Request, Verdict};
use crate::{Gaussians, Renderer, SplatError};

/// Cost of each effect and savings of the plan: the table of `render --explain`.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Explanation {
    /// The renderer that was timed.
    pub renderer: String,
    /// Largest change that the plan allows.
    pub tolerance: f64,
    /// One row per effect.
    pub effects: Vec<Cost>,
    /// Planning time.
    pub plan_ms: f64,
    /// Median time of rendering the original request.
    pub asked_ms: f64,
    /// Median time of rendering the reduced request.
    pub reduced_ms: f64,
    /// Pairs of renderings per measurement.
    pub pairs: usize,
}

/// The decision on an effect, and its cost.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cost {
    /// The decision.
    #[serde(flatten)]
    pub decision: super::Decision,
    /// Median over pairs of the time with the effect minus the time without it; may be negative within timing noise.
    /// `None` if the effect was not requested.
    pub ms: Option<f64>,
}

impl EffectPlan {
    /// Times each effect by alternating renderings with and without it; every other effect runs as requested.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn explain(
        &self,
        renderer: &mut dyn Renderer,
        gaussians: &Gaussians,
        pairs: usize,
    ) -> Result<Explanation, SplatError> {
        let pairs = if pairs == 0 { 1 } else { pairs };
        let mut effects = Vec::with_capacity(EFFECTS.len());
        for (effect, decision) in EFFECTS.iter().zip(self.decisions()) {
            let ms = if decision.verdict == Verdict::NotAsked {
                None
            } else {
                let mut without = self.requested().clone();
                effect.remove_from(&mut without);
                let differences = time_pairs(renderer, gaussians, [self.requested(), &without], pairs)?;
                Some(median(differences.iter().map(|[with, without]| with - without)))
            };
            effects.push(Cost { decision: decision.clone(), ms });
        }
        let pair_times = time_pairs(renderer, gaussians, [self.requested(), self.reduced()], pairs)?;
        Ok(Explanation {
            renderer: renderer.name(),
            tolerance: self.tolerance(),
            effects,
            plan_ms: 1e3 * self.secs(),
            asked_ms: median(pair_times.iter().map(|[requested, _]| *requested)),
            reduced_ms: median(pair_times.iter().map(|[_, reduced]| *reduced)),
            pairs,
        })
    }
}

/// Milliseconds of two requests rendered alternately, after one warm-up pair.
fn time_pairs(
    renderer: &mut dyn Renderer,
    gaussians: &Gaussians,
    requests: [&Request; 2],
    pairs: usize,
) -> Result<Vec<[f64; 2]>, SplatError> {
    let mut times = Vec::with_capacity(pairs);
    for pair in 0..=pairs {
        let mut pair_times = [0.0; 2];
        for (slot, request) in pair_times.iter_mut().zip(requests) {
            let start = Instant::now();
            renderer.render(gaussians, &request.view, &request.options)?;
            *slot = 1e3 * start.elapsed().as_secs_f64();
        }
        if pair > 0 {
            times.push(pair_times);
        }
    }
    Ok(times)
}

#[expect(clippy::expect_used, reason = "callers time at least one pair")]
fn median(values: impl Iterator<Item = f64>) -> f64 {
    atsplat_numeric::median(values).expect("at least one pair was timed")
}

impl Display for Verdict {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::NotAsked => "not asked",
            Self::Runs => "runs",
            Self::Reduced => "reduced",
            Self::LeftOut => "left out",
        })
    }
}

impl Display for Explanation {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<16} {:<10} {:>9} {:>8}  why", "effect", "decision", "bound", "ms")?;
        for Cost { decision, ms } in &self.effects {
            let bound = match decision.bound {
                Some(0.0) => "0".to_owned(),
                Some(bound) => format!("{bound:.1e}"),
                None => "-".to_owned(),
            };
            let ms = ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.2}"));
            writeln!(f, "{:<16} {:<10} {bound:>9} {ms:>8}  {}", decision.effect, decision.verdict, decision.reason)?;
        }
        writeln!(
            f,
            "\n{}: {:.2} ms for everything requested, {:.2} ms for what the plan left of it, {:.3} ms to decide \
             (medians of {} pairs; tolerance {:.1e} of display range, in colour alone)",
            self.renderer, self.asked_ms, self.reduced_ms, self.plan_ms, self.pairs, self.tolerance
        )
    }
}
