use burn::module::Module;

use super::expansion::Expansion;
use super::layers::{DecoderLayer, Maker};
use crate::config::ModelConfig;

/// The image-to-3D decoder.
#[derive(Module, Debug)]
pub(super) struct Decoder {
    pub(super) blocks: Vec<DecoderBlock>,
}

/// Expansion, then layers.
#[derive(Module, Debug)]
pub(super) struct DecoderBlock {
    pub(super) expansion: Option<Expansion>,
    pub(super) layers: Vec<DecoderLayer>,
}

impl Decoder {
    pub(super) fn new(config: &ModelConfig, make: Maker<'_>) -> Self {
        let block = |block: &crate::config::BlockConfig| DecoderBlock {
            expansion: block.expansion.map(|_| Expansion::new(config, make)),
            layers: (0..block.layers).map(|_| make.decoder_layer()).collect(),
        };
        Self { blocks: config.decoder.blocks.iter().map(block).collect() }
    }
}
