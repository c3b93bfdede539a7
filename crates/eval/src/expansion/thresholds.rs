//! Thresholds of token expansion by quantile of a network's scores.
//!
//! The paper's thresholds are values of the uncertainty of the paper's networks. A network at another scale has other scores, and
//! all of the paper's thresholds may expand the same tokens; the same quantiles of this network's scores give different budgets.

use std::collections::BTreeSet;

use atsplat_model::network::Network;
use atsplat_numeric::quantile;
use atsplat_protocol::EvaluationIndex;

use super::context_views;
use crate::EvalError;
use crate::method::trial_seed;
use crate::runner::Dataset;

/// The paper's thresholds (supplement, "Dynamic Gaussian Budgets via Uncertainty Thresholds"), each with quantiles whose mean budgets
/// have about the paper's proportions to its fixed budget of 23 thousand Gaussians: 13, 19 and 37 thousand, for its 13, 19 and 39.
pub const PUBLISHED: [([f64; 3], [f64; 3]); 3] =
    [([0.1, 0.1, 0.4], [0.8, 0.8, 0.9]), ([0.05, 0.05, 0.2], [0.6, 0.6, 0.8]), ([0.01, 0.01, 0.04], [0.2, 0.2, 0.6])];

/// Number of trials whose scores are pooled.
const TRIALS: usize = 4;

/// The scores of each block that expands by score, in order, over the tokens of a dataset's first trials.
///
/// # Errors
/// [`EvalError::Settings`] if one of them cannot be read, or there is none; the errors of the network.
pub fn scores(network: &Network, dataset: &Dataset) -> Result<Vec<Vec<f64>>, EvalError> {
    let keys: BTreeSet<&String> = dataset.source.keys().iter().collect();
    let first = dataset.index.index.scenes.iter().filter_map(|(key, entries)| {
        let present = keys.contains(key);
        Some((key.clone(), vec![entries.first().filter(|_| present)?.clone()]))
    });
    let index = EvaluationIndex { scenes: first.take(TRIALS).collect() };
    let mut blocks: Vec<Vec<f64>> = Vec::new();
    for prepared in dataset.trials(&index) {
        let (trial, _) = prepared.map_err(|skipped| EvalError::Settings {
            what: "thresholds by quantile",
            expected: format!("the first {TRIALS} trials of {}", dataset.name),
            found: skipped.to_string(),
        })?;
        let settings = |error: crate::expansion::ExpansionError| EvalError::Settings {
            what: "thresholds by quantile",
            expected: format!("context images of {}", trial.scene()),
            found: error.to_string(),
        };
        let scored = network.scores(&context_views(&trial).map_err(settings)?, trial_seed(0, &trial))?;
        for (at, scores) in scored.into_iter().enumerate() {
            if blocks.len() == at {
                blocks.push(Vec::new());
            }
            if let Some(block) = blocks.get_mut(at) {
                block.extend(scores.into_iter().map(f64::from));
            }
        }
    }
    if blocks.is_empty() {
        return Err(EvalError::Settings {
            what: "thresholds by quantile",
            expected: "trials whose tokens are scored".to_owned(),
            found: format!("none in {}", dataset.name),
        });
    }
    Ok(blocks)
}

/// The quantile of each block's scores, to three significant digits; `None` if their numbers differ or a block has no score.
pub fn at_quantiles(scores: &[Vec<f64>], quantiles: &[f64]) -> Option<Vec<f64>> {
    let of_block = |(scores, at): (&Vec<f64>, &f64)| {
        let mut sorted = scores.clone();
        sorted.sort_by(f64::total_cmp);
        quantile(&sorted, *at).map(three_digits)
    };
    (scores.len() == quantiles.len()).then(|| scores.iter().zip(quantiles).map(of_block).collect())?
}

/// Rounded, so that a label can print the whole value.
fn three_digits(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn each_block_has_another_quantile() {
        let scores = [(0..=100).rev().map(f64::from).collect(), (0..=10).map(|at| f64::from(at) * 0.001_234).collect()];
        let found = at_quantiles(&scores, &[0.8, 0.3]).unwrap();
        Tolerance::relative(1e-12).assert(found, [80.0, 0.0037], "0.3 of 0.012 34, to three digits");
        assert_eq!(at_quantiles(&scores, &[0.8]), None);
        assert_eq!(at_quantiles(&[Vec::new()], &[0.8]), None);
    }

    /// 512 tokens of 16 Gaussians, of which each block expands the share above its quantile.
    #[test]
    fn quantiles_give_about_the_published_budgets() {
        let of_quantiles =
            |quantiles: [f64; 3]| quantiles.iter().fold(8192.0, |budget: f64, quantile| budget * (2.0 - quantile));
        let budgets = PUBLISHED.map(|(_, quantiles)| of_quantiles(quantiles));
        Tolerance::absolute(1.0).assert(budgets, [12_976.0, 19_268.0, 37_159.0], "of the quantiles");
        Tolerance::relative(0.05).assert(budgets, [13e3, 19e3, 39e3], "near those of the paper");
    }

    #[test]
    fn looser_published_thresholds_have_lower_quantiles() {
        for pair in PUBLISHED.windows(2) {
            for block in 0..3 {
                assert!(pair[0].0[block] > pair[1].0[block] && pair[0].1[block] > pair[1].1[block]);
            }
        }
    }
}
