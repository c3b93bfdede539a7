use atsplat_fit::{Budget, Strategy};
use atsplat_model::ModelConfig;
use atsplat_model::config::{BlockExpansion, SelectionRatio};
use atsplat_model::network::{MatmulPrecision, Network};
use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_scene::preprocess::{RescaleAndCrop, Step};
use atsplat_splat::RendererConstants;
use serde::{Deserialize, Serialize};

use crate::EvalError;

/// Overrides of a method and its protocol; absent fields leave the setting unchanged.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Overrides {
    /// K, the number of Gaussians per token: the first K of each token, as the whole network makes them; a larger K needs other
    /// weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gaussians_per_token: Option<usize>,
    /// Ratios of expanded tokens, in [0, 1], one for each block that expands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ratios: Option<Vec<f64>>,
    /// Uncertainty thresholds above which tokens are expanded, at least 0, one for each block that expands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thresholds: Option<Vec<f64>>,
    /// Expand only in this many of the blocks that expand, the first ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expand_first: Option<usize>,
    /// Number of context views: evenly spaced among those of the index, including both ends; at least 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub views: Option<usize>,
    /// Height and width of images; replaces the last scaling step of the preprocessing or is appended to it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<[u32; 2]>,
    /// A separate weights file, as needed for a larger K.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<std::path::PathBuf>,
    /// Largest change of a sample, in units of display range, below which renderer effects are left out: at least 0; a
    /// quarter of a grey level by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<f64>,
    /// Precision of the network's matrix products: `f32`, `bf16` on the CPU, or `f16` on a graphics adapter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matmul_precision: Option<MatmulPrecision>,
    /// Optimise each trial's Gaussians on its context views for this many steps: the network's, or random ones with
    /// `strategy`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<u64>,
    /// Like `steps`, but for about this many seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Optimise random points with this strategy instead of refining the network's Gaussians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strategy: Option<Strategy>,
    /// Overrides of the renderer's constants.
    #[serde(default, skip_serializing_if = "ConstantChanges::is_empty")]
    pub renderer: ConstantChanges,
}

/// Changes of [`RendererConstants`] that trade quality for time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ConstantChanges {
    /// Name of the preset of [`RendererConstants`] to start from; its near and far planes are in the unit of the Gaussians as they
    /// are given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub constants: Option<String>,
    /// [`RendererConstants::min_alpha`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_alpha: Option<f64>,
    /// [`RendererConstants::max_alpha`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_alpha: Option<f64>,
    /// [`RendererConstants::min_transmittance`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_transmittance: Option<f64>,
    /// [`RendererConstants::blur`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blur: Option<f64>,
}

fn invalid<T>(field: &'static str, expected: &str, found: impl std::fmt::Display) -> Result<T, EvalError> {
    Err(EvalError::Settings { what: field, expected: expected.to_owned(), found: found.to_string() })
}

/// `0.5, 1.5`.
fn list(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

impl ConstantChanges {
    /// Whether nothing changes.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Whether the constants to start from are those of a preset by name, with its near and far planes.
    pub(crate) const fn names_constants(&self) -> bool {
        self.constants.is_some()
    }

    /// The constants with the overrides, which are listed in their name.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for an unknown preset, and for numbers out of range.
    pub fn applied(&self, constants: &RendererConstants) -> Result<RendererConstants, EvalError> {
        if let Some(name) = self.constants.as_ref().filter(|name| RendererConstants::named(name).is_none()) {
            return invalid("constants", &RendererConstants::listed_presets(), name);
        }
        let changed = self.applied_unchecked(constants);
        match changed.check() {
            Ok(()) => Ok(changed),
            Err(error) => invalid("renderer", "valid renderer constants", error.to_string()),
        }
    }

    /// Like [`Self::applied`] without checks: a renderer rejects invalid constants.
    pub(crate) fn applied_unchecked(&self, constants: &RendererConstants) -> RendererConstants {
        let named = self.constants.as_deref().and_then(RendererConstants::named);
        let mut changed = named.unwrap_or_else(|| constants.clone());
        let mut name = changed.name.clone();
        let fields = [
            ("min-alpha", self.min_alpha, &mut changed.min_alpha),
            ("max-alpha", self.max_alpha, &mut changed.max_alpha),
            ("min-transmittance", self.min_transmittance, &mut changed.min_transmittance),
            ("blur", self.blur, &mut changed.blur),
        ];
        for (key, value, field) in fields {
            if let Some(value) = value {
                *field = value;
                name = format!("{name}, {key} {value}");
            }
        }
        changed.name = name;
        changed
    }
}

impl Overrides {
    /// Whether a setting with these overrides runs a network: with a strategy, random points are optimised instead.
    pub const fn runs_network(&self) -> bool {
        self.strategy.is_none()
    }

    /// The network's configuration with the overrides.
    ///
    /// # Errors
    /// [`EvalError::Settings`] and [`EvalError::Model`] for a wrong number of values or values out of range.
    pub fn model(&self, config: &ModelConfig) -> Result<ModelConfig, EvalError> {
        self.check()?;
        let mut config = config.clone();
        if let Some(count) = self.gaussians_per_token {
            config.head = config.head.keeping_first(count);
        }
        if let Some(ratios) = &self.ratios {
            let blocks: Vec<_> =
                config.decoder.blocks.iter_mut().filter_map(|block| block.expansion.as_mut()).collect();
            if blocks.len() != ratios.len() {
                return invalid("ratios", &format!("{}, one for each block that expands", blocks.len()), list(ratios));
            }
            for (block, &value) in blocks.into_iter().zip(ratios) {
                let Some(ratio) = SelectionRatio::new(value) else {
                    return invalid("ratios", "ratios from 0 to 1 with at most six decimals", value);
                };
                *block = BlockExpansion::Ratio(ratio);
            }
        }
        if let Some(thresholds) = &self.thresholds {
            config = config.with_thresholds(thresholds)?;
        }
        if let Some(blocks) = self.expand_first {
            let all = config.expanding_blocks();
            if blocks > all {
                return invalid("expand-first", &format!("at most {all}, the network's expanding blocks"), blocks);
            }
            config = config.with_expansion_in_first(blocks);
        }
        config.validate()?;
        Ok(config)
    }

    /// Whether every override has a value that some network and protocol can have.
    ///
    /// # Errors
    /// [`EvalError::Settings`] with the override.
    pub fn check(&self) -> Result<(), EvalError> {
        if self.gaussians_per_token == Some(0) {
            return invalid("gaussians-per-token", "at least 1", 0);
        }
        if self.views == Some(0) {
            return invalid("views", "at least 1", 0);
        }
        if let Some([height, width]) = self.resolution.filter(|sides| sides.contains(&0)) {
            return invalid("resolution", "sides of at least one pixel", format!("{height}×{width}"));
        }
        if self.ratios.is_some() && self.thresholds.is_some() {
            return invalid("thresholds", "ratios or thresholds, not both", "both");
        }
        let ratio = |value: &&f64| SelectionRatio::new(**value).is_none();
        if let Some(value) = self.ratios.iter().flatten().find(ratio) {
            return invalid("ratios", "ratios from 0 to 1 with at most six decimals", value);
        }
        let threshold = |value: &&f64| !(**value >= 0.0 && value.is_finite());
        if let Some(value) = self.thresholds.iter().flatten().find(threshold) {
            return invalid("thresholds", "numbers of at least 0", value);
        }
        self.effects_tolerance()?;
        self.budget()?;
        self.renderer.applied(&RendererConstants::default()).map(|_| ())
    }

    /// The tolerance of renderer effects, if set.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for a negative or infinite one.
    pub fn effects_tolerance(&self) -> Result<Option<f64>, EvalError> {
        match self.tolerance {
            Some(tolerance) if !(tolerance >= 0.0 && tolerance.is_finite()) => {
                invalid("tolerance", "a finite number of at least 0", tolerance)
            }
            tolerance => Ok(tolerance),
        }
    }

    /// The precision of the network's matrix products; f32 by default.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for another precision than f32 with an optimisation, where it would change more than the
    /// network, and for one in which the network's device would compute as with f32.
    pub(crate) fn matmul_precision(&self, network: &Network) -> Result<MatmulPrecision, EvalError> {
        let precision = self.matmul_precision.unwrap_or_default();
        let optimised = self.steps.is_some() || self.seconds.is_some();
        if precision != MatmulPrecision::F32 && optimised {
            return invalid("matmul-precision", "f32 with steps or seconds", precision.name());
        }
        if !network.supports_precision(precision) {
            let expected = "f32, or bf16 on the CPU, or f16 on a graphics adapter whose shaders have 16-bit floats";
            return invalid("matmul-precision", expected, precision.name());
        }
        Ok(precision)
    }

    /// How long each trial is optimised, if it is.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for both steps and seconds, for numbers that are not positive, for a strategy without either,
    /// for one that cannot start from random points, and for one with a setting of the network, which then does not run.
    pub fn budget(&self) -> Result<Option<Budget>, EvalError> {
        if self.strategy == Some(Strategy::Fixed) {
            return invalid("strategy", "3dgs, mip-splatting or mcmc; without it, the network is refined", "fixed");
        }
        let of_network = [
            ("gaussians-per-token", self.gaussians_per_token.is_some()),
            ("ratios", self.ratios.is_some()),
            ("thresholds", self.thresholds.is_some()),
            ("expand-first", self.expand_first.is_some()),
            ("weights", self.weights.is_some()),
            ("matmul-precision", self.matmul_precision.is_some()),
        ];
        if let (Some(strategy), Some((field, _))) = (self.strategy, of_network.into_iter().find(|(_, is_set)| *is_set))
        {
            let found = format!("both {field} and {}", strategy.name());
            return invalid(
                "strategy",
                "no network setting: with `strategy`, random points are optimised and no network runs",
                found,
            );
        }
        match (self.steps, self.seconds) {
            (Some(0), None) => invalid("steps", "at least 1", 0),
            (Some(steps), None) => Ok(Some(Budget::Steps(steps))),
            (None, Some(seconds)) if seconds.is_finite() && seconds > 0.0 => Ok(Some(Budget::Seconds(seconds))),
            (None, Some(seconds)) => invalid("seconds", "a positive number", seconds),
            (Some(_), Some(seconds)) => invalid("seconds", "steps or seconds, not both", seconds),
            (None, None) if self.strategy.is_some() => invalid("strategy", "steps or seconds with it", "neither"),
            (None, None) => Ok(None),
        }
    }

    /// The protocol at this resolution.
    ///
    /// # Errors
    /// [`EvalError::Settings`] if a side is 0.
    pub fn preset(&self, preset: &Preset) -> Result<Preset, EvalError> {
        self.check()?;
        let mut preset = preset.clone();
        let Some([height, width]) = self.resolution else { return Ok(preset) };
        let sizes = preset.preprocessing.steps.iter_mut().rev().find_map(|step| match step {
            Step::RescaleAndCrop(step) => Some((&mut step.height, &mut step.width)),
            Step::Resize(step) => Some((&mut step.height, &mut step.width)),
            _ => None,
        });
        match sizes {
            Some((rows, columns)) => (*rows, *columns) = (height, width),
            None => preset.preprocessing.steps.push(Step::RescaleAndCrop(RescaleAndCrop::new(height, width))),
        }
        preset.name = format!("{}-{height}x{width}", preset.name);
        Ok(preset)
    }

    /// The index with fewer context views and unchanged targets. Entries whose context views change lose their overlap, which is
    /// that of all views. `dataset` is its name in errors.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for zero views or more than an entry has.
    pub fn index(&self, index: &EvaluationIndex, dataset: &str) -> Result<EvaluationIndex, EvalError> {
        let mut index = index.clone();
        let Some(views) = self.views else { return Ok(index) };
        for (scene, entries) in &mut index.scenes {
            for entry in entries {
                let most = entry.context.len();
                let Some(last) = most.checked_sub(1).filter(|last| (1..=last + 1).contains(&views)) else {
                    let found = format!("{views} (scene {scene} of {dataset})");
                    return invalid("views", &format!("from 1 to {most}"), found);
                };
                // Rounded to the nearest, so that both ends are included; a single view is the first one.
                let steps = views.saturating_sub(1);
                let position = |view: usize| if steps == 0 { 0 } else { (2 * view * last + steps) / (2 * steps) };
                let context: Vec<_> =
                    (0..views).filter_map(|view| entry.context.get(position(view)).copied()).collect();
                if context != entry.context {
                    (entry.context, entry.overlap) = (context, None);
                }
            }
        }
        Ok(index)
    }
}
