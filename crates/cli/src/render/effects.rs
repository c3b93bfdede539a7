use std::fmt;

use atsplat_numeric::Extremes as _;
use atsplat_splat::effects::{Decision, EffectPlan, EffectSelection, Verdict};
use atsplat_splat::{Gaussians, RenderOptions, Renderer, Rendering, SplatError};
use serde::Serialize;

use super::frames::Frame;
use super::views::Shot;
use crate::parse;

/// Which effects run.
#[derive(Debug, clap::Args)]
pub(crate) struct EffectArgs {
    /// Which of the requested effects run: auto (only those that can change an image by more than --tolerance), all, none,
    /// or a list of names; --explain lists the names.
    #[arg(long, value_name = "LIST", default_value = "auto")]
    pub(super) effects: EffectSelection,

    /// Largest change of any colour sample that `auto` may cause, in units of display range; opacity, depth and scalar
    /// never change.
    #[arg(long, value_name = "CHANGE", default_value_t = EffectPlan::TOLERANCE, value_parser = parse::not_negative)]
    tolerance: f64,

    /// Print the cost of each effect and why it runs or not, measured on the first frame.
    #[arg(long)]
    pub(crate) explain: bool,
}

/// Render options, and which effects may be skipped.
#[derive(Debug)]
pub(crate) struct Look {
    pub(crate) options: RenderOptions,
    effects: EffectSelection,
    tolerance: f64,
}

/// Effects over all frames, as recorded in `render.json`.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct EffectRecord {
    selection: String,
    tolerance: f64,
    effects: Vec<Row>,
}

/// Number of frames per verdict of one effect.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    effect: &'static str,
    runs: usize,
    reduced: usize,
    left_out: usize,
    not_asked: usize,
    /// Over the frames in which it was reduced or skipped; `None` if it is unproved for one of them.
    largest_bound: Option<f64>,
}

impl EffectArgs {
    pub(crate) fn look(&self, options: RenderOptions) -> Look {
        Look { options, effects: self.effects.clone(), tolerance: self.tolerance }
    }
}

impl Look {
    /// Plans the effects of a view.
    pub(crate) fn plan(&self, gaussians: &Gaussians, shot: &Shot) -> Result<EffectPlan, SplatError> {
        let options = shot.exposed(&self.options);
        EffectPlan::for_scene(gaussians, &shot.view, &options, &self.effects, self.tolerance)
    }

    /// Plans and renders a view.
    pub(crate) fn render(
        &self,
        renderer: &mut dyn Renderer,
        gaussians: &Gaussians,
        shot: &Shot,
    ) -> Result<(Rendering<f32>, EffectPlan), SplatError> {
        let plan = self.plan(gaussians, shot)?;
        Ok((plan.render(renderer, gaussians)?, plan))
    }

    /// Summarises the effects of all frames.
    pub(crate) fn record(&self, frames: &[Frame]) -> EffectRecord {
        let names = frames.iter().map(|frame| &frame.decisions).find(|decisions| !decisions.is_empty());
        let row = |(at, first): (usize, &Decision)| {
            Row::of(first.effect, frames.iter().filter_map(|frame| frame.decisions.get(at)))
        };
        let effects = names.into_iter().flatten().enumerate().map(row).collect();
        EffectRecord { selection: self.effects.to_string(), tolerance: self.tolerance, effects }
    }
}

impl Row {
    fn of<'a>(effect: &'static str, decisions: impl Iterator<Item = &'a Decision>) -> Self {
        let mut row = Self { effect, runs: 0, reduced: 0, left_out: 0, not_asked: 0, largest_bound: Some(0.0) };
        for Decision { verdict, bound, .. } in decisions {
            match verdict {
                Verdict::Runs => row.runs += 1,
                Verdict::Reduced => row.reduced += 1,
                Verdict::LeftOut => row.left_out += 1,
                Verdict::NotAsked => row.not_asked += 1,
            }
            if matches!(verdict, Verdict::Reduced | Verdict::LeftOut) {
                row.largest_bound = row.largest_bound.zip(*bound).map(|(largest, bound)| largest.maximum_of(bound));
            }
        }
        row
    }
}

/// Lists skipped effects, if any.
impl fmt::Display for EffectRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Row { effect, reduced, left_out, largest_bound, .. } in &self.effects {
            if reduced + left_out == 0 {
                continue;
            }
            let is_plane = matches!(*effect, "depth" | "scalar" | "median-depth");
            let bound = match largest_bound {
                Some(0.0) => "changes nothing".to_owned(),
                Some(bound) => format!("changes no sample by more than {bound:.1e}"),
                None if is_plane => "its image is not written".to_owned(),
                None => "with no bound on what that changes".to_owned(),
            };
            let frames = |count: usize| if count == 1 { "1 frame".to_owned() } else { format!("{count} frames") };
            write!(f, "{effect}: ")?;
            match (reduced, left_out) {
                (0, _) => write!(f, "left out in {}", frames(*left_out))?,
                (_, 0) => write!(f, "reduced in {}", frames(*reduced))?,
                _ => write!(f, "left out in {left_out} and reduced in {}", frames(*reduced))?,
            }
            writeln!(f, ", {bound}")?;
        }
        Ok(())
    }
}
