use super::SamplingRule;
use crate::overlap::{EpipolarRays, OverlapEstimator};
use crate::samplers::{Bounded, EvenlySpaced, EveryNth, FarthestPoint, OverlapPairs, Sampler, TargetRule};

/// A condition on numbers of a sampling rule.
pub(super) struct Check {
    holds: bool,
    /// The fields with these numbers.
    pub(super) field: String,
    pub(super) expected: &'static str,
    pub(super) found: String,
}

/// The first condition that a rule violates.
pub(super) fn first_violation(rule: &SamplingRule) -> Option<Check> {
    let mut checks = match &rule.sampler {
        Sampler::EvenlySpaced(sampler) => vec![used_share(sampler)],
        Sampler::EveryNth(sampler) => vec![frames_between_targets(sampler)],
        Sampler::OverlapPairs(sampler) => of_pairs(sampler),
        Sampler::Bounded(sampler) => of_bounded(sampler),
        Sampler::FarthestPoint(sampler) => vec![room_in_window(sampler)],
        Sampler::AllFrames => Vec::new(),
    };
    if let Some(overlap) = rule.overlap {
        checks.push(bounds("overlap, minimum and maximum", overlap.minimum, overlap.maximum));
        if let OverlapEstimator::EpipolarRay(rays) = &overlap.estimator {
            checks.extend(crop(rays));
        }
    }
    checks.into_iter().find(|check| !check.holds)
}

fn used_share(EvenlySpaced { ratio, .. }: &EvenlySpaced) -> Check {
    let holds = *ratio > 0.0 && *ratio <= 1.0;
    check(holds, "ratio", "a fraction of the scene, above 0 and at most 1", ratio.to_string())
}

fn frames_between_targets(EveryNth { every, .. }: &EveryNth) -> Check {
    check(every.get() >= 2, "every", "at least 2, so that not every frame is a target", every.to_string())
}

fn of_pairs(pairs: &OverlapPairs) -> Vec<Check> {
    let mut checks = vec![
        bounds("min-overlap and max-overlap", pairs.min_overlap, pairs.max_overlap),
        gaps("min-distance and max-distance", pairs.min_distance.get(), pairs.max_distance),
    ];
    checks.extend(crop(&pairs.overlap));
    checks
}

fn crop(rays: &EpipolarRays) -> Option<Check> {
    let crop = rays.crop?;
    let holds = crop.width > 0 && crop.height > 0;
    Some(check(holds, "overlap, crop", "at least one pixel on each side", crop.to_string()))
}

fn of_bounded(sampler: &Bounded) -> Vec<Check> {
    let (views, schedule, least) = (sampler.context_views.get(), &sampler.gaps, sampler.least_gap());
    let mut checks = vec![
        check(views >= 2, "context-views", "at least the two ends of the window", views.to_string()),
        gaps("gaps, min and max", schedule.min, schedule.max),
        gaps("gaps, initial-min and initial-max", schedule.initial_min, schedule.initial_max),
        check(
            schedule.max >= least,
            "gaps, max",
            "a gap with room for the context views, the targets and twice min-distance-to-context",
            format!("{}, where {least} are needed", schedule.max),
        ),
    ];
    checks.extend(schedule.falling().map(|(names, initial, last)| {
        let expected = "a bound that does not fall during the warm-up";
        check(false, &format!("gaps, {names}"), expected, format!("{initial} and {last}"))
    }));
    checks
}

fn room_in_window(FarthestPoint { window, context_views, targets, .. }: &FarthestPoint) -> Check {
    let (window, views) = (window.get(), context_views.get());
    let least = match targets {
        TargetRule::Sampled { count, allow_context: false, .. } | TargetRule::Spread { count } => {
            views.saturating_add(count.get())
        }
        TargetRule::Sampled { count, .. } => views.max(count.get()),
        TargetRule::Window | TargetRule::BetweenContext => views,
    };
    let expected = "a window with room for the context views and the sampled targets";
    check(window >= least, "window", expected, format!("{window}, where {least} are needed"))
}

fn bounds(field: &str, minimum: f64, maximum: f64) -> Check {
    let in_order = 0.0 <= minimum && minimum <= maximum && maximum <= 1.0;
    check(in_order, field, "bounds in order, from 0 to 1", format!("{minimum} and {maximum}"))
}

fn gaps(field: &str, least: usize, most: usize) -> Check {
    check(least <= most, field, "the smallest gap, then the largest", format!("{least} and {most}"))
}

fn check(holds: bool, field: &str, expected: &'static str, found: String) -> Check {
    Check { holds, field: field.to_owned(), expected, found }
}
