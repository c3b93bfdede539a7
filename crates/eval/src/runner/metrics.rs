use std::path::Path;

use atsplat_metrics::learned::{Network, WeightsFolders};
use atsplat_metrics::{Definition, Measure, Networks, Suite, definition, definitions};
use atsplat_protocol::{LpipsConvention, MetricConvention, PixelValues, Preset, PsnrConvention, SsimConvention};
use atsplat_results::MetricRecord;

use super::Dataset;
use crate::EvalError;

/// Cache of ground-truth features for learned metrics, in bytes.
const FEATURE_CACHE_BYTES: usize = 512 << 20;

/// A protocol's variants of PSNR, SSIM and LPIPS, in this order, as ids of [`atsplat_metrics::definitions`].
pub const fn metric_ids(convention: &MetricConvention) -> [&'static str; 3] {
    let MetricConvention { psnr, ssim, lpips, pixels, clip_before_ssim_and_lpips: clip } = *convention;
    let truncated = matches!(pixels, PixelValues::TruncatedToBytes);
    let psnr = match psnr {
        PsnrConvention::Clipped if truncated => "psnr-8bit-truncated",
        PsnrConvention::Clipped => "psnr",
    };
    let ssim = match ssim {
        SsimConvention::SkimageUniform => "ssim-uniform-7x7",
        SsimConvention::SkimageGaussian if truncated => "ssim-8bit-truncated",
        SsimConvention::SkimageGaussian if clip => "ssim-clipped",
        SsimConvention::SkimageGaussian => "ssim",
    };
    let lpips = match lpips {
        LpipsConvention::AlexV01 => "lpips-alex",
        LpipsConvention::VggV01 if truncated => "lpips-8bit-truncated",
        LpipsConvention::VggV01 if clip => "lpips-clipped",
        LpipsConvention::VggV01 => "lpips",
    };
    [psnr, ssim, lpips]
}

/// Definitions by id, without duplicates, in the order of [`definitions`]; `all` selects every metric.
///
/// # Errors
/// [`EvalError::Unknown`].
pub fn named_metrics<'a>(ids: impl IntoIterator<Item = &'a str>) -> Result<Vec<&'static Definition>, EvalError> {
    let (mut requested, mut all) = (Vec::new(), false);
    for id in ids {
        if id == "all" {
            all = true;
            continue;
        }
        let known = || definitions().iter().map(|metric| metric.id.to_owned()).collect();
        let unknown = || EvalError::Unknown { what: "metrics", found: id.to_owned(), known: known() };
        requested.push(definition(id).ok_or_else(unknown)?.id);
    }
    Ok(definitions().iter().filter(|metric| all || requested.contains(&metric.id)).collect())
}

/// The metrics of the protocols and those named in `more`, with weights of learned ones from a folder or torch's cache.
///
/// # Errors
/// [`EvalError::Unknown`], [`EvalError::Settings`] for a protocol whose metrics do not exist for its pixel values, and
/// [`EvalError::Metrics`] for a file that contains other weights.
pub fn suite(datasets: &[Dataset], more: &[String], weights: Option<&Path>) -> Result<Suite, EvalError> {
    datasets.iter().try_for_each(|dataset| check_implemented(&dataset.preset))?;
    let of_protocols = datasets.iter().flat_map(|dataset| metric_ids(&dataset.preset.metrics));
    let definitions = named_metrics(of_protocols.chain(more.iter().map(String::as_str)))?;
    let given = WeightsFolders::new(weights.iter().map(|folder| folder.to_path_buf()).collect());
    let networks = Networks::for_definitions(&definitions, &given.then(WeightsFolders::torch_hub()))?;
    Ok(Suite::new(definitions, networks, FEATURE_CACHE_BYTES))
}

/// Rejects a protocol whose SSIM or LPIPS only exists for other pixel values than the protocol's.
fn check_implemented(preset: &Preset) -> Result<(), EvalError> {
    let MetricConvention { psnr: _, ssim, lpips, pixels, clip_before_ssim_and_lpips: clip } = preset.metrics;
    let truncated = pixels == PixelValues::TruncatedToBytes;
    let expected = match (ssim, lpips) {
        (SsimConvention::SkimageUniform, _) if truncated => "pixels = \"float\" for ssim = \"skimage-uniform\"",
        (_, LpipsConvention::AlexV01) if truncated || clip => {
            "pixels = \"float\" and clip-before-ssim-and-lpips = false for lpips = \"alex-v01\""
        }
        _ => return Ok(()),
    };
    let found = format!("other pixel values in {}", preset.name);
    Err(EvalError::Settings { what: "metrics of the protocol", expected: expected.to_owned(), found })
}

/// The provenance records of a suite's metrics.
pub fn metric_records(suite: &Suite) -> Vec<MetricRecord> {
    let record = |metric: &&'static Definition| {
        let network = match metric.measure {
            Measure::Perceptual { network, .. } => Some(network),
            _ => None,
        };
        let loaded = network.map(|network: Network| suite.networks().get(network));
        let (weights_sha256, absent) = match loaded {
            None => (None, None),
            Some(Ok(perceptual)) => (Some(perceptual.hashes().network.clone()), None),
            Some(Err(absent)) => (None, Some(absent.to_string())),
        };
        MetricRecord { id: metric.id.to_owned(), convention: metric.convention.to_owned(), weights_sha256, absent }
    };
    suite.definitions().iter().map(record).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_convention_maps_to_existing_metrics() {
        let mut convention = Preset::named("re10k-2v-256").unwrap().metrics;
        assert_eq!(metric_ids(&convention), ["psnr", "ssim", "lpips"]);
        for pixels in [PixelValues::Float, PixelValues::TruncatedToBytes] {
            for ssim in [SsimConvention::SkimageGaussian, SsimConvention::SkimageUniform] {
                for lpips in [LpipsConvention::VggV01, LpipsConvention::AlexV01] {
                    for clip_before_ssim_and_lpips in [false, true] {
                        convention = MetricConvention { pixels, ssim, lpips, clip_before_ssim_and_lpips, ..convention };
                        assert_eq!(named_metrics(metric_ids(&convention)).unwrap().len(), 3, "{convention:?}");
                    }
                }
            }
        }
    }

    /// The metric of that name would be measured on other pixel values than the protocol's.
    #[test]
    fn metrics_that_are_not_implemented_for_a_protocols_pixels_are_rejected() {
        let mut preset = Preset::named("re10k-2v-256").unwrap();
        let mut is_rejected = |ssim, lpips, pixels, clip_before_ssim_and_lpips| {
            preset.metrics = MetricConvention { ssim, lpips, pixels, clip_before_ssim_and_lpips, ..preset.metrics };
            check_implemented(&preset).is_err()
        };
        let (float, bytes) = (PixelValues::Float, PixelValues::TruncatedToBytes);
        let (gaussian, uniform) = (SsimConvention::SkimageGaussian, SsimConvention::SkimageUniform);
        let (vgg, alex) = (LpipsConvention::VggV01, LpipsConvention::AlexV01);
        let rejected = [
            is_rejected(gaussian, vgg, bytes, true),
            is_rejected(uniform, vgg, float, true),
            is_rejected(uniform, vgg, bytes, false),
            is_rejected(gaussian, alex, float, false),
            is_rejected(gaussian, alex, float, true),
            is_rejected(gaussian, alex, bytes, false),
        ];
        assert_eq!(rejected, [false, false, true, false, true, true]);
    }

    #[test]
    fn named_metrics_are_unique_and_ordered() {
        let ids = |list: &[&str]| {
            named_metrics(list.iter().copied()).map(|found| found.iter().map(|metric| metric.id).collect::<Vec<_>>())
        };
        assert_eq!(ids(&["l1", "ssim", "psnr", "ssim"]).unwrap(), ["psnr", "ssim", "l1"]);
        assert_eq!(ids(&["l1", "all"]).unwrap().len(), definitions().len());
        assert!(ids(&["all", "psnrs"]).is_err());
        assert!(ids(&["psnrs"]).unwrap_err().to_string().contains("psnr-unclipped"));
    }
}
