use serde::{Deserialize, Serialize};

use super::convolution::Convolution;
use super::pooling;

/// A network of LPIPS or ST-LPIPS, with the version of its weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LpipsNetwork {
    /// LPIPS v0.1 on VGG16: `lpips.LPIPS(net="vgg")`, what papers on novel view synthesis report.
    LpipsVgg,
    /// LPIPS v0.1 on `AlexNet`: `lpips.LPIPS(net="alex")`, what its authors recommend for comparing images.
    LpipsAlex,
    /// ST-LPIPS `vST0.0` on `AlexNet`: `stlpips_pytorch.LPIPS(net="alex", variant="shift_tolerant")`.
    StLpipsAlex,
    /// ST-LPIPS `vST0.0` on VGG16: `stlpips_pytorch.LPIPS(net="vgg", variant="shift_tolerant")`.
    StLpipsVgg,
}

/// One step of a network; public because `atsplat-train` implements it with gradients.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// A square convolution with zero padding.
    Convolution {
        /// Prefix of its tensors `.weight` and `.bias`.
        name: String,
        /// Input channels.
        channels_in: usize,
        /// Output channels.
        channels_out: usize,
        /// Side of the kernel.
        kernel: usize,
        /// Stride in pixels.
        stride: usize,
        /// Padding in pixels.
        padding: usize,
        /// Whether a `ReLU` follows.
        relu: bool,
    },
    /// Rectified linear unit.
    Relu,
    /// Max pooling without padding.
    MaxPool {
        /// Side of the square.
        kernel: usize,
        /// Stride in pixels.
        stride: usize,
    },
    /// Anti-aliased halving of Zhang 2019: (1 2 1)⊗(1 2 1) / 16 at every second pixel, with two reflected pixels as padding.
    BlurPool,
    /// Outputs the activations as features.
    Tap,
}

impl LpipsNetwork {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::LpipsVgg, Self::LpipsAlex, Self::StLpipsAlex, Self::StLpipsVgg];

    /// Name in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LpipsVgg => "LPIPS (VGG)",
            Self::LpipsAlex => "LPIPS (Alex)",
            Self::StLpipsAlex => "ST-LPIPS (Alex)",
            Self::StLpipsVgg => "ST-LPIPS (VGG)",
        }
    }

    /// Number of channels of the five feature maps.
    pub const fn channels(self) -> [usize; 5] {
        match self {
            Self::LpipsVgg | Self::StLpipsVgg => [64, 128, 256, 512, 512],
            Self::LpipsAlex | Self::StLpipsAlex => [64, 192, 384, 256, 256],
        }
    }

    /// Names of the five heads' tensors, each of shape (1, channels, 1, 1).
    pub fn heads() -> [String; 5] {
        std::array::from_fn(|tap| format!("lin{tap}.model.1.weight"))
    }

    /// Smallest width and height of images on which every step is defined.
    ///
    /// # Panics
    /// Never: every network fits far below 512 pixels.
    #[expect(clippy::expect_used, reason = "every network fits far below 512 pixels")]
    pub fn smallest_side(self) -> u32 {
        let steps = self.steps();
        (1..=512u32).find(|side| fits(&steps, *side as usize)).expect("a side of at most 512 pixels")
    }

    /// All steps, from the scaled image to the last features.
    pub fn steps(self) -> Vec<Step> {
        match self {
            Self::LpipsVgg => vgg(
                |convolution| format!("features.{}", VGG_POSITIONS[convolution]),
                &[Step::MaxPool { kernel: 2, stride: 2 }],
            ),
            Self::StLpipsVgg => vgg(st_vgg_name, &[Step::MaxPool { kernel: 2, stride: 1 }, Step::BlurPool]),
            Self::LpipsAlex => alex(),
            Self::StLpipsAlex => st_alex(),
        }
    }
}

fn fits(steps: &[Step], side: usize) -> bool {
    let after = steps.iter().try_fold(side, |side, step| match *step {
        Step::Convolution { kernel, stride, padding, .. } => Convolution::side(kernel, stride, padding, side),
        Step::MaxPool { kernel, stride } => Convolution::side(kernel, stride, 0, side),
        Step::BlurPool => pooling::blur_pooled_side(side),
        Step::Relu | Step::Tap => Some(side),
    });
    after.is_some_and(|side| side > 0)
}

/// Convolutions in each of VGG16's five blocks.
const VGG_BLOCKS: [usize; 5] = [2, 2, 3, 3, 3];
/// Positions of the convolutions in torchvision's `vgg16().features`.
const VGG_POSITIONS: [usize; 13] = [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28];

/// In ST-LPIPS a blur precedes each block but the first, and names contain the block.
fn st_vgg_name(convolution: usize) -> String {
    let (mut block, mut first) = (0, 0);
    while convolution >= first + VGG_BLOCKS[block] {
        first += VGG_BLOCKS[block];
        block += 1;
    }
    format!("net.slice{}.{}", block + 1, VGG_POSITIONS[convolution] + block)
}

fn vgg(name: impl Fn(usize) -> String, between: &[Step]) -> Vec<Step> {
    let mut steps = Vec::new();
    let (mut channels_in, mut convolution) = (3, 0);
    for (block, channels_out) in LpipsNetwork::LpipsVgg.channels().into_iter().enumerate() {
        if block > 0 {
            steps.extend_from_slice(between);
        }
        for _ in 0..VGG_BLOCKS[block] {
            steps.push(layer(name(convolution), [channels_in, channels_out], [3, 1, 1], true));
            (channels_in, convolution) = (channels_out, convolution + 1);
        }
        steps.push(Step::Tap);
    }
    steps
}

fn alex() -> Vec<Step> {
    let pool = || Step::MaxPool { kernel: 3, stride: 2 };
    vec![
        layer("features.0".to_owned(), [3, 64], [11, 4, 2], true),
        Step::Tap,
        pool(),
        layer("features.3".to_owned(), [64, 192], [5, 1, 2], true),
        Step::Tap,
        pool(),
        layer("features.6".to_owned(), [192, 384], [3, 1, 1], true),
        Step::Tap,
        layer("features.8".to_owned(), [384, 256], [3, 1, 1], true),
        Step::Tap,
        layer("features.10".to_owned(), [256, 256], [3, 1, 1], true),
        Step::Tap,
    ]
}

fn st_alex() -> Vec<Step> {
    let pool = || Step::MaxPool { kernel: 3, stride: 1 };
    vec![
        layer("net.slice1.0".to_owned(), [3, 64], [11, 1, 2], false),
        Step::BlurPool,
        Step::Relu,
        Step::Tap,
        pool(),
        Step::BlurPool,
        layer("net.slice2.5".to_owned(), [64, 192], [5, 1, 2], true),
        Step::Tap,
        pool(),
        Step::BlurPool,
        layer("net.slice3.9".to_owned(), [192, 384], [3, 1, 1], true),
        Step::Tap,
        layer("net.slice4.11".to_owned(), [384, 256], [3, 1, 1], true),
        Step::Tap,
        layer("net.slice5.13".to_owned(), [256, 256], [3, 1, 1], true),
        Step::Tap,
    ]
}

fn layer(
    name: String,
    [channels_in, channels_out]: [usize; 2],
    [kernel, stride, padding]: [usize; 3],
    relu: bool,
) -> Step {
    Step::Convolution { name, channels_in, channels_out, kernel, stride, padding, relu }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The list is what is loaded and tested.
    #[test]
    fn all_networks_are_in_the_list_of_all() {
        let unknown = serde_json::from_value::<LpipsNetwork>("".into()).unwrap_err().to_string();
        let all =
            LpipsNetwork::ALL.map(|network| serde_json::to_string(&network).unwrap().replace('"', "`")).join(", ");
        assert_eq!(unknown, format!("unknown variant ``, expected one of {all}"));
    }
}
