use std::fmt;

use atsplat_numeric::Extremes as _;
use serde::Serialize;

use super::{Decision, EffectOutcome, EffectSelection, image_of};

/// What became of each effect over the frames of a render. [`Display`](fmt::Display) lists the effects that were not run in full.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct EffectSummary {
    selection: String,
    tolerance: f64,
    effects: Vec<Row>,
}

/// Number of frames per outcome of one effect.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    effect: &'static str,
    runs: usize,
    reduced: usize,
    skipped: usize,
    not_requested: usize,
    /// Over the frames in which it was reduced or skipped; `None` if it is unproved for one of them.
    largest_bound: Option<f64>,
}

impl EffectSummary {
    /// Summarises the decisions of each frame; frames that were not rendered have none.
    pub fn new<'a>(
        selection: &EffectSelection,
        tolerance: f64,
        frames: &(impl Iterator<Item = &'a [Decision]> + Clone),
    ) -> Self {
        let names = frames.clone().find(|decisions| !decisions.is_empty());
        let row = |(at, first): (usize, &Decision)| {
            Row::of(first.effect, frames.clone().filter_map(|decisions| decisions.get(at)))
        };
        let effects = names.into_iter().flatten().enumerate().map(row).collect();
        Self { selection: selection.to_string(), tolerance, effects }
    }
}

impl Row {
    fn of<'a>(effect: &'static str, decisions: impl Iterator<Item = &'a Decision>) -> Self {
        let mut row = Self { effect, runs: 0, reduced: 0, skipped: 0, not_requested: 0, largest_bound: Some(0.0) };
        for Decision { outcome, bound, .. } in decisions {
            match outcome {
                EffectOutcome::Runs => row.runs += 1,
                EffectOutcome::Reduced => row.reduced += 1,
                EffectOutcome::Skipped => row.skipped += 1,
                EffectOutcome::NotRequested => row.not_requested += 1,
            }
            if matches!(outcome, EffectOutcome::Reduced | EffectOutcome::Skipped) {
                row.largest_bound = row.largest_bound.zip(*bound).map(|(largest, bound)| largest.maximum_of(bound));
            }
        }
        row
    }
}

impl fmt::Display for EffectSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Row { effect, reduced, skipped, largest_bound, .. } in &self.effects {
            if reduced + skipped == 0 {
                continue;
            }
            let bound = match largest_bound {
                Some(0.0) => "changes nothing".to_owned(),
                Some(bound) => format!("changes no sample by more than {bound:.1e}"),
                None if image_of(effect).is_some() => "its image is not written".to_owned(),
                None => "the change is not bounded".to_owned(),
            };
            let frames = |count: usize| if count == 1 { "1 frame".to_owned() } else { format!("{count} frames") };
            write!(f, "{effect}: ")?;
            match (reduced, skipped) {
                (0, _) => write!(f, "skipped in {}", frames(*skipped))?,
                (_, 0) => write!(f, "reduced in {}", frames(*reduced))?,
                _ => write!(f, "skipped in {skipped} and reduced in {}", frames(*reduced))?,
            }
            writeln!(f, ", {bound}")?;
        }
        Ok(())
    }
}
