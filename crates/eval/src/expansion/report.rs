use std::fmt;

use atsplat_numeric::counted;
use atsplat_results::statistics::{MIN_SCENES, interval_of_mean};
use indexmap::IndexMap;
use serde::Serialize;

use super::thresholds::{PUBLISHED, at_quantiles};
use super::{BlockMeasurement, ExpansionGap, TrialMeasurement};

/// Token expansion of a network over the trials of a protocol. [`Display`](fmt::Display) prints Markdown.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ExpansionReport {
    /// Name of the network.
    pub network: String,
    /// Name of the protocol.
    pub protocol: String,
    /// Number of scenes.
    pub scenes: usize,
    /// Number of trials.
    pub trials: usize,
    /// What of the protocol and the data is not in these trials.
    pub gaps: Vec<ExpansionGap>,
    /// The blocks that expand, in order.
    pub blocks: Vec<BlockRow>,
    /// Thresholds for the paper's dynamic budgets; empty if not three blocks score their tokens.
    pub thresholds: Vec<ThresholdRow>,
}

/// One block of the decoder. Numbers of tokens are means over trials.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BlockRow {
    /// Its number, from 1.
    pub block: usize,
    /// Tokens that enter it.
    pub tokens: f64,
    /// Tokens that it expands.
    pub expanded: f64,
    /// Same as [`BlockMeasurement::correlation`].
    pub correlation: Option<MeanOverScenes>,
    /// Same as [`BlockMeasurement::contrast`].
    pub contrast: Option<MeanOverScenes>,
    /// Same as [`Spread::of_children`](super::Spread::of_children).
    pub of_children: Option<MeanOverScenes>,
    /// Same as [`Spread::from_parent`](super::Spread::from_parent).
    pub from_parent: Option<MeanOverScenes>,
}

/// A mean over trials, with an interval over scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeanOverScenes {
    /// Over the trials that have the number.
    pub mean: f64,
    /// 95 % interval over scenes; `None` with fewer than [`MIN_SCENES`].
    pub interval: Option<[f64; 2]>,
}

/// Thresholds that select the same share of a network's scores as the paper's thresholds do of its networks' scores.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ThresholdRow {
    /// The paper's.
    pub published: [f64; 3],
    /// Quantiles of the scores of each block.
    pub quantiles: [f64; 3],
    /// This network's, to three significant digits.
    pub thresholds: Vec<f64>,
}

impl ExpansionReport {
    /// Summarises trials; `gaps` is what is missing from them.
    pub fn new(network: &str, protocol: &str, trials: &[TrialMeasurement], gaps: Vec<ExpansionGap>) -> Self {
        let mut by_block: IndexMap<usize, Vec<(&str, &BlockMeasurement)>> = IndexMap::new();
        for trial in trials {
            for block in &trial.blocks {
                by_block.entry(block.block).or_default().push((&trial.scene, block));
            }
        }
        by_block.sort_keys();
        let scores_of = |trials: &Vec<(&str, &BlockMeasurement)>| -> Vec<f64> {
            trials.iter().flat_map(|(_, block)| block.scores.iter().copied()).collect()
        };
        let scores: Vec<Vec<f64>> = by_block.values().map(scores_of).filter(|scores| !scores.is_empty()).collect();
        let thresholds = PUBLISHED.iter().filter_map(|(published, quantiles)| {
            let thresholds = at_quantiles(&scores, quantiles)?;
            Some(ThresholdRow { published: *published, quantiles: *quantiles, thresholds })
        });
        let mut scenes: Vec<&str> = trials.iter().map(|trial| trial.scene.as_str()).collect();
        scenes.dedup();
        Self {
            network: network.to_owned(),
            protocol: protocol.to_owned(),
            scenes: scenes.len(),
            trials: trials.len(),
            gaps,
            thresholds: thresholds.collect(),
            blocks: by_block.iter().map(|(block, trials)| row(*block, trials)).collect(),
        }
    }
}

fn row(block: usize, trials: &[(&str, &BlockMeasurement)]) -> BlockRow {
    let mean = |count: fn(&BlockMeasurement) -> usize| {
        trials.iter().map(|(_, measured)| count(measured) as f64).sum::<f64>() / trials.len() as f64
    };
    BlockRow {
        block,
        tokens: mean(|measured| measured.tokens),
        expanded: mean(|measured| measured.expanded),
        correlation: over_scenes(trials, |measured| measured.correlation),
        contrast: over_scenes(trials, |measured| measured.contrast),
        of_children: over_scenes(trials, |measured| Some(measured.children?.of_children)),
        from_parent: over_scenes(trials, |measured| Some(measured.children?.from_parent)),
    }
}

/// `None` if no trial has the number.
fn over_scenes(
    trials: &[(&str, &BlockMeasurement)],
    number: impl Fn(&BlockMeasurement) -> Option<f64>,
) -> Option<MeanOverScenes> {
    let mut scenes: IndexMap<&str, [f64; 2]> = IndexMap::new();
    for (scene, measured) in trials {
        if let Some(number) = number(measured) {
            let [sum, count] = scenes.entry(scene).or_default();
            *sum += number;
            *count += 1.0;
        }
    }
    let clusters: Vec<[f64; 2]> = scenes.into_values().collect();
    let [sum, count] = clusters.iter().fold([0.0; 2], |[sum, count], scene| [sum + scene[0], count + scene[1]]);
    let enough = clusters.len() as u64 >= MIN_SCENES;
    (count > 0.0)
        .then(|| MeanOverScenes { mean: sum / count, interval: enough.then(|| interval_of_mean(&clusters)).flatten() })
}

impl fmt::Display for ExpansionReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { network, protocol, scenes, trials, .. } = self;
        writeln!(f, "## Token expansion of {network} on {protocol}\n")?;
        let [trials, scenes] = [(trials, "trial"), (scenes, "scene")].map(|(count, what)| counted(*count as u64, what));
        writeln!(f, "Means over {trials} of {scenes}; with their 95 % intervals over scenes, from six scenes on.\n")?;
        if !self.gaps.is_empty() {
            writeln!(f, "Not in these means:\n")?;
            self.gaps.iter().try_for_each(|gap| writeln!(f, "- {gap}"))?;
            writeln!(f)?;
        }
        writeln!(f, "| block | tokens | expanded | rank correlation | error ratio | children, px | parent, px |")?;
        writeln!(f, "| ---: | ---: | ---: | --- | --- | --- | --- |")?;
        for row in &self.blocks {
            let BlockRow { block, tokens, expanded, .. } = row;
            write!(f, "| {block} | {tokens:.0} | {expanded:.0} |")?;
            for number in [row.correlation, row.contrast, row.of_children, row.from_parent] {
                match number {
                    Some(number) => write!(f, " {number} |")?,
                    None => write!(f, " – |")?,
                }
            }
            writeln!(f)?;
        }
        writeln!(
            f,
            "\nRank correlation: Spearman's, of the predicted uncertainty and the error (1 − SSIM) over a target's pixels, before the \
             block expands. Error ratio: mean error where the expanded tokens cover a target, over that elsewhere. Children: root \
             mean square of their distances from their mean position; parent: distance of that position from the parent's; both \
             as medians over the expanded tokens that the first context view sees, in its pixels."
        )?;
        if !self.thresholds.is_empty() {
            let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" / ");
            writeln!(f, "\n| the paper's thresholds | quantiles of the scores | this network's thresholds |")?;
            writeln!(f, "| --- | --- | --- |")?;
            for row in &self.thresholds {
                writeln!(f, "| {} | {} | {} |", list(&row.published), list(&row.quantiles), list(&row.thresholds))?;
            }
        }
        Ok(())
    }
}

impl fmt::Display for MeanOverScenes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3}", self.mean)?;
        match self.interval {
            Some([low, high]) => write!(f, " [{low:.3}, {high:.3}]"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expansion::Spread;

    fn block(block: usize, correlation: Option<f64>, scores: &[f64]) -> BlockMeasurement {
        let children = Some(Spread { of_children: 2.0, from_parent: 0.5 });
        BlockMeasurement {
            block,
            tokens: 8,
            expanded: 3,
            scores: scores.to_vec(),
            correlation,
            contrast: None,
            children,
        }
    }

    fn trial(scene: usize, blocks: Vec<BlockMeasurement>) -> TrialMeasurement {
        TrialMeasurement { scene: format!("scene-{scene}"), blocks }
    }

    #[test]
    fn scenes_are_the_unit_of_intervals_and_trials_of_means() {
        let mut trials: Vec<TrialMeasurement> =
            (0..6).map(|at| trial(at, vec![block(2, Some(at as f64 / 10.0), &[])])).collect();
        trials.push(trial(5, vec![block(2, Some(0.7), &[])]));
        trials.push(trial(5, vec![block(2, None, &[])]));
        let report = ExpansionReport::new("nano", "rooms", &trials, Vec::new());
        assert_eq!((report.scenes, report.trials, report.blocks.len()), (6, 8, 1));
        let found = report.blocks[0].correlation.unwrap();
        atsplat_numeric::Tolerance::F64.assert([found.mean], [(1.5 + 0.7) / 7.0], "over the trials that have it");
        let [low, high] = found.interval.unwrap();
        assert!(low < found.mean && found.mean < high && low > 0.0 && high < 0.6, "{found}");
        assert_eq!(report.blocks[0].contrast, None);
        let few = ExpansionReport::new("nano", "rooms", &trials[..5], Vec::new());
        assert_eq!(few.blocks[0].correlation.unwrap().interval, None);
        let text = few.to_string();
        assert!(text.contains("| 2 | 8 | 3 | 0.200 | – | 2.000 | 0.500 |"), "{text}");
        assert!(!text.contains("thresholds") && !text.contains("Not in these means"), "{text}");
    }

    #[test]
    fn what_is_missing_is_named() {
        let gap = ExpansionGap { kind: "scenes without an entry".to_owned(), count: 2, first: "short, …".to_owned() };
        let report = ExpansionReport::new("nano", "rooms", &[trial(0, Vec::new())], vec![gap]);
        let text = report.to_string();
        assert!(
            text.contains("\n\nNot in these means:\n\n- 2 scenes without an entry: short, …\n\n| block |"),
            "{text}"
        );
        let json = serde_json::to_value(&report).unwrap();
        let expected = serde_json::json!([{ "kind": "scenes without an entry", "count": 2, "first": "short, …" }]);
        assert_eq!(json["gaps"], expected);
    }

    #[test]
    fn thresholds_are_of_the_scores_of_all_trials_by_block() {
        let scores = |scale: f64| (0..=10).map(|at| scale * f64::from(at)).collect::<Vec<_>>();
        // Blocks out of order, and each with half of its scores in a trial.
        let blocks = |half: &dyn Fn(&[f64]) -> Vec<f64>| {
            [(4, 1e4), (2, 1e2), (3, 1e3)].map(|(at, scale)| block(at, None, &half(&scores(scale)))).to_vec()
        };
        let trials = [trial(0, blocks(&|all| all[..5].to_vec())), trial(1, blocks(&|all| all[5..].to_vec()))];
        let report = ExpansionReport::new("nano", "rooms", &trials, Vec::new());
        assert_eq!(report.blocks.iter().map(|row| row.block).collect::<Vec<_>>(), [2, 3, 4]);
        let first = &report.thresholds[0];
        assert_eq!((first.published, first.quantiles), ([0.1, 0.1, 0.4], [0.8, 0.8, 0.9]));
        assert_eq!(first.thresholds, [800.0, 8000.0, 90_000.0]);
        assert!(report.to_string().contains("| 0.01 / 0.01 / 0.04 | 0.2 / 0.2 / 0.6 | 200 / 2000 / 60000 |"));
    }
}
