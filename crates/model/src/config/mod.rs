//! Configuration of a network, with a field for every choice that the paper leaves open.
//!
//! A configuration is one TOML file; those of the paper's settings are in `eval/models/` and embedded in the binary. What
//! the paper does not state is a named field, and `inferred` in the file says where its value comes from. Ablations are
//! other values of these fields, never other code.

mod activations;
mod anchors;
mod backbone;
mod decoder;
mod encoder;
mod expansion;
mod head;
mod image_size;
mod transformer;
mod validate;

use std::path::Path;

use atsplat_files::{Embedded, Sha256Digest, is_toml_path, malformed_toml};
use serde::{Deserialize, Serialize};

pub use activations::{DepthActivation, OffsetActivation, OpacityActivation, QuaternionActivation, ScaleActivation};
pub use anchors::{AnchorConfig, AnchorContext, AnchorDesign};
pub use backbone::{BackboneConfig, DinoArchitecture, DinoSize, PositionInterpolation};
pub use decoder::{BlockConfig, DecoderConfig};
pub use encoder::{CoarseConfig, FineConfig, Upsampling};
pub use expansion::{BlockExpansion, ExpansionConfig, RatioRounding, Scoring, Selection, SelectionRatio};
pub use head::{HeadConfig, HeadFrame};
pub use image_size::{Grid, ImageSize};
pub use transformer::{QueryKeyNorm, TransformerConfig};

use crate::ModelError;

macro_rules! texts {
    ($($name:literal),* $(,)?) => {
        Embedded(&[$(($name, include_str!(concat!("../../../../eval/models/", $name, ".toml")))),*])
    };
}

/// The TOML texts of the configurations in `eval/models/`.
const TEXTS: Embedded =
    texts!["paper-re10k", "paper-dl3dv", "paper-dl3dv-224", "paper-dl3dv-hr", "mini", "micro", "nano"];

/// Configuration of a network, with its nominal inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ModelConfig {
    /// Name on the command line and in results: lower-case letters, digits and hyphens.
    pub name: String,
    /// Title, one line.
    pub title: String,
    /// What readers of its numbers must know.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Values that the paper does not state and this configuration infers, each with its source.
    #[serde(default)]
    pub inferred: Vec<String>,
    /// Number of context views for which the paper reports results. Any other number works too.
    pub views: usize,
    /// Height and width in pixels for which the paper reports results; in a weights file, those of the training images.
    /// Any other size that the patches divide works too.
    pub resolution: ImageSize,
    /// All transformer layers except the backbone's.
    pub transformer: TransformerConfig,
    /// Per-view patch features.
    pub backbone: BackboneConfig,
    /// The coarse branch, which predicts anchors.
    pub coarse: CoarseConfig,
    /// Positions of tokens in space, and what a Gaussian's centre is relative to.
    pub anchors: AnchorConfig,
    /// The fine branch, which the decoder attends to.
    pub fine: FineConfig,
    /// The decoder, which refines tokens.
    pub decoder: DecoderConfig,
    /// How the decoder's blocks select and expand tokens.
    pub expansion: ExpansionConfig,
    /// The head, which predicts Gaussians from tokens.
    pub head: HeadConfig,
}

impl ModelConfig {
    /// Whether networks of both configurations with the same weights compute the same before token expansion.
    #[must_use]
    pub fn encodes_like(&self, other: &Self) -> bool {
        *self == Self { decoder: self.decoder.clone(), expansion: self.expansion.clone(), ..other.clone() }
    }

    /// Names of the built-in configurations.
    pub fn names() -> impl Iterator<Item = &'static str> {
        TEXTS.names()
    }

    /// The TOML text of a built-in configuration.
    ///
    /// # Errors
    /// [`ModelError::UnknownModel`].
    pub fn text_of(name: &str) -> Result<&'static str, ModelError> {
        let unknown = || ModelError::UnknownModel { name: name.to_owned(), known: Self::names().collect() };
        TEXTS.text(name).ok_or_else(unknown)
    }

    /// A built-in configuration.
    ///
    /// # Errors
    /// [`ModelError::UnknownModel`].
    pub fn named(name: &str) -> Result<Self, ModelError> {
        Self::from_toml(Self::text_of(name)?)
    }

    /// A built-in configuration by name, or the one in a TOML file by path: a name that ends in `.toml` is a path.
    ///
    /// # Errors
    /// [`ModelError::UnknownModel`], or the errors of [`Self::read`].
    pub fn resolve(name_or_path: &str) -> Result<Self, ModelError> {
        if is_toml_path(name_or_path) { Self::read(Path::new(name_or_path)) } else { Self::named(name_or_path) }
    }

    /// Reads a configuration from a TOML file.
    ///
    /// # Errors
    /// [`ModelError::Io`], or [`ModelError::InFile`] around the errors of [`Self::from_toml`].
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let text =
            atsplat_files::read_to_string(path).map_err(ModelError::io("reading a model configuration", path))?;
        Self::from_toml(&text).map_err(|error| error.in_file(path))
    }

    /// Reads a configuration from TOML text and checks that its parts fit together.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] with line and column if the text is not a configuration, with the field if values
    /// contradict each other.
    pub fn from_toml(text: &str) -> Result<Self, ModelError> {
        let config: Self = toml::from_str(text)
            .map_err(|error| malformed_toml(validate::WHAT, "a model configuration", text, &error))?;
        config.validate()?;
        Ok(config)
    }

    /// The configuration as TOML text that [`Self::from_toml`] reads back.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] for a value that TOML cannot represent, which cannot come from TOML.
    pub fn to_toml(&self) -> Result<String, ModelError> {
        toml::to_string(self)
            .map_err(|error| ModelError::malformed(validate::WHAT, "TOML", "a value that TOML can represent", error))
    }

    /// Checks that the parts fit together, for configurations that were changed in code.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] with the field.
    pub fn validate(&self) -> Result<(), ModelError> {
        validate::check(self)
    }

    /// SHA-256 in hexadecimal of all that changes what the network computes from images of a given size: the fields as compact JSON
    /// in declaration order, without name, title, notes, inferences, nominal views and resolution. The resolution of a weights
    /// file decides to which size images are resized before, and is not covered.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] for a value that JSON cannot represent, such as NaN, which validation rejects.
    pub fn hash(&self) -> Result<String, ModelError> {
        let parts = (
            (&self.transformer, &self.backbone, &self.coarse, &self.anchors),
            (&self.fine, &self.decoder, &self.expansion, &self.head),
        );
        let json = serde_json::to_vec(&parts)
            .map_err(|error| ModelError::malformed(validate::WHAT, "JSON", "a value that JSON can represent", error))?;
        Ok(Sha256Digest::of(&json).to_string())
    }

    /// The coarse branch's patch grid of an image.
    ///
    /// # Errors
    /// [`ModelError::Indivisible`] if patches do not divide the image.
    pub fn coarse_grid(&self, image: ImageSize) -> Result<Grid, ModelError> {
        image.grid(self.coarse.patch_size, self.coarse.image_downscale, "coarse")
    }

    /// The fine branch's patch grid of an image.
    ///
    /// # Errors
    /// [`ModelError::Indivisible`] if patches do not divide the image.
    pub fn fine_grid(&self, image: ImageSize) -> Result<Grid, ModelError> {
        image.grid(self.fine.patch_size, self.fine.image_downscale, "fine")
    }

    /// The size to which images are resized for weights that were trained at another size: at the scale of the trained
    /// size, in whole coarse patches ([`ImageSize::at_scale_of`]).
    #[must_use]
    pub fn context_size(&self, given: ImageSize, trained_at: ImageSize) -> ImageSize {
        given.at_scale_of(trained_at, self.coarse.patch_size.saturating_mul(self.coarse.image_downscale))
    }

    /// Smallest number of pixels of large images: the paper uses its setting for them at 512×960 but not at 256×448.
    pub const LARGE_IMAGE: usize = 400_000;

    /// Whether images of this size have the paper's setting for large images ([`Self::for_high_resolution`]), whose coarse branch
    /// sees them at half size: they are large, and weights trained at `trained_at` see that half as it is.
    pub fn has_high_resolution(&self, size: ImageSize, trained_at: ImageSize) -> bool {
        let half = ImageSize::new(size.height / 2, size.width / 2);
        let is_large = size.height.saturating_mul(size.width) >= Self::LARGE_IMAGE;
        is_large && self.context_size(half, trained_at) == half
    }

    /// The same network, expanding every token whose uncertainty exceeds its block's threshold (paper, supplement, "Dynamic
    /// Gaussian Budgets"): one threshold for each expanding block, in order.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if their number differs.
    pub fn with_thresholds(&self, thresholds: &[f64]) -> Result<Self, ModelError> {
        self.with_expansions("thresholds", thresholds.iter().copied().map(BlockExpansion::Threshold))
    }

    /// The same network, expanding the given shares of the tokens: one ratio for each expanding block, in order.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if their number differs.
    pub fn with_ratios(&self, ratios: &[SelectionRatio]) -> Result<Self, ModelError> {
        self.with_expansions("ratios", ratios.iter().copied().map(BlockExpansion::Ratio))
    }

    /// The same network in the paper's setting for large images ("High-Resolution Novel-View Synthesis"): the coarse branch takes
    /// them at half their size, so that images of twice the resolution have as many patches, and the first expanding block
    /// expands four fifths if it expands a ratio. Weights stay the same, whereas the paper fine-tunes its own in this setting. `None` if
    /// the coarse branch takes images at less than half their size already, so that large images need no other setting.
    ///
    /// # Errors
    /// [`ModelError::HighResolution`] if sides of twice the resolution are too long, or the configuration was not valid before;
    /// [`ModelError::Indivisible`] if its patches do not divide its resolution.
    pub fn for_high_resolution(&self) -> Result<Option<Self>, ModelError> {
        if self.coarse.image_downscale > 2 {
            return Ok(None);
        }
        let Grid { rows, columns } = self.coarse_grid(self.resolution)?;
        let mut config = self.clone();
        config.coarse.image_downscale = 2;
        let step = 2 * config.coarse.patch_size;
        config.resolution = ImageSize::new(rows * step, columns * step);
        let expansions = config.decoder.blocks.iter_mut().filter_map(|block| block.expansion.as_mut());
        for expansion in expansions.take(1) {
            if let BlockExpansion::Ratio(ratio) = expansion {
                *ratio = SelectionRatio::FOUR_FIFTHS;
            }
        }
        config.validate().map_err(|error| ModelError::HighResolution(Box::new(error)))?;
        Ok(Some(config))
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

    /// Number of blocks of the decoder that have an expansion.
    pub fn expanding_blocks(&self) -> usize {
        self.decoder.blocks.iter().filter(|block| block.expansion.is_some()).count()
    }

    /// The same network with expansion only in the first `blocks` of the expanding blocks (paper, supplement, "Expansion at
    /// each decoder block"). Weights of the others are kept but not used.
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
