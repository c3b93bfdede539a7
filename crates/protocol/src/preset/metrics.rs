use serde::{Deserialize, Serialize};

/// How the scores of single images are aggregated into the protocol's number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aggregation {
    /// The mean over the targets of an entry of the index, then the mean over entries, so that a scene with two entries has two
    /// votes (MVSplat, DepthSplat, iLRM `src/model/model_wrapper.py`, `test_step` and `on_test_end`).
    SceneMeans,
    /// The mean over all images of all scenes (`MVSplat360` on DL3DV). Equals the former if all entries have the same
    /// number of targets.
    AllImages,
}

impl Aggregation {
    /// The one by which several protocols aggregate; `None` if they disagree, and without any.
    pub fn common(aggregations: impl IntoIterator<Item = Self>) -> Option<Self> {
        let mut aggregations = aggregations.into_iter();
        let first = aggregations.next()?;
        aggregations.all(|other| other == first).then_some(first)
    }
}

/// Which definitions of PSNR, SSIM and LPIPS a protocol uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct MetricConvention {
    /// Which PSNR.
    pub psnr: PsnrConvention,
    /// Which SSIM.
    pub ssim: SsimConvention,
    /// Which LPIPS.
    pub lpips: LpipsConvention,
    /// How the pixel values of renders reach the metrics.
    pub pixels: PixelValues,
    /// Whether renders are clipped to [0, 1] before SSIM and LPIPS; PSNR has its own rule.
    pub clip_before_ssim_and_lpips: bool,
}

/// Which PSNR.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PsnrConvention {
    /// Both images clipped to [0, 1], one mean squared error over all channels and pixels
    /// (pixelSplat `src/evaluation/metrics.py:11-19`).
    Clipped,
}

/// Which SSIM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SsimConvention {
    /// scikit-image with an 11×11 Gaussian of σ 1.5, sample covariance, data range 1; the mean over the
    /// image without a border of 5 pixels, then over channels (pixelSplat `src/evaluation/metrics.py`).
    SkimageGaussian,
    /// scikit-image's uniform 7×7 window on clamped renders (Long-LRM `model/loss.py:66-82`); not comparable.
    SkimageUniform,
}

/// Which LPIPS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LpipsConvention {
    /// `lpips.LPIPS(net="vgg")`, version 0.1, `normalize=True`.
    VggV01,
    /// The same with `AlexNet`.
    AlexV01,
}

/// How the pixel values of renders reach the metrics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PixelValues {
    /// Float values straight from the renderer (MVSplat, DepthSplat, iLRM, TokenGS, NoPoSplat online).
    Float,
    /// Clipped, multiplied by 255 and truncated to bytes, through PNG files (pixelSplat's published path,
    /// `src/misc/image_io.py`).
    TruncatedToBytes,
}

#[cfg(test)]
mod tests {
    use super::Aggregation::{self, AllImages, SceneMeans};

    #[test]
    fn the_common_aggregation_is_that_of_all() {
        assert_eq!(Aggregation::common([AllImages, AllImages, AllImages]), Some(AllImages));
        assert_eq!(Aggregation::common([SceneMeans, AllImages, SceneMeans]), None);
        assert_eq!(Aggregation::common([]), None);
    }
}
