//! Slopes: how a metric changes with overlap, with distance from the context, or with a setting of the method.

use std::collections::BTreeMap;

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
    /// Its 95 % interval, by resampling scenes as [`super::interval_of_mean`] does; `None` with fewer than
    /// [`MIN_SCENES`].
    pub interval: Option<[f64; 2]>,
    /// Scenes that the slope rests on: those with scores, and for lines within scenes only those with two different values of the
    /// property.
    pub scenes: u64,
}

/// Points of one scene: the property, and the score.
type Points = Vec<[f64; 2]>;

/// The slope over overlap (per 1.0 of overlap): one line through the targets of all scenes, because overlap differs between
/// trials more than within them. `None` without two different overlaps.
pub fn along_overlap(results: &Results, query: &MetricQuery) -> Option<Trend> {
    over_overlap(&select(results, query))
}

/// The slope over the distance from the window of context frames, per frame, of the targets outside it: lines of one slope,
/// each scene at another height. Scenes without two different distances do not count; `None` if no scene has them.
pub fn along_distance(results: &Results, query: &MetricQuery) -> Option<Trend> {
    over_distance(&select(results, query))
}

/// The slope of `a − b` over overlap, as of [`along_overlap`], over the targets that both have a score for.
pub fn lead_along_overlap(a: (&Results, &MetricQuery), b: (&Results, &MetricQuery)) -> Option<Trend> {
    over_overlap(&differences(&select(a.0, a.1), &select(b.0, b.1)).0)
}

/// The slope of `a − b` over the distance from the window, as of [`along_distance`], over the targets that both have a score
/// for.
pub fn lead_along_distance(a: (&Results, &MetricQuery), b: (&Results, &MetricQuery)) -> Option<Trend> {
    over_distance(&differences(&select(a.0, a.1), &select(b.0, b.1)).0)
}

fn over_overlap(targets: &[SelectedTarget<'_>]) -> Option<Trend> {
    let scenes = by_scene(targets, |target| target.overlap);
    of_sums(&one_line(&scenes.into_values().collect::<Vec<_>>()))
}

fn over_distance(targets: &[SelectedTarget<'_>]) -> Option<Trend> {
    let outside = |distance: i64| (distance != 0).then(|| distance.unsigned_abs() as f64);
    of_sums(&parallel_lines(by_scene(targets, |target| target.distance.and_then(outside)).into_values()))
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
/// height. Only scenes that all settings have count. `None` without two different values.
pub fn along_setting(settings: &[(f64, Vec<SceneMean>)]) -> Option<Trend> {
    let mut scenes: BTreeMap<&str, Points> = BTreeMap::new();
    for (value, means) in settings {
        for scene in means {
            scenes.entry(&scene.scene).or_default().push([*value, scene.mean]);
        }
    }
    of_sums(&parallel_lines(scenes.into_values().filter(|points| points.len() == settings.len())))
}

/// Sums of a scene from which a slope follows: count, x, y, x², xy.
type Sums = [f64; 5];

/// Spread below which all values of the property are the same, in the square of its unit.
const LEAST_SPREAD: f64 = 1e-12;

fn one_line(scenes: &[Points]) -> Vec<Sums> {
    // Sums of centred numbers lose no digits.
    let middle = mean(scenes.iter().flatten());
    scenes.iter().map(|points| sums(points, middle, points.len() as f64)).collect()
}

/// Each scene is centred by itself, which leaves nothing of its height. A scene with a single value of the property says nothing
/// about the slope, and must not make its interval look as if it did.
fn parallel_lines(scenes: impl Iterator<Item = Points>) -> Vec<Sums> {
    let centred = scenes.map(|points| sums(&points, mean(points.iter()), 1.0));
    centred.filter(|scene| spread(*scene) > LEAST_SPREAD).collect()
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

fn slope(sums: Sums) -> f64 {
    let [n, sx, sy, _, sxy] = sums;
    (sxy - sx * sy / n) / spread(sums)
}

fn of_sums(scenes: &[Sums]) -> Option<Trend> {
    let all = scenes.iter().fold([0.0; 5], |all: Sums, scene| std::array::from_fn(|at| all[at] + scene[at]));
    let found = Some(slope(all)).filter(|slope| slope.is_finite() && spread(all) > LEAST_SPREAD)?;
    let enough = scenes.len() as u64 >= MIN_SCENES;
    let interval = enough.then(|| interval_of(scenes, resamples(scenes.len()), slope)).flatten();
    Some(Trend { slope: found, interval, scenes: scenes.len() as u64 })
}
