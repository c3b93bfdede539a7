//! Slopes: how a metric changes with overlap, with distance from the context, or with a setting of the method.

use std::collections::BTreeMap;

use atsplat_numeric::Extremes as _;
use serde::Serialize;

use super::bootstrap::{MIN_SCENES, interval_of, resamples};
use super::paired::differences;
use super::selection::{SelectedTarget, select};
use super::{MetricQuery, SceneMean};
use crate::Results;

/// The slope of a metric along a property of targets or a setting of the method, by least squares.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Trend {
    /// Change of the metric per unit.
    pub slope: f64,
    /// Its 95 % interval, by resampling scenes as [`super::interval_of_mean`] does. Resamples that draw scenes of one overlap have no
    /// slope and are left out; `None` if they are more than those beyond an end of the interval.
    pub interval: Option<[f64; 2]>,
    /// Scenes that the slope rests on: those with scores, and for lines within scenes only those with two different values of the
    /// property. At least [`MIN_SCENES`].
    pub scenes: u64,
}

/// Why no slope is given.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoTrend {
    /// It would rest on fewer scenes ([`Trend::scenes`]) than [`MIN_SCENES`].
    #[error("expected at least {expected} scenes, found {found}")]
    FewScenes {
        /// [`MIN_SCENES`].
        expected: u64,
        /// Those that it would rest on.
        found: u64,
    },
    /// The overlaps are so close to each other that the slope, which tables print per 0.1, would be an extrapolation.
    #[error("expected overlaps that differ by at least {expected}, found {found:.3}")]
    CloseOverlaps {
        /// 0.1.
        expected: f64,
        /// The largest difference.
        found: f64,
    },
    /// Scores are so large that the slope is not finite.
    #[error("expected a finite slope, found another")]
    NotFinite,
}

/// Points of one scene: the property, and the score.
type Points = Vec<[f64; 2]>;

/// The slope over overlap (per 1.0 of overlap): one line through the targets of all scenes, because overlap differs between
/// trials more than within them.
///
/// # Errors
/// [`NoTrend`], also for overlaps that differ by less than 0.1.
pub fn along_overlap(results: &Results, query: &MetricQuery) -> Result<Trend, NoTrend> {
    over_overlap(&select(results, query))
}

/// The slope over the distance from the window of context frames, per frame, of the targets outside it: lines of one slope,
/// each scene at another height. Scenes without two different distances do not count.
///
/// # Errors
/// [`NoTrend`].
pub fn along_distance(results: &Results, query: &MetricQuery) -> Result<Trend, NoTrend> {
    over_distance(&select(results, query))
}

/// The slope of `a − b` over overlap, as of [`along_overlap`], over the targets that both have a score for.
///
/// # Errors
/// Those of [`along_overlap`].
pub fn lead_along_overlap(a: (&Results, &MetricQuery), b: (&Results, &MetricQuery)) -> Result<Trend, NoTrend> {
    over_overlap(&differences(&select(a.0, a.1), &select(b.0, b.1)).0)
}

/// The slope of `a − b` over the distance from the window, as of [`along_distance`], over the targets that both have a score
/// for.
///
/// # Errors
/// Those of [`along_distance`].
pub fn lead_along_distance(a: (&Results, &MetricQuery), b: (&Results, &MetricQuery)) -> Result<Trend, NoTrend> {
    over_distance(&differences(&select(a.0, a.1), &select(b.0, b.1)).0)
}

fn over_overlap(targets: &[SelectedTarget<'_>]) -> Result<Trend, NoTrend> {
    let scenes: Vec<Points> = by_scene(targets, |target| target.overlap).into_values().collect();
    enough(&scenes)?;
    let overlaps = scenes.iter().flatten().map(|[overlap, _]| *overlap);
    let [low, high] = overlaps.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], overlap| {
        [low.minimum_of(overlap), high.maximum_of(overlap)]
    });
    if high - low < MIN_RANGE - ROUNDING {
        return Err(NoTrend::CloseOverlaps { expected: MIN_RANGE, found: high - low });
    }
    trend_of_sums(&one_line(&scenes))
}

fn over_distance(targets: &[SelectedTarget<'_>]) -> Result<Trend, NoTrend> {
    let outside = |distance: i64| (distance != 0).then(|| distance.unsigned_abs() as f64);
    trend_of_sums(&parallel_lines(by_scene(targets, |target| target.distance.and_then(outside)).into_values()))
}

/// The points of every scene, of the targets that have the property and a score.
fn by_scene<'a>(
    targets: &[SelectedTarget<'a>],
    property: impl Fn(&SelectedTarget<'a>) -> Option<f64>,
) -> BTreeMap<&'a str, Points> {
    let mut scenes: BTreeMap<&str, Points> = BTreeMap::new();
    for target in targets {
        if let Some((at, score)) = property(target).zip(target.score()) {
            scenes.entry(target.scene).or_default().push([at, score]);
        }
    }
    scenes
}

/// The slope over a setting, given as its value with the scene means that it led to: lines of one slope, each scene at another
/// height. Only scenes that all settings have count, and without two different values none.
///
/// # Errors
/// [`NoTrend`].
pub fn along_setting(settings: &[(f64, Vec<SceneMean>)]) -> Result<Trend, NoTrend> {
    let mut scenes: BTreeMap<&str, Points> = BTreeMap::new();
    for (value, means) in settings {
        for scene in means {
            scenes.entry(&scene.scene).or_default().push([*value, scene.mean]);
        }
    }
    trend_of_sums(&parallel_lines(scenes.into_values().filter(|points| points.len() == settings.len())))
}

/// Sums of a scene from which a slope follows: count, x, y, x², xy.
type Sums = [f64; 5];

/// Spread up to which all values of the property are the same, in the square of its unit, for each 1 of the count.
const MIN_SPREAD: f64 = 1e-12;
/// Smallest difference of overlaps that a slope is measured over: the unit in which tables print it.
const MIN_RANGE: f64 = 0.1;
/// What a difference of two overlaps may lose by rounding.
const ROUNDING: f64 = 1e-9;

fn one_line(scenes: &[Points]) -> Vec<Sums> {
    // Sums of centred numbers lose no digits.
    let middle = mean(scenes.iter().flatten());
    scenes.iter().map(|points| sums(points, middle, points.len() as f64)).collect()
}

/// Each scene is centred by itself, which leaves nothing of its height. A scene with a single value of the property says nothing
/// about the slope, and must not make its interval look as if it did.
fn parallel_lines(scenes: impl Iterator<Item = Points>) -> Vec<Sums> {
    let centred = scenes.map(|points| sums(&points, mean(points.iter()), 1.0));
    centred.filter(|scene| spread(*scene) > MIN_SPREAD).collect()
}

fn mean<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> [f64; 2] {
    let (sums, count) = points.fold(([0.0; 2], 0.0), |([x, y], count), at| ([x + at[0], y + at[1]], count + 1.0));
    sums.map(|sum| sum / count)
}

fn sums(points: &Points, [x, y]: [f64; 2], count: f64) -> Sums {
    let centred = points.iter().map(|point| [point[0] - x, point[1] - y]);
    centred.fold([count, 0.0, 0.0, 0.0, 0.0], |[n, sx, sy, sxx, sxy], [x, y]| {
        [n, sx + x, sy + y, sxx + x * x, sxy + x * y]
    })
}

fn spread([n, sx, _, sxx, _]: Sums) -> f64 {
    sxx - sx * sx / n
}

/// NaN if all values of the property are the same, whose spread is what rounding leaves.
fn slope(sums: Sums) -> f64 {
    let [n, sx, sy, _, sxy] = sums;
    let spread = spread(sums);
    if spread > MIN_SPREAD * n { (sxy - sx * sy / n) / spread } else { f64::NAN }
}

/// A line through few scenes is no trend, as their mean has no interval.
const fn enough<T>(scenes: &[T]) -> Result<(), NoTrend> {
    let found = scenes.len() as u64;
    if found < MIN_SCENES { Err(NoTrend::FewScenes { expected: MIN_SCENES, found }) } else { Ok(()) }
}

fn trend_of_sums(scenes: &[Sums]) -> Result<Trend, NoTrend> {
    enough(scenes)?;
    let all = scenes.iter().fold([0.0; 5], |all: Sums, scene| std::array::from_fn(|at| all[at] + scene[at]));
    let found = slope(all);
    if !found.is_finite() {
        return Err(NoTrend::NotFinite);
    }
    let interval = interval_of(scenes, resamples(scenes.len()), slope);
    Ok(Trend { slope: found, interval, scenes: scenes.len() as u64 })
}
