use atsplat_pixels::Rounding;
use serde::Serialize;

use crate::learned::LpipsNetwork;
use crate::{Ssim, Values};

/// A metric: its names, direction, unit and exact convention.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Definition {
    /// Name in files and on command lines; its meaning never changes.
    pub id: &'static str,
    /// Name in tables.
    pub name: &'static str,
    /// Which way is better.
    pub direction: Direction,
    /// Unit in texts; empty if dimensionless.
    pub unit: &'static str,
    /// How large its scores and their differences are.
    #[serde(skip)]
    pub scale: Scale,
    /// What is computed.
    pub measure: Measure,
    /// Description of the convention, and who uses it.
    pub convention: &'static str,
    /// Link to its definition.
    pub link: &'static str,
}

/// Which way is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// More is better.
    Higher,
    /// Less is better.
    Lower,
}

/// How large a metric's scores are, and so which of their differences matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Tens of decibels.
    Decibels,
    /// Up to about 1.
    Unit,
}

impl Scale {
    /// The scale of the metric with this id; [`Self::Unit`] for metrics of other versions.
    pub fn of(metric: &str) -> Self {
        definition(metric).map_or(Self::Unit, |definition| definition.scale)
    }

    /// The decimals that papers print.
    pub const fn decimals(self) -> usize {
        match self {
            Self::Decibels => 2,
            Self::Unit => 3,
        }
    }
}

/// What is computed, with all parameters that affect the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Measure {
    /// [`psnr`](crate::psnr()).
    Psnr {
        /// Conversion of samples.
        values: Values,
    },
    /// [`ssim`](crate::ssim()).
    Ssim {
        /// Conversion of samples.
        values: Values,
        /// Window, border, covariance.
        ssim: Ssim,
    },
    /// [`l1`](crate::l1()).
    L1 {
        /// Conversion of samples.
        values: Values,
    },
    /// [`Lpips`](crate::learned::Lpips).
    #[serde(rename = "perceptual")]
    Lpips {
        /// Conversion of samples.
        values: Values,
        /// Network and version of its weights.
        network: LpipsNetwork,
        /// Whether samples in [0, 1] are scaled to [−1, 1], what the network expects: `normalize` of the lpips package.
        normalize: bool,
    },
}

impl Definition {
    /// How far a score may be beyond its [`Self::range`] by rounding: sums of squares of samples up to some hundreds lose so much
    /// against the constants of SSIM.
    pub const ROUNDING: f64 = 1e-6;

    /// The least and the largest value that a score can have; infinite without a bound.
    pub const fn range(&self) -> [f64; 2] {
        match self.measure {
            Measure::Ssim { .. } => [-1.0, 1.0],
            Measure::L1 { values: Values::Clipped | Values::EightBit(_) } => [0.0, 1.0],
            Measure::Psnr { values: Values::Clipped | Values::EightBit(_) }
            | Measure::L1 { values: Values::AsRendered }
            // The embedded heads are not negative; those of ST-LPIPS come from the user's file.
            | Measure::Lpips { network: LpipsNetwork::LpipsVgg | LpipsNetwork::LpipsAlex, .. } => [0.0, f64::INFINITY],
            Measure::Psnr { values: Values::AsRendered } | Measure::Lpips { .. } => {
                [f64::NEG_INFINITY, f64::INFINITY]
            }
        }
    }

    /// The network of a learned metric.
    pub const fn network(&self) -> Option<LpipsNetwork> {
        match self.measure {
            Measure::Lpips { network, .. } => Some(network),
            Measure::Psnr { .. } | Measure::Ssim { .. } | Measure::L1 { .. } => None,
        }
    }

    /// Whether a score is within its range, up to rounding; NaN is not.
    pub fn is_possible(&self, score: f64) -> bool {
        let [least, most] = self.range();
        (least - Self::ROUNDING..=most + Self::ROUNDING).contains(&score)
    }
}

const FLOAT: Values = Values::AsRendered;
const CLIPPED: Values = Values::Clipped;
const TRUNCATED: Values = Values::EightBit(Rounding::Truncate);
const ROUNDED: Values = Values::EightBit(Rounding::Nearest);

const PIXELSPLAT: &str = "https://github.com/dcharatan/pixelsplat/blob/32b1b66/src/evaluation/metrics.py";
const INRIA: &str = "https://github.com/graphdeco-inria/gaussian-splatting/blob/main/utils/loss_utils.py";
const LPIPS: &str = "https://github.com/richzhang/PerceptualSimilarity";
const INRIA_LPIPS: &str =
    "https://github.com/graphdeco-inria/gaussian-splatting/blob/main/lpipsPyTorch/modules/lpips.py";
const ST_LPIPS: &str = "https://github.com/abhijay9/ShiftTolerant-LPIPS";

const DEFINITIONS: &[Definition] = &[
    psnr(
        "psnr",
        "PSNR",
        CLIPPED,
        "both images clipped to [0, 1], no rounding, one mean over pixels and channels: pixelSplat, MVSplat, DepthSplat, NoPoSplat, iLRM, TokenGS",
        PIXELSPLAT,
    ),
    psnr(
        "psnr-unclipped",
        "PSNR (unclipped)",
        FLOAT,
        "values as rendered: gaussian-splatting's image_utils.py on images read from PNG; the log of its train.py averages the PSNR of three channels, another number",
        "https://github.com/graphdeco-inria/gaussian-splatting/blob/main/utils/image_utils.py",
    ),
    psnr(
        "psnr-8bit-truncated",
        "PSNR (8 bit, truncated)",
        TRUNCATED,
        "through PNG files that floor(255 v): pixelSplat's and NoPoSplat's offline evaluation",
        "https://github.com/dcharatan/pixelsplat/blob/32b1b66/src/misc/image_io.py",
    ),
    psnr(
        "psnr-8bit-rounded",
        "PSNR (8 bit, rounded)",
        ROUNDED,
        "through PNG files that floor(255 v + 0.5): torchvision's save_image, gaussian-splatting's metrics.py",
        "https://github.com/pytorch/vision/blob/main/torchvision/utils.py",
    ),
    ssim(
        "ssim",
        "SSIM",
        FLOAT,
        Ssim::SKIMAGE_GAUSSIAN,
        "skimage, Gaussian 11×11 of σ 1.5, covariance of the sample, windows inside the image, values not clipped: pixelSplat, MVSplat, DepthSplat, NoPoSplat, iLRM, TokenGS",
        PIXELSPLAT,
    ),
    ssim(
        "ssim-clipped",
        "SSIM (clipped)",
        CLIPPED,
        Ssim::SKIMAGE_GAUSSIAN,
        "as ssim, of images clipped to [0, 1]",
        PIXELSPLAT,
    ),
    ssim(
        "ssim-8bit-truncated",
        "SSIM (8 bit, truncated)",
        TRUNCATED,
        Ssim::SKIMAGE_GAUSSIAN,
        "as ssim, through PNG files that floor(255 v): pixelSplat's and NoPoSplat's offline evaluation",
        PIXELSPLAT,
    ),
    ssim(
        "ssim-8bit-rounded",
        "SSIM (8 bit, rounded)",
        ROUNDED,
        Ssim::SKIMAGE_GAUSSIAN,
        "as ssim, through PNG files that floor(255 v + 0.5)",
        PIXELSPLAT,
    ),
    ssim(
        "ssim-inria",
        "SSIM (Inria)",
        CLIPPED,
        Ssim::INRIA,
        "Gaussian 11×11 of σ 1.5, covariance of the population, zeros around the image, every pixel counts: gaussian-splatting and its descendants, clipped as they clip",
        INRIA,
    ),
    ssim(
        "ssim-inria-8bit-rounded",
        "SSIM (Inria, 8 bit)",
        ROUNDED,
        Ssim::INRIA,
        "as ssim-inria, through PNG files that floor(255 v + 0.5): gaussian-splatting's metrics.py and its descendants",
        INRIA,
    ),
    ssim(
        "ssim-valid",
        "SSIM (valid)",
        CLIPPED,
        Ssim::VALID,
        "Gaussian 11×11 of σ 1.5, covariance of the population, windows inside the image: pytorch-msssim, the JAX code of mip-NeRF and its descendants",
        "https://github.com/VainF/pytorch-msssim",
    ),
    ssim(
        "ssim-torchmetrics",
        "SSIM (torchmetrics)",
        CLIPPED,
        Ssim::TORCHMETRICS,
        "Gaussian 11×11 of σ 1.5, covariance of the population, mirrored border, every pixel counts: torchmetrics 1.9 with data_range (0, 1), whose border is not cropped",
        "https://lightning.ai/docs/torchmetrics/stable/image/structural_similarity.html",
    ),
    ssim(
        "ssim-uniform-7x7",
        "SSIM (7×7)",
        CLIPPED,
        Ssim::SKIMAGE_UNIFORM,
        "skimage's defaults, flat 7×7, covariance of the sample, windows inside the image, clipped: Long-LRM",
        "https://scikit-image.org/docs/stable/api/skimage.metrics.html#skimage.metrics.structural_similarity",
    ),
    lpips(
        "lpips",
        "LPIPS",
        FLOAT,
        LpipsNetwork::LpipsVgg,
        "VGG16, v0.1, values in [0, 1] scaled by the metric itself (normalize=True), not clipped: pixelSplat, MVSplat, DepthSplat, NoPoSplat, iLRM, TokenGS",
        LPIPS,
    ),
    lpips(
        "lpips-clipped",
        "LPIPS (clipped)",
        CLIPPED,
        LpipsNetwork::LpipsVgg,
        "as lpips, of images clipped to [0, 1]: Long-LRM",
        LPIPS,
    ),
    lpips(
        "lpips-8bit-truncated",
        "LPIPS (8 bit, truncated)",
        TRUNCATED,
        LpipsNetwork::LpipsVgg,
        "as lpips, through PNG files that floor(255 v)",
        LPIPS,
    ),
    Definition {
        measure: Measure::Lpips { values: ROUNDED, network: LpipsNetwork::LpipsVgg, normalize: false },
        ..lpips(
            "lpips-inria-8bit-rounded",
            "LPIPS (Inria, 8 bit)",
            ROUNDED,
            LpipsNetwork::LpipsVgg,
            "VGG16, v0.1, values in [0, 1] not scaled (normalize=False), through PNG files that floor(255 v + 0.5): gaussian-splatting's metrics.py and its descendants; another number than lpips",
            INRIA_LPIPS,
        )
    },
    lpips(
        "lpips-alex",
        "LPIPS (Alex)",
        FLOAT,
        LpipsNetwork::LpipsAlex,
        "AlexNet, v0.1, values in [0, 1] scaled by the metric itself, not clipped; never beside VGG's numbers",
        LPIPS,
    ),
    lpips(
        "st-lpips",
        "ST-LPIPS (Alex)",
        FLOAT,
        LpipsNetwork::StLpipsAlex,
        "shift-tolerant LPIPS on AlexNet, vST0.0, normalize=True, not clipped; another metric than LPIPS",
        ST_LPIPS,
    ),
    lpips(
        "st-lpips-vgg",
        "ST-LPIPS (VGG)",
        FLOAT,
        LpipsNetwork::StLpipsVgg,
        "shift-tolerant LPIPS on VGG16, vST0.0, normalize=True, not clipped; another metric than LPIPS",
        ST_LPIPS,
    ),
    Definition {
        id: "l1",
        name: "L1",
        direction: Direction::Lower,
        unit: "",
        scale: Scale::Unit,
        measure: Measure::L1 { values: CLIPPED },
        convention: "mean absolute difference over pixels and channels, both images clipped to [0, 1]",
        link: "https://github.com/nerfbaselines/nerfbaselines/blob/main/nerfbaselines/metrics.json",
    },
];

/// All metrics of two images, the most common variant first in each group.
pub const fn definitions() -> &'static [Definition] {
    DEFINITIONS
}

/// The metric of this id.
pub fn definition(id: &str) -> Option<&'static Definition> {
    DEFINITIONS.iter().find(|definition| definition.id == id)
}

/// The metric of an id that a user types, in upper or lower case: `PSNR` is `psnr`.
pub fn definition_in_any_case(id: &str) -> Option<&'static Definition> {
    DEFINITIONS.iter().find(|definition| definition.id.eq_ignore_ascii_case(id))
}

type Text = &'static str;

const fn psnr(id: Text, name: Text, values: Values, convention: Text, link: Text) -> Definition {
    Definition {
        id,
        name,
        direction: Direction::Higher,
        unit: "dB",
        scale: Scale::Decibels,
        measure: Measure::Psnr { values },
        convention,
        link,
    }
}

const fn ssim(id: Text, name: Text, values: Values, ssim: Ssim, convention: Text, link: Text) -> Definition {
    Definition {
        id,
        name,
        direction: Direction::Higher,
        unit: "",
        scale: Scale::Unit,
        measure: Measure::Ssim { values, ssim },
        convention,
        link,
    }
}

const fn lpips(
    id: Text,
    name: Text,
    values: Values,
    network: LpipsNetwork,
    convention: Text,
    link: Text,
) -> Definition {
    let measure = Measure::Lpips { values, network, normalize: true };
    let (unit, scale) = ("", Scale::Unit);
    Definition { id, name, direction: Direction::Lower, unit, scale, measure, convention, link }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The page lists each metric once, with its convention, and each learned one with the file of its weights.
    #[test]
    fn documented() {
        let page = include_str!("../../../docs/metrics.md");
        for Definition { id, convention, .. } in definitions() {
            assert!(page.contains(&format!("\n| `{id}` | {convention} |\n")), "docs/metrics.md lacks the line of {id}");
        }
        let files = page.lines().skip_while(|line| *line != "| metrics | file | from |");
        for (id, network) in definitions().iter().filter_map(|metric| Some((metric.id, metric.network()?))) {
            let [id, file] = [id, network.file()].map(|name| format!("`{name}`"));
            let is_listed = files.clone().any(|line| line.contains(&id) && line.contains(&file));
            assert!(is_listed, "docs/metrics.md lacks the file of {id}");
        }
        let listed =
            page.lines().skip_while(|line| *line != "| id | convention |").take_while(|line| line.starts_with('|'));
        assert_eq!(listed.count(), definitions().len() + 2);
    }

    #[test]
    fn impossible_scores_are_outside_the_range() {
        let possible = |id: &str, scores: [f64; 2]| scores.map(|score| definition(id).unwrap().is_possible(score));
        assert_eq!(possible("ssim", [-1.0 - 1e-9, 1.0 + 1e-9]), [true; 2], "rounding");
        assert_eq!([possible("ssim", [-1.01, 1.01]), possible("ssim-inria", [5.0, f64::NAN])], [[false; 2]; 2]);
        assert_eq!([possible("l1", [-0.1, 1.1]), possible("l1", [0.0, 1.0])], [[false; 2], [true; 2]]);
        assert_eq!(
            [possible("psnr", [-0.1, 150.0]), possible("psnr-unclipped", [-40.0, 9.0])],
            [[false, true], [true; 2]]
        );
        assert_eq!([possible("lpips", [-0.1, 1.4]), possible("st-lpips", [-0.1, 1.4])], [[false, true], [true; 2]]);
        assert!(definitions().iter().all(|definition| definition.is_possible(definition.range()[1])));
        for network in [LpipsNetwork::LpipsVgg, LpipsNetwork::LpipsAlex] {
            let heads = crate::learned::embedded_heads(network).unwrap().unwrap();
            let values = heads.tensors.values().flat_map(|tensor| tensor.to_f32().unwrap());
            assert!(values.into_iter().all(|weight| weight >= 0.0), "{network:?}");
        }
    }

    /// Readers of stored definitions know these.
    #[test]
    fn kinds_of_measures_are_stored_under_their_names() {
        for (id, kind) in [("psnr", "psnr"), ("ssim", "ssim"), ("l1", "l1"), ("st-lpips", "perceptual")] {
            let stored = serde_json::to_value(definition(id).unwrap().measure).unwrap();
            assert_eq!(stored["kind"], kind, "{id}");
        }
    }

    #[test]
    fn ids_are_unique_and_definitions_are_complete() {
        for (at, definition) in DEFINITIONS.iter().enumerate() {
            let duplicate =
                DEFINITIONS[at + 1..].iter().find(|d| d.id == definition.id || d.measure == definition.measure);
            assert_eq!(duplicate, None, "{} has a duplicate", definition.id);
            assert!(definition.link.starts_with("https://") && !definition.convention.is_empty(), "{}", definition.id);
            let kinds: &[&str] = match definition.measure {
                Measure::Psnr { .. } => &["psnr"],
                Measure::Ssim { .. } => &["ssim"],
                Measure::L1 { .. } => &["l1"],
                Measure::Lpips { .. } => &["lpips", "st-lpips"],
            };
            let is_of = |kind: &&str| definition.id == *kind || definition.id.starts_with(&format!("{kind}-"));
            assert!(kinds.iter().any(is_of), "{}: an id begins with the kind of its metric", definition.id);
            assert_eq!(super::definition(definition.id), Some(definition));
        }
        assert_eq!(definition("ssim2"), None);
        let ids = ["psnr-8bit-rounded", "ssim-inria", "lpips-alex", "l1", "ssim2"];
        assert_eq!(ids.map(|id| Scale::of(id).decimals()), [2, 3, 3, 3, 3]);
    }
}
