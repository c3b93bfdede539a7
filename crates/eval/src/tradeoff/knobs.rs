use atsplat_model::ModelConfig;
use atsplat_model::config::{BlockExpansion, SelectionRatio};
use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_scene::preprocess::{RescaleAndCrop, Step};
use atsplat_splat::RendererConstants;
use serde::{Deserialize, Serialize};

use crate::EvalError;

/// What is changed of a method and its protocol; what is absent stays as it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Knobs {
    /// K, Gaussians of a token: of trained weights the first K of theirs, at most as many. More need weights of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gaussians_per_token: Option<usize>,
    /// Shares of tokens that are expanded, one for each block that expands; each from 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ratios: Option<Vec<f64>>,
    /// Uncertainties above which tokens are expanded, one for each block that expands; at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thresholds: Option<Vec<f64>>,
    /// Expand in the first so many of the blocks that expand, and in no other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expand_first: Option<usize>,
    /// Context views: so many of those in the index, evenly spaced with both ends; at least 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub views: Option<usize>,
    /// Height and width of pictures, in the place of the last step that scales, or after all others where none does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<[u32; 2]>,
    /// A weights file of its own, as another K has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<std::path::PathBuf>,
    /// The renderer's numbers.
    #[serde(default, skip_serializing_if = "RendererKnobs::is_empty")]
    pub renderer: RendererKnobs,
}

/// What is changed of [`RendererConstants`]: numbers that a picture trades for time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RendererKnobs {
    /// Name of a preset of [`RendererConstants`] to begin with.
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

fn unfit<T>(knob: &'static str, expected: &str, found: impl std::fmt::Debug) -> Result<T, EvalError> {
    Err(EvalError::Settings { what: knob, expected: expected.to_owned(), found: format!("{found:?}") })
}

impl RendererKnobs {
    /// Whether nothing is changed.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The constants with the changes, under a name that says them.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for an unknown preset, and for numbers out of range.
    pub fn applied(&self, constants: &RendererConstants) -> Result<RendererConstants, EvalError> {
        if let Some(name) = self.constants.as_ref().filter(|name| RendererConstants::named(name).is_none()) {
            return unfit("constants", &RendererConstants::PRESETS.join(", "), name);
        }
        let changed = self.applied_unchecked(constants);
        match changed.check() {
            Ok(()) => Ok(changed),
            Err(error) => unfit("renderer", "numbers that can be rendered with", error.to_string()),
        }
    }

    /// As [`Self::applied`], unchecked: a renderer refuses what it cannot render with.
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
        for (knob, value, field) in fields {
            if let Some(value) = value {
                *field = value;
                name = format!("{name}, {knob} {value}");
            }
        }
        changed.name = name;
        changed
    }
}

impl Knobs {
    /// The network's configuration with the changes.
    ///
    /// # Errors
    /// [`EvalError::Settings`] and [`EvalError::Model`] where their number or range does not fit.
    pub fn model(&self, config: &ModelConfig) -> Result<ModelConfig, EvalError> {
        let mut config = config.clone();
        if self.ratios.is_some() && self.thresholds.is_some() {
            return unfit("thresholds", "ratios or thresholds, not both", &self.thresholds);
        }
        if let Some(count) = self.gaussians_per_token {
            config.head.gaussians_per_token = count;
        }
        if let Some(ratios) = &self.ratios {
            let blocks: Vec<_> =
                config.decoder.blocks.iter_mut().filter_map(|block| block.expansion.as_mut()).collect();
            if blocks.len() != ratios.len() {
                return unfit("ratios", &format!("{}, one for each block that expands", blocks.len()), ratios);
            }
            for (block, &value) in blocks.into_iter().zip(ratios) {
                let Some(ratio) = SelectionRatio::new(value) else {
                    return unfit("ratios", "shares from 0 to 1 with at most six decimals", value);
                };
                *block = BlockExpansion::Ratio(ratio);
            }
        }
        if let Some(thresholds) = &self.thresholds {
            config = config.with_thresholds(thresholds)?;
        }
        if let Some(blocks) = self.expand_first {
            config = config.with_expansion_in_first(blocks);
        }
        config.validate()?;
        Ok(config)
    }

    /// The protocol with pictures of the knob's size.
    ///
    /// # Errors
    /// [`EvalError::Settings`] where a side is 0.
    pub fn preset(&self, preset: &Preset) -> Result<Preset, EvalError> {
        let mut preset = preset.clone();
        let Some([height, width]) = self.resolution else { return Ok(preset) };
        if height == 0 || width == 0 {
            return unfit("resolution", "sides of at least a pixel", [height, width]);
        }
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

    /// The index with so many context views, targets as they are.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for no view, or more than an entry has.
    pub fn index(&self, index: &EvaluationIndex) -> Result<EvaluationIndex, EvalError> {
        let mut index = index.clone();
        let Some(views) = self.views else { return Ok(index) };
        for entry in index.scenes.values_mut().flatten() {
            let Some(last) = entry.context.len().checked_sub(1).filter(|last| (1..=last + 1).contains(&views)) else {
                return unfit("views", &format!("from 1 to {}", entry.context.len()), views);
            };
            // Rounded to the nearest, so that both ends stay; a single view is the first.
            let steps = views.saturating_sub(1);
            let place = |view: usize| (2 * view * last + steps).checked_div(2 * steps).unwrap_or(0);
            entry.context = (0..views).filter_map(|view| entry.context.get(place(view)).copied()).collect();
        }
        Ok(index)
    }
}
