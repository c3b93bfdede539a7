//! Configuration: which network, down to every choice that the paper leaves open.
//!
//! A configuration is one TOML file; those of the paper's settings are in `eval/models/` and travel inside
//! the binary. What the paper does not state is a named field here, and `inferred` in the file says where
//! its value comes from. Ablations are other values of these fields, never other code.

mod activations;
mod anchors;
mod backbone;
mod builtin;
mod decoder;
mod encoder;
mod expansion;
mod head;
mod image_size;
mod text;
mod transformer;
mod validate;

use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

pub use activations::{DepthActivation, OffsetActivation, OpacityActivation, QuaternionActivation, ScaleActivation};
pub use anchors::{AnchorConfig, AnchorContext, AnchorDesign};
pub use backbone::{BackboneConfig, DinoArchitecture, DinoSize, PositionInterpolation};
pub use decoder::{BlockConfig, DecoderConfig};
pub use encoder::{CoarseConfig, FineConfig, Upsampling};
pub use expansion::{BlockExpansion, ExpansionConfig, RatioRounding, Selection, SelectionRatio};
pub use head::{HeadConfig, HeadFrame};
pub use image_size::{Grid, ImageSize};
pub use transformer::{QueryKeyNorm, TransformerConfig};

use crate::ModelError;

/// A network and the inputs it was made for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ModelConfig {
    /// Name on the command line and in results: lower-case letters, digits and hyphens.
    pub name: String,
    /// One line for people.
    pub title: String,
    /// What a reader of its numbers must know.
    #[serde(default)]
    pub notes: Vec<String>,
    /// What the paper does not state and this configuration therefore infers, each with its source.
    #[serde(default)]
    pub inferred: Vec<String>,
    /// Context views that the paper's numbers are for. Any other number runs too.
    pub views: usize,
    /// Height and width in pixels that the paper's numbers are for; in a weights file, what the weights were trained at. Any
    /// other that the patches divide runs too.
    pub resolution: ImageSize,
    /// Width and make of every transformer layer but the backbone's.
    pub transformer: TransformerConfig,
    /// What turns a picture into patch features before any geometry is known.
    pub backbone: BackboneConfig,
    /// The branch that finds anchors.
    pub coarse: CoarseConfig,
    /// Where tokens are in space, and what a Gaussian's centre is relative to.
    pub anchors: AnchorConfig,
    /// The branch that anchors look at.
    pub fine: FineConfig,
    /// What refines anchor tokens.
    pub decoder: DecoderConfig,
    /// How the decoder's blocks choose and expand tokens.
    pub expansion: ExpansionConfig,
    /// What makes Gaussians of tokens.
    pub head: HeadConfig,
}

impl ModelConfig {
    /// Names of the built-in configurations.
    pub fn names() -> impl Iterator<Item = &'static str> {
        builtin::TEXTS.iter().map(|(name, _)| *name)
    }

    /// The TOML text of a built-in configuration.
    ///
    /// # Errors
    /// [`ModelError::UnknownModel`].
    pub fn text_of(name: &str) -> Result<&'static str, ModelError> {
        let found = builtin::TEXTS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text);
        found.ok_or_else(|| ModelError::UnknownModel { name: name.to_owned(), known: Self::names().collect() })
    }

    /// A built-in configuration.
    ///
    /// # Errors
    /// [`ModelError::UnknownModel`].
    pub fn named(name: &str) -> Result<Self, ModelError> {
        Self::from_toml(Self::text_of(name)?)
    }

    /// A built-in configuration by name, or the one in a TOML file by path: whatever ends in `.toml` is a path.
    ///
    /// # Errors
    /// [`ModelError::UnknownModel`], or the errors of [`Self::read`].
    pub fn resolve(name_or_path: &str) -> Result<Self, ModelError> {
        let path = Path::new(name_or_path);
        if path.extension().is_some_and(|extension| extension == "toml") {
            Self::read(path)
        } else {
            Self::named(name_or_path)
        }
    }

    /// Reads a configuration from a TOML file.
    ///
    /// # Errors
    /// [`ModelError::Io`], or [`ModelError::InFile`] around the errors of [`Self::from_toml`].
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let text = std::fs::read_to_string(path).map_err(ModelError::io("reading a model configuration", path))?;
        Self::from_toml(&text).map_err(|error| error.in_file(path))
    }

    /// Reads a configuration from TOML text and checks that its parts fit together.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] with line and column for text that is no configuration, with the field for
    /// values that contradict each other.
    pub fn from_toml(text: &str) -> Result<Self, ModelError> {
        let config: Self = toml::from_str(text).map_err(|error| text::malformed(text, &error))?;
        config.validate()?;
        Ok(config)
    }

    /// The configuration as TOML text that [`Self::from_toml`] reads back.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] for a value that TOML cannot hold; none that was read from TOML is one.
    pub fn to_toml(&self) -> Result<String, ModelError> {
        toml::to_string(self)
            .map_err(|error| ModelError::malformed(validate::WHAT, "TOML", "a value that TOML can hold", error))
    }

    /// Whether the parts fit together; for configurations that code has changed.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] with the field.
    pub fn validate(&self) -> Result<(), ModelError> {
        validate::check(self)
    }

    /// sha256, in hexadecimal, of all that can change a Gaussian: the fields as compact JSON in declaration
    /// order, without name, title, notes, inferences, nominal views and resolution.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] for a value that JSON cannot hold; none that was read from TOML is one.
    pub fn hash(&self) -> Result<String, ModelError> {
        let parts = (
            (&self.transformer, &self.backbone, &self.coarse, &self.anchors),
            (&self.fine, &self.decoder, &self.expansion, &self.head),
        );
        let json = serde_json::to_vec(&parts)
            .map_err(|error| ModelError::malformed(validate::WHAT, "JSON", "a value that JSON can hold", error))?;
        Ok(atsplat_files::hexadecimal(&Sha256::digest(&json)))
    }

    /// Patches of the coarse branch in a picture.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where patches do not divide the picture.
    pub fn coarse_grid(&self, picture: ImageSize) -> Result<Grid, ModelError> {
        picture.grid(self.coarse.patch_size, self.coarse.image_downscale, "coarse")
    }

    /// Patches of the fine branch in a picture.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where patches do not divide the picture.
    pub fn fine_grid(&self, picture: ImageSize) -> Result<Grid, ModelError> {
        picture.grid(self.fine.patch_size, self.fine.image_downscale, "fine")
    }

    /// The size at which a network with weights that were trained at one size sees pictures of another: at the scale of the
    /// trained one, in whole coarse patches ([`ImageSize::at_scale_of`]).
    #[must_use]
    pub fn context_size(&self, given: ImageSize, trained_at: ImageSize) -> ImageSize {
        given.at_scale_of(trained_at, self.coarse.patch_size.saturating_mul(self.coarse.image_downscale))
    }

    /// Fine patches along a coarse patch: 2, and 4 at high resolution.
    pub const fn fine_to_coarse_ratio(&self) -> usize {
        let coarse = self.coarse.patch_size.saturating_mul(self.coarse.image_downscale);
        let fine = self.fine.patch_size.saturating_mul(self.fine.image_downscale);
        match coarse.checked_div(fine) {
            Some(ratio) => ratio,
            None => 0,
        }
    }

    /// The same network that expands every token whose uncertainty exceeds its block's threshold (paper,
    /// supplement, "Dynamic Gaussian Budgets"): one threshold for each block that expands, in order.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where their number differs.
    pub fn with_thresholds(&self, thresholds: &[f64]) -> Result<Self, ModelError> {
        self.with_expansions("thresholds", thresholds.iter().copied().map(BlockExpansion::Threshold))
    }

    /// The same network that expands these shares of the tokens: one ratio for each block that expands, in order.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where their number differs.
    pub fn with_ratios(&self, ratios: &[SelectionRatio]) -> Result<Self, ModelError> {
        self.with_expansions("ratios", ratios.iter().copied().map(BlockExpansion::Ratio))
    }

    /// The same network as the paper runs it on large pictures (supplement, "High-Resolution"): the coarse branch sees them at
    /// half their size, and the first block that expands a share of the tokens expands four fifths. Weights stay the same.
    ///
    /// # Errors
    /// [`ModelError::Malformed`], for no configuration that was valid before.
    pub fn for_high_resolution(&self) -> Result<Self, ModelError> {
        let mut config = self.clone();
        config.coarse.image_downscale = 2;
        let expansions = config.decoder.blocks.iter_mut().filter_map(|block| block.expansion.as_mut());
        for expansion in expansions.take(1) {
            if let BlockExpansion::Ratio(ratio) = expansion {
                *ratio = SelectionRatio::FOUR_FIFTHS;
            }
        }
        config.validate()?;
        Ok(config)
    }

    fn with_expansions(
        &self,
        what: &str,
        expansions: impl ExactSizeIterator<Item = BlockExpansion>,
    ) -> Result<Self, ModelError> {
        let mut config = self.clone();
        let expanding: Vec<_> = config.decoder.blocks.iter_mut().filter_map(|block| block.expansion.as_mut()).collect();
        if expanding.len() != expansions.len() {
            let expected = format!("{} {what}, one for each block that expands", expanding.len());
            return Err(ModelError::malformed(validate::WHAT, "decoder.blocks", expected, expansions.len()));
        }
        for (block, expansion) in expanding.into_iter().zip(expansions) {
            *block = expansion;
        }
        config.validate()?;
        Ok(config)
    }

    /// The same network in which only the first `blocks` of the expanding blocks still expand (paper,
    /// supplement, "Expansion at each decoder block"). Weights of the others are kept but not used.
    #[must_use]
    pub fn with_expansion_in_first(&self, blocks: usize) -> Self {
        let mut config = self.clone();
        for block in config.decoder.blocks.iter_mut().filter(|block| block.expansion.is_some()).skip(blocks) {
            block.expand = false;
        }
        config
    }
}

#[cfg(test)]
mod tests;
