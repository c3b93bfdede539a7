use std::fmt::{self, Display, Formatter};
use std::time::Instant;

use serde::Serialize;

use super::{EFFECTS, EffectPlan, Request, Verdict};
use crate::{Gaussians, Renderer, SplatError};

/// What each effect costs, and what the plan saves: the table of `render --explain`.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Explanation {
    /// The renderer that was timed.
    pub renderer: String,
    /// Largest change that the plan allows itself.
    pub tolerance: f64,
    /// One row per effect.
    pub effects: Vec<Cost>,
    /// Deciding.
    pub plan_ms: f64,
    /// Rendering everything that was asked for: the median.
    pub asked_ms: f64,
    /// Rendering what the plan left of it: the median.
    pub reduced_ms: f64,
    /// Pairs of renderings behind each number.
    pub pairs: usize,
}

/// An effect, what became of it and what it costs.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cost {
    /// The decision.
    #[serde(flatten)]
    pub decision: super::Decision,
    /// How much longer everything takes with the effect than without it: the median difference of pairs, which may
    /// be negative where it costs less than timing can tell. `None` where it was not asked for.
    pub ms: Option<f64>,
}

impl EffectPlan {
    /// Times each effect by pairs of renderings in turn, with it and without; every other effect runs as asked for.
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
                let mut without = self.asked().clone();
                effect.leave_out(&mut without);
                let differences = in_turn(renderer, gaussians, [self.asked(), &without], pairs)?;
                Some(median(differences.iter().map(|[with, without]| with - without)))
            };
            effects.push(Cost { decision: decision.clone(), ms });
        }
        let both = in_turn(renderer, gaussians, [self.asked(), self.reduced()], pairs)?;
        Ok(Explanation {
            renderer: renderer.name(),
            tolerance: self.tolerance(),
            effects,
            plan_ms: 1e3 * self.secs(),
            asked_ms: median(both.iter().map(|[asked, _]| *asked)),
            reduced_ms: median(both.iter().map(|[_, reduced]| *reduced)),
            pairs,
        })
    }
}

/// Milliseconds of two requests, rendered one after the other, after a pair that does not count.
fn in_turn(
    renderer: &mut dyn Renderer,
    gaussians: &Gaussians,
    requests: [&Request; 2],
    pairs: usize,
) -> Result<Vec<[f64; 2]>, SplatError> {
    let mut times = Vec::with_capacity(pairs);
    for pair in 0..=pairs {
        let mut both = [0.0; 2];
        for (slot, request) in both.iter_mut().zip(requests) {
            let start = Instant::now();
            renderer.render(gaussians, &request.view, &request.options)?;
            *slot = 1e3 * start.elapsed().as_secs_f64();
        }
        if pair > 0 {
            times.push(both);
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
            "\n{}: {:.2} ms for everything asked for, {:.2} ms for what the plan left of it, {:.3} ms to decide \
             (medians of {} pairs; tolerance {:.1e} of display range, in colour alone)",
            self.renderer, self.asked_ms, self.reduced_ms, self.plan_ms, self.pairs, self.tolerance
        )
    }
}
