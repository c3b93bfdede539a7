use atsplat_eval::rendering::RenderSettings;
use atsplat_splat::RenderOptions;
use atsplat_splat::effects::{EffectPlan, EffectSelection};

use crate::parse;
use crate::requirements::{Requirement, check_all};

/// Which effects run.
#[derive(Debug, clap::Args)]
pub(crate) struct EffectArgs {
    /// Which of the requested effects run: auto (only those that can change an image by more than --tolerance), all, none,
    /// or a list of names; --explain lists the names.
    #[arg(long, value_name = "LIST", default_value = "auto")]
    pub(super) effects: EffectSelection,

    /// Largest change of any colour sample that `auto` may cause, in units of display range, by default a quarter of a
    /// grey level of 8 bits; alpha, depth and scalar never change.
    #[arg(long, value_name = "CHANGE", value_parser = parse::not_negative)]
    tolerance: Option<f64>,

    /// Print for each effect the share of pixels that need it, its bound, the time it takes and saves, and why it runs or not,
    /// measured on the first frame.
    #[arg(long)]
    pub(crate) explain: bool,
}

impl EffectArgs {
    pub(crate) fn settings(&self, options: RenderOptions) -> RenderSettings {
        RenderSettings {
            options,
            effects: self.effects.clone(),
            tolerance: self.tolerance.unwrap_or(EffectPlan::TOLERANCE),
        }
    }

    /// Rejects a tolerance that nothing reads.
    pub(super) fn check(&self) -> Result<(), String> {
        check_all(&[Requirement {
            options: &[("--tolerance", self.tolerance.is_some())],
            requires: &format!("--effects auto or --explain (found --effects {})", self.effects),
            satisfied: self.effects == EffectSelection::Auto || self.explain,
        }])
    }
}
