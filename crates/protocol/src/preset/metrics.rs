use std::borrow::Cow;

use atsplat_metrics::{Measure, definitions};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::older;

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

/// Which metrics are a protocol's PSNR, SSIM and LPIPS, by their ids among [`atsplat_metrics::definitions`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(into = "MetricsTable")]
pub struct MetricIds {
    /// A kind of PSNR.
    pub psnr: &'static str,
    /// A kind of SSIM.
    pub ssim: &'static str,
    /// A kind of LPIPS or ST-LPIPS.
    pub lpips: &'static str,
    /// Whether a preset of an older version clips renders that are truncated to bytes, which changes its hash but no number.
    pub(super) clip_before_ssim_and_lpips: bool,
}

impl MetricIds {
    pub(super) const fn new(psnr: &'static str, ssim: &'static str, lpips: &'static str) -> Self {
        Self { psnr, ssim, lpips, clip_before_ssim_and_lpips: false }
    }

    /// PSNR, SSIM and LPIPS, in this order.
    pub const fn ids(self) -> [&'static str; 3] {
        let Self { psnr, ssim, lpips, clip_before_ssim_and_lpips: _ } = self;
        [psnr, ssim, lpips]
    }
}

impl Default for MetricIds {
    /// Those of most papers: PSNR of clipped values, and SSIM and LPIPS by VGG of values as rendered.
    fn default() -> Self {
        Self::new("psnr", "ssim", "lpips")
    }
}

/// The table `[metrics]` of a preset, or of one of an older version, which always has the last two fields.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(super) struct MetricsTable {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) psnr: Option<Cow<'static, str>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) ssim: Option<Cow<'static, str>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) lpips: Option<Cow<'static, str>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) pixels: Option<Cow<'static, str>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) clip_before_ssim_and_lpips: Option<bool>,
}

impl From<MetricIds> for MetricsTable {
    fn from(MetricIds { psnr, ssim, lpips, clip_before_ssim_and_lpips }: MetricIds) -> Self {
        let [psnr, ssim, lpips] = [psnr, ssim, lpips].map(|id| Some(Cow::Borrowed(id)));
        let clip_before_ssim_and_lpips = clip_before_ssim_and_lpips.then_some(true);
        Self { psnr, ssim, lpips, pixels: None, clip_before_ssim_and_lpips }
    }
}

// Derived, it would borrow the ids from the text.
impl<'de> Deserialize<'de> for MetricIds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let table = MetricsTable::deserialize(deserializer)?;
        let is_older = table.pixels.is_some() || table.clip_before_ssim_and_lpips.is_some();
        let ids = if is_older { older::metrics(&table) } else { of_ids(&table) };
        ids.map_err(D::Error::custom)
    }
}

fn of_ids(MetricsTable { psnr, ssim, lpips, .. }: &MetricsTable) -> Result<MetricIds, String> {
    let usual = MetricIds::default();
    Ok(MetricIds::new(
        of_column("psnr", psnr.as_deref(), usual.psnr)?,
        of_column("ssim", ssim.as_deref(), usual.ssim)?,
        of_column("lpips", lpips.as_deref(), usual.lpips)?,
    ))
}

/// The field of the table that may name a metric; `None` for metrics that no protocol names.
const fn column(measure: Measure) -> Option<&'static str> {
    match measure {
        Measure::Psnr { .. } => Some("psnr"),
        Measure::Ssim { .. } => Some("ssim"),
        Measure::Lpips { .. } => Some("lpips"),
        Measure::L1 { .. } => None,
    }
}

/// The id that a field states, which must be one of its metrics.
fn of_column(field: &str, stated: Option<&str>, usual: &'static str) -> Result<&'static str, String> {
    let Some(stated) = stated else { return Ok(usual) };
    let known = definitions().iter().filter(|metric| column(metric.measure) == Some(field)).map(|metric| metric.id);
    known.clone().find(|id| *id == stated).ok_or_else(|| {
        let known: Vec<&str> = known.collect();
        format!("{field} = {stated:?}, expected one of {}", known.join(", "))
    })
}

#[cfg(test)]
mod tests {
    use super::Aggregation::{AllImages, SceneMeans};
    use super::*;
    use crate::Preset;

    #[test]
    fn the_common_aggregation_is_that_of_all() {
        assert_eq!(Aggregation::common([AllImages, AllImages, AllImages]), Some(AllImages));
        assert_eq!(Aggregation::common([SceneMeans, AllImages, SceneMeans]), None);
        assert_eq!(Aggregation::common([]), None);
    }

    /// `rooms-2v-64` with these metrics.
    fn with_metrics(fields: &str) -> Result<Preset, String> {
        let text = Preset::text_of("rooms-2v-64").unwrap();
        Preset::from_toml(&format!("{text}\n[metrics]\n{fields}\n")).map_err(|error| error.to_string())
    }

    #[test]
    fn a_protocol_names_any_metric_of_a_column() {
        for metric in definitions() {
            let column = match metric.measure {
                Measure::Psnr { .. } => "psnr",
                Measure::Ssim { .. } => "ssim",
                Measure::Lpips { .. } => "lpips",
                Measure::L1 { .. } => continue,
            };
            let preset = with_metrics(&format!("{column} = \"{}\"", metric.id)).unwrap();
            let of = |name: &str, usual: &'static str| if name == column { metric.id } else { usual };
            let expected = [of("psnr", "psnr"), of("ssim", "ssim"), of("lpips", "lpips")];
            assert_eq!(preset.metrics.ids(), expected, "what is not stated is as usual");
            let again = Preset::from_toml(&preset.to_toml().unwrap()).unwrap();
            assert_eq!((&again, again.hash().unwrap()), (&preset, preset.hash().unwrap()), "{}", metric.id);
        }
        assert_eq!(with_metrics("").unwrap().metrics.ids(), ["psnr", "ssim", "lpips"]);
    }

    #[test]
    fn a_metric_of_another_column_or_of_none_is_an_error_with_the_known_ones() {
        for (fields, found, known, other) in [
            ("ssim = \"ssim-iniria\"", "ssim = \"ssim-iniria\"", "ssim-inria-8bit-rounded", "psnr-unclipped"),
            ("psnr = \"ssim\"", "psnr = \"ssim\"", "psnr-unclipped", "ssim-inria"),
            ("lpips = \"l1\"", "lpips = \"l1\"", "lpips-alex", "ssim-inria"),
            ("psnr = \"clipped\"", "psnr = \"clipped\"", "psnr-8bit-rounded", "lpips"),
        ] {
            let error = with_metrics(fields).unwrap_err();
            let is_found = error.starts_with("preset: line ") && error.contains(&format!(", found {found}"));
            assert!(is_found && error.contains(known) && !error.contains(other), "{error}");
        }
        let error = with_metrics("mse = \"l1\"").unwrap_err();
        assert!(error.contains("unknown field `mse`"), "{error}");
    }
}
