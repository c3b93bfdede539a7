//! What a frame's effects cost, and what leaving out the others saves: measured by pairs of renderings that take turns, so
//! that other load on the machine slows both equally.

use std::fmt;
use std::time::Instant;

use atsplat_numeric::median;
use serde::Serialize;

use crate::effects::{EffectChoice, EffectKind, Effects, SceneContext};
use crate::simulation::auto_exposure_gain;
use crate::{Request, RoomsError, Simulation};

/// A time in seconds, not negative: the median of pairs, and the interval that contains the true median with 96 % confidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Timing {
    /// The median; `None` if the interval reaches zero, so that nothing was measured.
    pub secs: Option<f64>,
    /// The second smallest and the second largest of nine values.
    pub interval: [f64; 2],
}

/// Rendering time of one effect.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct EffectCost {
    /// The effect.
    pub effect: EffectKind,
    /// Seconds per frame with the scene's effects minus seconds without this one.
    pub time: Timing,
}

/// What one frame costs, and how it differs from the frame with all effects; without the lens if it was left out.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FrameCosts {
    /// The frame with the scene's effects.
    pub frame: Timing,
    /// The frame with all effects.
    pub all: Timing,
    /// The second over the first: how many times as fast the scene's effects are.
    pub speedup: f64,
    /// The effects that the scene needs, of those that run.
    pub effects: Vec<EffectCost>,
    /// Against the frame with all effects.
    pub difference: ImageDifference,
}

/// How an image differs from the one with all effects.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ImageDifference {
    /// Largest difference of a displayed value, as a share of white.
    pub largest: f32,
    /// Share of pixels with a channel that differs by more than 1/255.
    pub beyond: f64,
    /// Mean squared difference of the displayed values.
    pub mse: f64,
}

impl ImageDifference {
    /// Peak signal-to-noise ratio in dB; infinite for equal images.
    pub fn psnr(&self) -> f64 {
        -10.0 * self.mse.log10()
    }
}

impl fmt::Display for Timing {
    /// `12.3 ms (11.8 to 13.1)`, or the bound of what cannot be measured.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.interval.map(|secs| secs * 1e3);
        match self.secs {
            Some(secs) => write!(f, "{:.1} ms ({low:.1} to {high:.1})", secs * 1e3),
            None => write!(f, "not measurable, below {high:.1} ms"),
        }
    }
}

impl fmt::Display for FrameCosts {
    /// One line for each effect, then the frame against all effects.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for EffectCost { effect, time } in &self.effects {
            writeln!(f, "    {:<20} {time}", effect.to_string())?;
        }
        writeln!(f, "    {:<20} {}", "the frame", self.frame)?;
        writeln!(f, "    {:<20} {}: {:.2} times as long", "with all effects", self.all, self.speedup)?;
        let ImageDifference { largest, beyond, .. } = self.difference;
        let (largest, beyond, psnr) = (largest * 255.0, beyond * 100.0, self.difference.psnr());
        writeln!(
            f,
            "    {:<20} at most {largest:.1} of 255; {beyond:.3} % of pixels above 1; PSNR {psnr:.1} dB",
            "difference"
        )
    }
}

/// Pairs of renderings.
const PAIRS: usize = 9;

impl Timing {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let at = |at: usize| values.get(at).copied().unwrap_or(f64::NAN).clamp(0.0, f64::MAX);
        let interval = [at(1), at(PAIRS - 2)];
        Self { secs: median(values.iter().copied()).filter(|_| interval[0] > 0.0), interval }
    }
}

impl Simulation {
    /// Measures a frame in nine rounds: each renders it with the scene's effects, with all effects, and without one effect
    /// after another.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn costs(&self, frame: usize) -> Result<FrameCosts, RoomsError> {
        let without = self.without_each();
        let (all, _) = self.all_effects()?;
        let (mut frame_secs, mut all_secs) = (Vec::new(), Vec::new());
        let mut saved = vec![Vec::new(); without.len()];
        for _ in 0..PAIRS {
            let secs = self.secs(frame, &self.effects)?;
            frame_secs.push(secs);
            all_secs.push(self.secs(frame, &all)?);
            for (of_effect, (_, others)) in saved.iter_mut().zip(&without) {
                of_effect.push(secs - self.secs(frame, others)?);
            }
        }
        let ratios: Vec<f64> = all_secs.iter().zip(&frame_secs).map(|(all, frame)| all / frame).collect();
        let effects = without.iter().zip(saved).map(|((effect, _), secs)| {
            let (effect, time) = (*effect, Timing::of(secs));
            EffectCost { effect, time }
        });
        Ok(FrameCosts {
            frame: Timing::of(frame_secs),
            all: Timing::of(all_secs),
            speedup: median(ratios).unwrap_or(f64::NAN),
            effects: effects.collect(),
            difference: self.difference_from_all(frame)?,
        })
    }

    /// Each effect that the scene needs, with the others that run: also those that were requested, but of which nothing can be seen.
    fn without_each(&self) -> Vec<(EffectKind, Effects)> {
        let others = |kind: EffectKind| {
            let kinds = self.effects.kinds().filter(|other| *other != kind).collect();
            Effects::choose(&self.context(), &EffectChoice::Only(kinds))
        };
        self.active_effects().iter().map(|active| (active.effect, others(active.effect))).collect()
    }

    /// Compares a frame with the one that all effects give, each at its own exposure. If the lens was left out, it is in neither.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn difference_from_all(&self, frame: usize) -> Result<ImageDifference, RoomsError> {
        let (effects, gain) = self.all_effects()?;
        let all = self.exposed(frame, &effects, gain)?;
        let image = self.image(frame)?;
        let changes = || image.samples().iter().zip(all.samples()).map(|(a, b)| (a - b).abs());
        let values: Vec<f32> = changes().collect();
        let beyond = values.chunks(3).filter(|pixel| pixel.iter().any(|change| *change > 1.0 / 255.0)).count();
        Ok(ImageDifference {
            largest: changes().fold(0.0, |largest, change| if change > largest { change } else { largest }),
            beyond: 3.0 * beyond as f64 / values.len() as f64,
            mse: changes().map(|change| f64::from(change).powi(2)).sum::<f64>() / values.len() as f64,
        })
    }

    /// All effects, without the lens if it was left out, and the exposure of a scene with all of them.
    fn all_effects(&self) -> Result<(Effects, f32), RoomsError> {
        let all = Effects::choose(&self.context(), &EffectChoice::All);
        let gain = auto_exposure_gain(&self.world, &all, self.shots())?;
        Ok((if self.keeps_lens { all } else { all.without_lens() }, gain))
    }

    /// Seconds of one rendering.
    fn secs(&self, frame: usize, effects: &Effects) -> Result<f64, RoomsError> {
        let start = Instant::now();
        std::hint::black_box(self.rendered(frame, effects)?);
        Ok(start.elapsed().as_secs_f64())
    }

    fn context(&self) -> SceneContext<'_> {
        let Request { size, samples, .. } = *self.request();
        let (world, conditions, shots) = (&self.world, &self.conditions, self.shots());
        SceneContext { world, conditions, shots, size, samples }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::ImageSize;
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::{SceneKind, SceneSeed, Split};

    /// The second yard needs no lens. Without another effect a requested one still runs, so its time is not that effect's.
    #[test]
    fn a_requested_effect_that_is_not_seen_runs_without_each_of_the_others() {
        let seed = SceneSeed { split: Split::Train, number: 1 };
        let size = ImageSize { width: 8, height: 6 };
        let plain = Request { size, frames: 2, samples: 1, ..Request::new(SceneKind::Yards, seed) };
        let pair = EffectChoice::Only(vec![EffectKind::SoftShadows, EffectKind::LensDistortion]);
        for effects in [EffectChoice::All, pair, EffectChoice::Auto] {
            let simulation = Simulation::new(Request { effects: effects.clone(), ..plain.clone() }).unwrap();
            let is_absent =
                simulation.absent_effects().iter().any(|absent| absent.effect == EffectKind::LensDistortion);
            assert_eq!(is_absent, effects != EffectChoice::Auto, "{simulation}");
            let running: Vec<EffectKind> = simulation.effects.kinds().collect();
            assert_eq!(running.contains(&EffectKind::LensDistortion), is_absent);
            let without = simulation.without_each();
            for (kind, others) in &without {
                let mut expected = running.clone();
                expected.retain(|running| running != kind);
                assert_eq!(others.kinds().collect::<Vec<_>>(), expected, "without {kind}");
            }
            let needed: Vec<EffectKind> = simulation.active_effects().iter().map(|active| active.effect).collect();
            assert!(needed.contains(&EffectKind::SoftShadows) && !needed.contains(&EffectKind::LensDistortion));
            let measured = simulation.costs(0).unwrap().effects;
            assert_eq!(measured.iter().map(|cost| cost.effect).collect::<Vec<_>>(), needed, "{effects}");
            assert_eq!(without.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), needed, "{effects}");
        }
    }

    #[test]
    fn a_cost_that_is_not_measurable_has_no_value_and_no_negative_bound() {
        let clear = Timing::of(vec![5.0, 9.0, 1.0, 4.0, 6.0, 3.0, 7.0, 2.0, 8.0]);
        Tolerance::EXACT.assert(clear.secs, [5.0], "the median");
        Tolerance::EXACT.assert(clear.interval, [2.0, 8.0], "second smallest and second largest");
        let noise = Timing::of(vec![-3.0, 2.0, -2.0, 1.0, 3.0, 4.0, -1.0, 5.0, 0.5]);
        assert_eq!(noise.secs, None, "two of nine pairs are negative");
        Tolerance::EXACT.assert(noise.interval, [0.0, 4.0], "no negative bound");
        assert!(Timing::of(vec![-1.0, 2.0, 3.0, 1.0, 3.0, 4.0, 2.0, 5.0, 0.5]).secs.is_some(), "one of nine");
    }
}
