use std::fmt;

use atsplat_numeric::{Extremes as _, median, quantile};

use crate::{EffectKind, FrameCosts, Timing};

/// What one effect costs over scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectMillis {
    /// The effect.
    pub effect: EffectKind,
    /// Number of scenes that need it.
    pub needed_by: usize,
    /// Milliseconds a frame over the scenes where they can be measured: first quartile, median, third quartile; `None` if they
    /// can be measured in no scene.
    pub millis: Option<[f64; 3]>,
}

/// What effects cost over scenes; one frame of each was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct CostSummary {
    /// Number of scenes.
    pub scenes: usize,
    /// Every effect.
    pub effects: Vec<EffectMillis>,
    /// Median seconds of a frame with its scene's effects; `None` if they cannot be measured.
    pub frame_secs: Option<f64>,
    /// What the effects that scenes need save against all of them, and change; then which times are not measurable, in how many
    /// scenes: these are left out.
    pub against_all: String,
}

impl CostSummary {
    /// The summary of these scenes; `None` without any.
    pub fn of(costs: &[&FrameCosts]) -> Option<Self> {
        (!costs.is_empty()).then(|| Self {
            scenes: costs.len(),
            effects: EffectKind::ALL.map(|effect| EffectMillis::of(effect, costs)).into(),
            frame_secs: median(costs.iter().filter_map(|costs| costs.frame.secs)),
            against_all: format!("{}{}", against_all(costs), left_out(costs)),
        })
    }
}

impl EffectMillis {
    fn of(effect: EffectKind, costs: &[&FrameCosts]) -> Self {
        let of = || costs.iter().flat_map(|costs| &costs.effects).filter(|cost| cost.effect == effect);
        let mut millis: Vec<f64> = of().filter_map(|cost| cost.time.secs).map(|secs| secs * 1e3).collect();
        millis.sort_by(f64::total_cmp);
        let at = |share| quantile(&millis, share);
        let millis = at(0.25).zip(at(0.5)).zip(at(0.75)).map(|((low, median), high)| [low, median, high]);
        Self { effect, needed_by: of().count(), millis }
    }
}

/// Times are compared over the scenes where both are measurable.
fn against_all(costs: &[&FrameCosts]) -> String {
    let both: Vec<(f64, f64)> = costs.iter().filter_map(|costs| costs.frame.secs.zip(costs.all.secs)).collect();
    let (needed, all) = both.iter().fold((0.0, 0.0), |sums, (frame, with_all)| (sums.0 + frame, sums.1 + with_all));
    let times = if both.is_empty() {
        "how much longer all effects take is not measurable".to_owned()
    } else {
        format!("all effects take {:.2} times as long", all / needed)
    };
    let largest = costs.iter().map(|costs| costs.difference.largest).fold(0.0, f32::maximum_of);
    let beyond = costs.iter().map(|costs| costs.difference.beyond).sum::<f64>() / costs.len() as f64;
    format!(
        "{times}; the largest difference is {:.1} of 255, and {:.3} % of pixels differ by more than 1",
        largest * 255.0,
        beyond * 100.0
    )
}

/// In how many scenes which times are missing from the medians; nothing if none are.
fn left_out(costs: &[&FrameCosts]) -> String {
    let missing = |times: Vec<Timing>, what: &str| {
        let count = times.iter().filter(|time| time.secs.is_none()).count();
        (count > 0).then(|| format!("{what} in {count} of {}", times.len()))
    };
    let of_effect = |effect: EffectKind| {
        let of = costs.iter().flat_map(|costs| &costs.effects).filter(|cost| cost.effect == effect);
        missing(of.map(|cost| cost.time).collect(), &effect.to_string())
    };
    let of_frames = [
        missing(costs.iter().map(|costs| costs.frame).collect(), "the frame"),
        missing(costs.iter().map(|costs| costs.all).collect(), "the frame with all effects"),
    ];
    let missing: Vec<String> = EffectKind::ALL.into_iter().map(of_effect).chain(of_frames).flatten().collect();
    if missing.is_empty() { String::new() } else { format!("; not measurable and left out: {}", missing.join(", ")) }
}

impl fmt::Display for CostSummary {
    /// A table.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<20} {:>7}  {:>16}", "effect", "scenes", "median ms a frame")?;
        for EffectMillis { effect, needed_by, millis } in &self.effects {
            let measured = millis.map_or_else(|| "-".to_owned(), |[_, median, _]| format!("{median:.1}"));
            writeln!(f, "{:<20} {needed_by:>3}/{:<3}  {measured:>16}", effect.to_string(), self.scenes)?;
        }
        writeln!(f, "{}", self.against_all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EffectCost, ImageDifference};

    fn timing(secs: Option<f64>) -> Timing {
        Timing { secs, interval: [0.0, 1.0] }
    }

    /// The costs of a frame, with motion blur for a time that may not be measurable, or without.
    fn costs(frame: f64, all: f64, blur: &[Option<f64>], largest: f32) -> FrameCosts {
        let effects = blur.iter().map(|secs| EffectCost { effect: EffectKind::MotionBlur, time: timing(*secs) });
        FrameCosts {
            frame: timing(Some(frame)),
            all: timing(Some(all)),
            speedup: all / frame,
            effects: effects.collect(),
            difference: ImageDifference { largest, beyond: 0.001, mse: 0.0 },
        }
    }

    #[test]
    fn effects_are_summed_up_over_the_scenes_that_need_them() {
        let scenes = [
            costs(0.010, 0.030, &[Some(0.002)], 0.2),
            costs(0.020, 0.030, &[Some(0.004)], 0.4),
            costs(0.050, 0.060, &[None], 0.0),
            costs(0.040, 0.060, &[], 0.1),
        ];
        let summary = CostSummary::of(&scenes.iter().collect::<Vec<_>>()).unwrap();
        assert_eq!((summary.scenes, summary.effects.len()), (4, EffectKind::ALL.len()));
        atsplat_numeric::Tolerance::absolute(1e-12).assert(summary.frame_secs, [0.030], "median frame");
        let blur = summary.effects.iter().find(|row| row.effect == EffectKind::MotionBlur).unwrap();
        assert_eq!(blur.needed_by, 3, "one scene does not need it");
        atsplat_numeric::Tolerance::absolute(1e-9).assert(
            blur.millis.unwrap(),
            [2.5, 3.0, 3.5],
            "quartiles of what could be measured",
        );
        let shadows = summary.effects.iter().find(|row| row.effect == EffectKind::SoftShadows).unwrap();
        assert_eq!((shadows.needed_by, shadows.millis), (0, None));
        let expected =
            "all effects take 1.50 times as long; the largest difference is 102.0 of 255, and 0.100 % of pixels";
        assert!(summary.against_all.starts_with(expected), "{}", summary.against_all);
        assert!(summary.to_string().contains("motion blur            3/4                 3.0"), "{summary}");
        let left_out = "differ by more than 1; not measurable and left out: motion blur in 1 of 3\n";
        assert!(summary.to_string().ends_with(left_out), "{summary}");
        let all_measured = CostSummary::of(&[&scenes[0], &scenes[3]]).unwrap();
        assert!(all_measured.against_all.ends_with("differ by more than 1"), "{}", all_measured.against_all);
        assert_eq!(CostSummary::of(&[]), None);
    }

    /// A frame whose time is not measurable is not compared with its time with all effects, which is.
    #[test]
    fn frames_that_cannot_be_measured_are_left_out_of_the_comparison() {
        let mut scenes = [costs(0.010, 0.030, &[], 0.0), costs(0.010, 0.090, &[], 0.0), costs(0.010, 0.030, &[], 0.0)];
        scenes[1].frame = timing(None);
        let text = |scenes: &[FrameCosts]| CostSummary::of(&scenes.iter().collect::<Vec<_>>()).unwrap().against_all;
        assert!(text(&scenes).starts_with("all effects take 3.00 times as long; "), "{}", text(&scenes));
        assert!(text(&scenes).ends_with("; not measurable and left out: the frame in 1 of 3"), "{}", text(&scenes));
        let none = text(&scenes[1..2]);
        assert!(none.starts_with("how much longer all effects take is not measurable; "), "{none}");
        scenes[2].all = timing(None);
        assert!(text(&scenes).ends_with("the frame in 1 of 3, the frame with all effects in 1 of 3"));
    }
}
