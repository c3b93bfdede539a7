use std::str::FromStr;

use atsplat_camera::ImageSize;
use atsplat_files::InvalidText;
use serde::Serialize;

/// Layout of a dataset on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(serde::Deserialize))]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// `<split>/<key>.txt` and `<split>/<key>/<timestamp>.jpg`. Stores no lens.
    Re10k,
    /// `<split>/000000.torch` and `<split>/index.json`, as pixelSplat's loader reads. Stores no lens.
    Chunks,
    /// `<key>/nerfstudio/transforms.json` and `images/`, like DL3DV.
    Nerfstudio,
}

impl Layout {
    /// All layouts.
    pub const ALL: [Self; 3] = [Self::Re10k, Self::Chunks, Self::Nerfstudio];

    /// The name in manifests and on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Re10k => "re10k",
            Self::Chunks => "chunks",
            Self::Nerfstudio => "nerfstudio",
        }
    }

    /// Whether cameras have their lens distortion.
    pub const fn stores_lenses(self) -> bool {
        match self {
            Self::Re10k | Self::Chunks => false,
            Self::Nerfstudio => true,
        }
    }

    /// Image size that the papers' protocols expect.
    pub const fn native_size(self) -> ImageSize {
        match self {
            Self::Re10k | Self::Chunks => ImageSize { width: 640, height: 360 },
            Self::Nerfstudio => ImageSize { width: 480, height: 270 },
        }
    }
}

/// Encoding of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ImageEncoding {
    /// JPEG of this quality, 1 to 100, like RE10K.
    Jpeg(u8),
    /// PNG, lossless, like DL3DV.
    Png,
}

impl ImageEncoding {
    pub(super) const fn extension(self) -> &'static str {
        match self {
            Self::Jpeg(_) => "jpg",
            Self::Png => "png",
        }
    }
}

impl FromStr for ImageEncoding {
    type Err = InvalidText;

    /// `png`, or `jpeg:QUALITY`.
    fn from_str(text: &str) -> Result<Self, InvalidText> {
        let quality = |text: &str| text.parse().ok().filter(|quality| (1..=100).contains(quality));
        let encoding = match text.split_once(':') {
            None if text == "png" => Some(Self::Png),
            Some(("jpeg", text)) => quality(text).map(Self::Jpeg),
            _ => None,
        };
        encoding.ok_or_else(|| InvalidText::new("png, or jpeg:QUALITY from 1 to 100", text))
    }
}

/// Options for writing a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteOptions {
    /// Layout on disk.
    pub layout: Layout,
    /// Encoding of images.
    pub encoding: ImageEncoding,
    /// Whether to write `depth/<key>/<frame>.exr`, the channel `Z`.
    pub depth: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_encodings() {
        assert_eq!(("png".parse(), "jpeg:90".parse()), (Ok(ImageEncoding::Png), Ok(ImageEncoding::Jpeg(90))));
        for broken in ["jpeg", "jpeg:0", "jpeg:101", "webp", "png:1"] {
            assert!(broken.parse::<ImageEncoding>().is_err(), "{broken:?}");
        }
    }
}
