use std::path::Path;

use atsplat_metrics::learned::WeightsFolders;
use atsplat_metrics::{Definition, Networks, Suite, definition_in_any_case, definitions};
use atsplat_results::MetricRecord;

use super::Dataset;
use crate::EvalError;

/// Cache of ground-truth features for learned metrics, in bytes.
const FEATURE_CACHE_BYTES: usize = 512 << 20;

/// Definitions by id in upper or lower case, without duplicates, in the order of [`definitions`]; `all` selects every metric.
///
/// # Errors
/// [`EvalError::Unknown`].
pub fn named_metrics<'a>(ids: impl IntoIterator<Item = &'a str>) -> Result<Vec<&'static Definition>, EvalError> {
    let (mut requested, mut all) = (Vec::new(), false);
    for id in ids {
        if id.eq_ignore_ascii_case("all") {
            all = true;
            continue;
        }
        let known = || definitions().iter().map(|metric| metric.id.to_owned()).collect();
        let unknown = || EvalError::Unknown { what: "metrics", found: id.to_owned(), known: known() };
        requested.push(definition_in_any_case(id).ok_or_else(unknown)?.id);
    }
    Ok(definitions().iter().filter(|metric| all || requested.contains(&metric.id)).collect())
}

/// The metrics of the protocols and those named in `more`, with weights of learned ones from a folder or torch's cache.
///
/// # Errors
/// [`EvalError::Unknown`], and [`EvalError::Metrics`] for a file that contains other weights.
pub fn suite(datasets: &[Dataset], more: &[String], weights: Option<&Path>) -> Result<Suite, EvalError> {
    let of_protocols = datasets.iter().flat_map(|dataset| dataset.preset.metrics.ids());
    let definitions = named_metrics(of_protocols.chain(more.iter().map(String::as_str)))?;
    let given = WeightsFolders::new(weights.iter().map(|folder| folder.to_path_buf()).collect());
    let networks = Networks::for_definitions(&definitions, &given.then(WeightsFolders::torch_hub()))?;
    Ok(Suite::new(definitions, networks, FEATURE_CACHE_BYTES))
}

/// The provenance records of a suite's metrics.
pub fn metric_records(suite: &Suite) -> Vec<MetricRecord> {
    let record = |metric: &&'static Definition| {
        let loaded = metric.network().map(|network| suite.networks().get(network));
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
    fn named_metrics_are_unique_and_ordered() {
        let ids = |list: &[&str]| {
            named_metrics(list.iter().copied()).map(|found| found.iter().map(|metric| metric.id).collect::<Vec<_>>())
        };
        assert_eq!(ids(&["l1", "ssim", "psnr", "ssim"]).unwrap(), ["psnr", "ssim", "l1"]);
        assert_eq!(ids(&["L1", "Ssim-INRIA", "PSNR", "psnr"]).unwrap(), ["psnr", "ssim-inria", "l1"]);
        for all in ["all", "ALL"] {
            assert_eq!(ids(&["l1", all]).unwrap().len(), definitions().len());
        }
        assert!(ids(&["all", "psnrs"]).is_err());
        assert!(ids(&["psnrs"]).unwrap_err().to_string().contains("psnr-unclipped"));
    }
}
