use std::fmt::{self, Display, Formatter};
use std::time::Instant;

use atsplat_numeric::{Extremes as _, nearest_quantile};
use serde::Serialize;

use super::{EFFECTS, Effect, EffectOutcome, EffectPlan, Request, Scene};
use crate::{Renderer, Rendering, SplatError};

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
    /// Planning time of this view, which includes what is decided once for all views.
    pub plan_ms: f64,
    /// Number of views that share what is decided once.
    pub views: usize,
    /// Median time of rendering the original request.
    pub requested_ms: f64,
    /// Median time of rendering the reduced request.
    pub reduced_ms: f64,
    /// Largest change of a colour sample between the two, as rendered.
    pub largest_change: f64,
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
    /// Share of the pixels that need it: without it, a sample of theirs changes by more than the tolerance, or for an
    /// image of its own, is not 0. `None` if the effect was not requested.
    pub pixels: Option<f64>,
    /// Time that the effect takes: median over pairs of the time with all of it minus the time with none of it.
    pub ms: Option<Interval>,
    /// Time that the decision saves on every view; `None` where it runs in full.
    pub saved_ms: Option<Interval>,
    /// Time spent on the decision.
    pub spent_ms: f64,
}

/// A median over pairs, and the middle half of the pairs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Interval {
    /// The median.
    pub median: f64,
    /// The quartiles, each the difference of a pair.
    pub quartiles: [f64; 2],
}

impl EffectPlan {
    /// Times each effect by alternating renderings with and without it, and with what its decision leaves of it; every
    /// other effect runs as requested.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn explain(
        &self,
        renderer: &mut dyn Renderer,
        scene: &Scene<'_>,
        pairs: usize,
    ) -> Result<Explanation, SplatError> {
        let mut timer = Timer { renderer, scene, pairs: if pairs == 0 { 1 } else { pairs } };
        let mut effects = Vec::with_capacity(EFFECTS.len());
        for ((effect, decision), secs) in EFFECTS.iter().zip(self.decisions()).zip(self.secs_each()) {
            let (mut pixels, mut ms, mut saved_ms) = (None, None, None);
            if decision.outcome != EffectOutcome::NotRequested {
                let mut without = self.requested().clone();
                effect.remove_from(&mut without);
                let (times, images) = timer.pairs([self.requested(), &without])?;
                pixels = Some(share_of_pixels(*effect, &images, self.tolerance()));
                ms = Some(Interval::of_differences(&times));
            }
            if matches!(decision.outcome, EffectOutcome::Reduced | EffectOutcome::Skipped) {
                let alone = effect.assess(scene, self.requested(), self.tolerance()).reduced;
                saved_ms = match (alone, decision.outcome) {
                    (Some(alone), _) => Some(Interval::of_differences(&timer.pairs([self.requested(), &alone])?.0)),
                    (None, EffectOutcome::Skipped) => ms,
                    (None, _) => None,
                };
            }
            effects.push(Cost { decision: decision.clone(), pixels, ms, saved_ms, spent_ms: 1e3 * secs });
        }
        let (times, [requested, reduced]) = timer.pairs([self.requested(), self.reduced()])?;
        Ok(Explanation {
            tolerance: self.tolerance(),
            effects,
            plan_ms: 1e3 * self.secs(),
            views: scene.views(),
            requested_ms: median(times.iter().map(|[requested, _]| *requested)),
            reduced_ms: median(times.iter().map(|[_, reduced]| *reduced)),
            largest_change: changes(&requested, &reduced).fold(0.0, f64::maximum_of),
            pairs: timer.pairs,
            renderer: timer.renderer.name(),
        })
    }
}

struct Timer<'a> {
    renderer: &'a mut dyn Renderer,
    scene: &'a Scene<'a>,
    pairs: usize,
}

impl Timer<'_> {
    /// Milliseconds of two requests rendered alternately, after one warm-up pair, and their images.
    #[expect(clippy::type_complexity, reason = "two lists of two")]
    fn pairs(&mut self, requests: [&Request; 2]) -> Result<(Vec<[f64; 2]>, [Rendering<f32>; 2]), SplatError> {
        let mut render = |request: &Request| {
            let start = Instant::now();
            let image = self.renderer.render(self.scene.gaussians(), &request.view, &request.options)?;
            Ok::<_, SplatError>((1e3 * start.elapsed().as_secs_f64(), image))
        };
        let [first, second] = requests;
        let images = [render(first)?.1, render(second)?.1];
        let pair = |_| Ok::<_, SplatError>([render(first)?.0, render(second)?.0]);
        let times = (0..self.pairs).map(pair).collect::<Result<_, _>>()?;
        Ok((times, images))
    }
}

impl Interval {
    /// Of the first time minus the second.
    fn of_differences(pairs: &[[f64; 2]]) -> Self {
        let mut differences: Vec<f64> = pairs.iter().map(|[with, without]| with - without).collect();
        let median = median(differences.iter().copied());
        let quartiles = [0.25, 0.75].map(|share| nearest_quantile(&mut differences, share).unwrap_or(f64::NAN));
        Self { median, quartiles }
    }
}

/// Changes of colour samples, pixel by pixel.
fn changes(a: &Rendering<f32>, b: &Rendering<f32>) -> impl Iterator<Item = f64> {
    let largest = |(a, b): (&[f32; 3], &[f32; 3])| {
        a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::maximum_of)
    };
    a.rgb.iter().zip(&b.rgb).map(largest)
}

fn share_of_pixels(effect: &dyn Effect, [with, without]: &[Rendering<f32>; 2], tolerance: f64) -> f64 {
    let count = match effect.image() {
        Some(image) => image.values_in(with).into_iter().flatten().filter(|value| **value != 0.0).count(),
        None => changes(with, without).filter(|change| !(*change <= tolerance)).count(),
    };
    if with.rgb.is_empty() { 0.0 } else { count as f64 / with.rgb.len() as f64 }
}

#[expect(clippy::expect_used, reason = "callers time at least one pair")]
fn median(values: impl Iterator<Item = f64>) -> f64 {
    atsplat_numeric::median(values).expect("at least one pair was timed")
}

impl Display for EffectOutcome {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::NotRequested => "not requested",
            Self::Runs => "runs",
            Self::Reduced => "reduced",
            Self::Skipped => "skipped",
        })
    }
}

/// The median, or that the pairs do not tell it from nothing.
impl Display for Interval {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let [low, high] = self.quartiles;
        f.pad(&if low > 0.0 || high < 0.0 { format!("{:.2}", self.median) } else { "none".to_owned() })
    }
}

impl Display for Explanation {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let [effect, decision] = ["effect", "decision"];
        writeln!(
            f,
            "{effect:<16} {decision:<13} {:>9} {:>7} {:>8} {:>8} {:>8}  why",
            "bound", "pixels", "takes", "saves", "spent"
        )?;
        for Cost { decision, pixels, ms, saved_ms, spent_ms } in &self.effects {
            let bound = match decision.bound {
                Some(0.0) => "0".to_owned(),
                Some(bound) => format!("{bound:.1e}"),
                None => "-".to_owned(),
            };
            let pixels = pixels.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
            let time = |ms: &Option<Interval>| ms.map_or_else(|| "-".to_owned(), |ms| ms.to_string());
            let (takes, saves) = (time(ms), time(saved_ms));
            writeln!(
                f,
                "{:<16} {:<13} {bound:>9} {pixels:>7} {takes:>8} {saves:>8} {spent_ms:>8.2}  {}",
                decision.effect, decision.outcome, decision.reason
            )?;
        }
        writeln!(
            f,
            "\n{}: {:.2} ms for everything requested, {:.2} ms for what the plan left of it, {:.3} ms to decide for this \
             view and for what {} views share; the largest change is {:.1e}, the tolerance {:.1e} of display range \
             (milliseconds: medians of {} alternating pairs, `none` where half of them do not agree on the sign; pixels: \
             those that change by more than the tolerance without the effect)",
            self.renderer,
            self.requested_ms,
            self.reduced_ms,
            self.plan_ms,
            self.views,
            self.largest_change,
            self.tolerance,
            self.pairs
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_are_differences_of_pairs() {
        let of = |differences: &[f64]| {
            let pairs: Vec<[f64; 2]> = differences.iter().map(|difference| [2.0 + difference, 2.0]).collect();
            Interval::of_differences(&pairs)
        };
        assert_eq!(of(&[8.0, -1.0, 0.5, 4.0]), Interval { median: 2.25, quartiles: [0.5, 4.0] });
        assert_eq!(of(&[8.0, -1.0, 0.5]), Interval { median: 0.5, quartiles: [0.5, 8.0] });
        assert_eq!(of(&[0.25]), Interval { median: 0.25, quartiles: [0.25; 2] });
    }
}
