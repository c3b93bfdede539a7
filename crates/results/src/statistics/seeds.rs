//! Several trainings of one network: the spread that training causes in addition to that of scenes.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::SceneMean;
use super::bootstrap::{CONFIDENCE, MIN_SCENES};
use super::significance::student_quantile;

/// A mean over trainings and scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Seeds {
    /// The mean over the scenes that every training has a score for, each with its weight in the protocol's mean.
    pub mean: f64,
    /// Its 95 % interval for other scenes and other trainings; `None` with fewer than [`MIN_SCENES`] scenes.
    pub interval: Option<[f64; 2]>,
    /// Number of trainings.
    pub seeds: u64,
    /// Scenes that every training has a score for.
    pub scenes: u64,
    /// Standard deviation over trainings, of their means.
    pub training_deviation: f64,
    /// Standard deviation over scenes, of their means over trainings.
    pub scene_deviation: f64,
}

/// The mean over several trainings, each given by its scene means. `None` with fewer than two trainings or without common
/// scenes.
///
/// The interval is Student's, with the variances of scenes and of trainings added and Satterthwaite's degrees of freedom:
/// two or three trainings are too few to be resampled. Both variances contain the part of each score that is of its scene in this
/// training alone, so that the interval is rather too wide.
pub fn mean_over_seeds(trainings: &[Vec<SceneMean>]) -> Option<Seeds> {
    let Matrix { table, weights } = matrix(trainings)?;
    let scenes = over_scenes(&table);
    let seeds = spread(&over_seeds(&table, &weights)).filter(|_| table.len() > 1)?;
    Some(combined(weighted_spread(&scenes, &weights)?, &[seeds], table.len() as u64))
}

/// The difference between the means of two networks, `a - b`, of which at least one was trained several times. `None` without
/// common scenes.
pub fn difference_of_seeds(a: &[Vec<SceneMean>], b: &[Vec<SceneMean>]) -> Option<Seeds> {
    let both: Vec<Vec<SceneMean>> = a.iter().chain(b).cloned().collect();
    let Matrix { table, weights } = matrix(&both)?;
    let (first, second) = table.split_at_checked(a.len())?;
    let differences: Vec<f64> =
        over_scenes(first).iter().zip(over_scenes(second)).map(|(one, other)| one - other).collect();
    let several = [first, second].into_iter().filter(|trainings| trainings.len() > 1);
    let spreads: Vec<Spread> = several.filter_map(|trainings| spread(&over_seeds(trainings, &weights))).collect();
    Some(combined(weighted_spread(&differences, &weights)?, &spreads, both.len() as u64))
}

/// Mean, variance and number of values.
#[derive(Clone, Copy, Debug)]
struct Spread {
    mean: f64,
    variance: f64,
    count: usize,
}

fn spread(values: &[f64]) -> Option<Spread> {
    weighted_spread(values, &vec![1.0; values.len()])
}

/// The spread of the values' contributions to their weighted mean, a ratio of sums.
fn weighted_spread(values: &[f64], weights: &[f64]) -> Option<Spread> {
    let count = values.len();
    let mean = weighted_mean(values, weights);
    let average = weights.iter().sum::<f64>() / count as f64;
    let squares: f64 =
        values.iter().zip(weights).map(|(value, weight)| (weight / average * (value - mean)).powi(2)).sum();
    let freedom = count.checked_sub(1)?;
    let variance = if freedom == 0 { 0.0 } else { squares / freedom as f64 };
    Some(Spread { mean, variance, count })
}

/// What degrees of freedom may lose by rounding, as a share.
const ROUNDING: f64 = 1e-9;

fn combined(scenes: Spread, trainings: &[Spread], seeds: u64) -> Seeds {
    let parts: Vec<(f64, usize)> = std::iter::once(&scenes)
        .chain(trainings)
        .map(|spread| (spread.variance / spread.count as f64, spread.count.saturating_sub(1).max(1)))
        .collect();
    let variance: f64 = parts.iter().map(|(variance, _)| variance).sum();
    let squares: f64 = parts.iter().map(|(variance, freedom)| variance.powi(2) / *freedom as f64).sum();
    // Satterthwaite's degrees of freedom are between the smallest of the parts' and their sum.
    let least = parts.iter().map(|(_, freedom)| *freedom).min().unwrap_or(1);
    let most: usize = parts.iter().map(|(_, freedom)| freedom).sum();
    let is_within = |freedom: &usize| *freedom as f64 * squares <= variance.powi(2) * (1.0 + ROUNDING);
    let freedom = (least..=most).rev().find(is_within).unwrap_or(least);
    let half = student_quantile(f64::midpoint(1.0, CONFIDENCE), freedom) * variance.sqrt();
    let enough = scenes.count as u64 >= MIN_SCENES;
    let mean_variance = trainings.iter().map(|spread| spread.variance).sum::<f64>();
    Seeds {
        mean: scenes.mean,
        interval: enough.then_some([scenes.mean - half, scenes.mean + half]),
        seeds,
        scenes: scenes.count as u64,
        training_deviation: mean_variance.sqrt(),
        scene_deviation: scenes.variance.sqrt(),
    }
}

fn weighted_mean(values: &[f64], weights: &[f64]) -> f64 {
    let sum: f64 = values.iter().zip(weights).map(|(value, weight)| value * weight).sum();
    sum / weights.iter().sum::<f64>()
}

/// The scenes that every training has.
struct Matrix {
    /// Their means, training by training.
    table: Vec<Vec<f64>>,
    /// Their weights, averaged over the trainings, some of which may lack targets.
    weights: Vec<f64>,
}

/// `None` without a common scene.
fn matrix(trainings: &[Vec<SceneMean>]) -> Option<Matrix> {
    let by_scene: Vec<BTreeMap<&str, &SceneMean>> =
        trainings.iter().map(|means| means.iter().map(|scene| (scene.scene.as_str(), scene)).collect()).collect();
    let mut common: BTreeSet<&str> = by_scene.first()?.keys().copied().collect();
    common.retain(|scene| by_scene.iter().all(|training| training.contains_key(scene)));
    let row = |training: &BTreeMap<&str, &SceneMean>| {
        common.iter().filter_map(|scene| training.get(scene)).map(|scene| scene.mean).collect::<Vec<f64>>()
    };
    let weight = |scene: &&str| {
        let weights = by_scene.iter().filter_map(|training| training.get(scene)).map(|scene| scene.weight);
        weights.sum::<f64>() / by_scene.len() as f64
    };
    (!common.is_empty())
        .then(|| Matrix { table: by_scene.iter().map(row).collect(), weights: common.iter().map(weight).collect() })
}

fn over_seeds(table: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
    table.iter().map(|scenes| weighted_mean(scenes, weights)).collect()
}

fn over_scenes(table: &[Vec<f64>]) -> Vec<f64> {
    let scenes = table.first().map_or(0, Vec::len);
    let mean = |scene: usize| table.iter().filter_map(|means| means.get(scene)).sum::<f64>() / table.len() as f64;
    (0..scenes).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    fn scene(name: &str, weight: f64, mean: f64) -> SceneMean {
        SceneMean { scene: name.to_owned(), mean, weight, targets: 1, identical: 0 }
    }

    /// A scene with three entries at 10 dB and one with a single entry at 30 dB: 15, as the protocol averages them, not 20.
    #[test]
    fn a_scene_counts_as_in_the_protocols_mean() {
        let training = |offset: f64| vec![scene("a", 3.0, 10.0 + offset), scene("b", 1.0, 30.0 - offset)];
        let found = mean_over_seeds(&[training(-1.0), training(1.0)]).unwrap();
        Tolerance::F64.assert([found.mean, found.training_deviation], [15.0, 0.5f64.sqrt()], "14.5 and 15.5");
        // Contributions 3/2 · (10 − 15) and 1/2 · (30 − 15).
        Tolerance::F64.assert([found.scene_deviation], [2.0f64.sqrt() * 7.5], "scenes");
        let found = difference_of_seeds(&[training(2.0)], &[training(0.0)]).unwrap();
        Tolerance::F64.assert([found.mean], [1.0], "3/4 · 2 − 1/4 · 2");
    }

    /// Six and seven scenes with five and six degrees of freedom, which do not differ between trainings.
    #[test]
    fn trainings_that_do_not_vary_leave_the_scenes_degrees_of_freedom() {
        for (count, quantile) in [(6u8, 2.570_581_835_636_314), (7, 2.446_911_851_144_969)] {
            for step in [0.1, 0.3, 0.7, 1.1, 1.9, 2.3] {
                let training: Vec<SceneMean> =
                    (0..count).map(|at| scene(&at.to_string(), 1.0, 20.0 + step * f64::from(at))).collect();
                let found = mean_over_seeds(&[training.clone(), training]).unwrap();
                let half = quantile * found.scene_deviation / f64::from(count).sqrt();
                let interval = [found.mean - half, found.mean + half];
                Tolerance::relative(1e-9).assert(
                    found.interval.unwrap(),
                    interval,
                    &format!("{count} scenes, {step} dB apart"),
                );
            }
        }
    }

    /// Three trainings against two, whose scenes differ by half a decibel more.
    #[test]
    fn a_difference_has_the_variances_of_its_scenes_and_of_both_networks_trainings() {
        let training = |step: f64, offset: f64| -> Vec<SceneMean> {
            (0..6u8).map(|at| scene(&at.to_string(), 1.0, 20.0 + step * f64::from(at) + offset)).collect()
        };
        let (three, two) = ([-0.3, 0.0, 0.3].map(|by| training(2.0, by)), [1.0, 1.4].map(|by| training(2.5, by)));
        let found = difference_of_seeds(&three, &two).unwrap();
        let expected = [-2.45, 0.17f64.sqrt(), 0.875f64.sqrt()];
        let numbers = [found.mean, found.training_deviation, found.scene_deviation];
        Tolerance::relative(1e-9).assert(numbers, expected, "mean and deviations");
        assert_eq!((found.seeds, found.scenes), (5, 6));
        // 0.875/6 of scenes, 0.09/3 and 0.08/2 of trainings; Satterthwaite: 7.39 degrees of freedom, so 7.
        let half = 2.364_624_251_592_785 * (0.875 / 6.0 + 0.03 + 0.04f64).sqrt();
        Tolerance::relative(1e-9).assert(found.interval.unwrap(), [-2.45 - half, -2.45 + half], "interval");
    }
}
