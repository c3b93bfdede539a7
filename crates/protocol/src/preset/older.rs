//! What presets of older versions state otherwise: metrics by their settings instead of ids, the extent of Gaussians in standard
//! deviations, and the degree of harmonics by the name of the rasteriser. Such presets are read, and hashes are of this form.

use std::borrow::Cow;

use toml::de::DeTable;

use super::metrics::MetricsTable;
use super::{MethodSetting, MetricIds, RendererConvention, RendererExtent};

/// The tables of metrics in presets of older versions, with the ids of what they mean.
const METRICS: [(MetricsTable, MetricIds); 8] = [
    (of_settings(GAUSSIAN, VGG, FLOAT, false), MetricIds::new("psnr", "ssim", "lpips")),
    (of_settings(GAUSSIAN, ALEX, FLOAT, false), MetricIds::new("psnr", "ssim", "lpips-alex")),
    (of_settings(UNIFORM, VGG, FLOAT, false), MetricIds::new("psnr", "ssim-uniform-7x7", "lpips")),
    (of_settings(UNIFORM, ALEX, FLOAT, false), MetricIds::new("psnr", "ssim-uniform-7x7", "lpips-alex")),
    (of_settings(GAUSSIAN, VGG, FLOAT, true), MetricIds::new("psnr", "ssim-clipped", "lpips-clipped")),
    (of_settings(UNIFORM, VGG, FLOAT, true), MetricIds::new("psnr", "ssim-uniform-7x7", "lpips-clipped")),
    (of_settings(GAUSSIAN, VGG, TRUNCATED, false), OF_BYTES),
    (of_settings(GAUSSIAN, VGG, TRUNCATED, true), OF_CLIPPED_BYTES),
];
const GAUSSIAN: &str = "skimage-gaussian";
const UNIFORM: &str = "skimage-uniform";
const VGG: &str = "vgg-v01";
const ALEX: &str = "alex-v01";
const FLOAT: &str = "float";
const TRUNCATED: &str = "truncated-to-bytes";
const OF_BYTES: MetricIds = MetricIds::new("psnr-8bit-truncated", "ssim-8bit-truncated", "lpips-8bit-truncated");
/// The same metrics, with another hash.
const OF_CLIPPED_BYTES: MetricIds = MetricIds { clip_before_ssim_and_lpips: true, ..OF_BYTES };

/// A table with these SSIM, LPIPS, pixel values and clipping of renders before both.
const fn of_settings(ssim: &'static str, lpips: &'static str, pixels: &'static str, clip: bool) -> MetricsTable {
    MetricsTable {
        psnr: Some(Cow::Borrowed("clipped")),
        ssim: Some(Cow::Borrowed(ssim)),
        lpips: Some(Cow::Borrowed(lpips)),
        pixels: Some(Cow::Borrowed(pixels)),
        clip_before_ssim_and_lpips: Some(clip),
    }
}

/// The table of these metrics in a preset of an older version; `None` for metrics that only ids name.
pub(super) fn metrics_table(metrics: MetricIds) -> Option<MetricsTable> {
    METRICS.into_iter().find(|(_, ids)| *ids == metrics).map(|(table, _)| table)
}

/// The metrics of a table of an older version, or of the ids of [`OF_CLIPPED_BYTES`] as they are written.
pub(super) fn metrics(table: &MetricsTable) -> Result<MetricIds, String> {
    let written = (MetricsTable::from(OF_CLIPPED_BYTES), OF_CLIPPED_BYTES);
    let found = METRICS.into_iter().chain([written]).find(|(known, _)| known == table);
    found.map(|(_, ids)| ids).ok_or_else(|| {
        let MetricsTable { psnr, ssim, lpips, pixels, clip_before_ssim_and_lpips: clip } = table;
        let or_nothing = |value: Option<String>| value.unwrap_or_else(|| "nothing".to_owned());
        let quoted = |text: &Option<Cow<'static, str>>| or_nothing(text.as_ref().map(|text| format!("{text:?}")));
        let [psnr, ssim, lpips, pixels] = [psnr, ssim, lpips, pixels].map(quoted);
        let clip = or_nothing(clip.map(|clip| clip.to_string()));
        format!(
            "psnr = {psnr}, ssim = {ssim}, lpips = {lpips}, pixels = {pixels} and clip-before-ssim-and-lpips = {clip}, expected \
             ids of metrics without pixels and clip-before-ssim-and-lpips, such as ssim = \"ssim-8bit-truncated\""
        )
    })
}

const THREE_SIGMAS: f64 = 3.0;
/// Where a Gaussian of opacity 1 has an alpha of 1/255.
const ALL_SIGMAS: f64 = 3.33;

/// The extent that is so many standard deviations.
pub(super) fn extent(sigmas: f64) -> Result<RendererExtent, String> {
    if sigmas.total_cmp(&THREE_SIGMAS).is_eq() {
        Ok(RendererExtent::ThreeSigmaTiles)
    } else if sigmas.total_cmp(&ALL_SIGMAS).is_eq() {
        Ok(RendererExtent::Exact)
    } else {
        Err(format!(
            "extent-sigmas = {sigmas}, which is not drawn, expected extent = \"three-sigma-tiles\" or extent = \"exact\""
        ))
    }
}

/// The standard deviations of an extent.
pub(super) const fn sigmas(extent: RendererExtent) -> f64 {
    match extent {
        RendererExtent::ThreeSigmaTiles => THREE_SIGMAS,
        RendererExtent::Exact => ALL_SIGMAS,
    }
}

/// The highest degree of harmonics of a rasteriser of this name: of diff-gaussian-rasterization and its modified versions, 3.
pub(super) fn sh_degree(rasteriser: &str) -> u8 {
    if rasteriser.starts_with("diff-gaussian-rasterization") { 3 } else { RendererConvention::MAX_SH_DEGREE }
}

/// Whether the TOML of a preset states the extent in standard deviations, and so no degree of harmonics.
pub(super) fn has_sigmas(preset: &DeTable<'_>) -> bool {
    preset.get("renderer").is_some_and(|renderer| renderer.get_ref().get("extent-sigmas").is_some())
}

/// States the degree of harmonics of the renderers of methods that have a rasteriser of their own.
pub(super) fn state_degrees(methods: &mut [MethodSetting]) {
    for renderer in methods.iter_mut().filter_map(|setting| setting.renderer.as_mut()) {
        renderer.max_sh_degree = renderer.max_sh_degree.or_else(|| renderer.rasteriser.as_deref().map(sh_degree));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preset;

    const IDS: &str = "[metrics]\npsnr = \"psnr\"\nssim = \"ssim\"\nlpips = \"lpips\"\n";

    /// `re10k-2v-256` with this table of metrics.
    fn with_metrics(table: &str) -> Result<Preset, String> {
        let text = Preset::named("re10k-2v-256").unwrap().to_toml().unwrap();
        assert!(text.contains(IDS), "{text}");
        Preset::from_toml(&text.replacen(IDS, table, 1)).map_err(|error| error.to_string())
    }

    fn older_table(ssim: &str, lpips: &str, pixels: &str, clip: bool) -> String {
        format!(
            "[metrics]\npsnr = \"clipped\"\nssim = \"{ssim}\"\nlpips = \"{lpips}\"\npixels = \"{pixels}\"\n\
             clip-before-ssim-and-lpips = {clip}\n"
        )
    }

    #[test]
    fn older_tables_mean_the_metrics_that_they_meant() {
        let (gaussian, uniform, vgg, alex) = ("skimage-gaussian", "skimage-uniform", "vgg-v01", "alex-v01");
        let of_bytes = ["psnr-8bit-truncated", "ssim-8bit-truncated", "lpips-8bit-truncated"];
        for (table, expected) in [
            (older_table(gaussian, vgg, FLOAT, false), ["psnr", "ssim", "lpips"]),
            (older_table(gaussian, vgg, FLOAT, true), ["psnr", "ssim-clipped", "lpips-clipped"]),
            (older_table(gaussian, vgg, TRUNCATED, false), of_bytes),
            (older_table(gaussian, vgg, TRUNCATED, true), of_bytes),
            (older_table(gaussian, alex, FLOAT, false), ["psnr", "ssim", "lpips-alex"]),
            (older_table(uniform, vgg, FLOAT, true), ["psnr", "ssim-uniform-7x7", "lpips-clipped"]),
            (older_table(uniform, alex, FLOAT, false), ["psnr", "ssim-uniform-7x7", "lpips-alex"]),
        ] {
            assert_eq!(with_metrics(&table).unwrap().metrics.ids(), expected, "{table}");
        }
    }

    /// Each would be measured on other pixel values than the table says.
    #[test]
    fn older_tables_without_a_metric_are_rejected_with_what_to_write() {
        for table in [
            older_table("skimage-uniform", "vgg-v01", TRUNCATED, false),
            older_table("skimage-gaussian", "alex-v01", FLOAT, true),
            older_table("skimage-gaussian", "alex-v01", TRUNCATED, false),
            older_table("skimage-gauss", "vgg-v01", FLOAT, false),
            older_table("skimage-gaussian", "vgg-v01", FLOAT, false).replace("psnr = \"clipped\"\n", ""),
            "[metrics]\nssim = \"ssim-8bit-truncated\"\nclip-before-ssim-and-lpips = true\n".to_owned(),
        ] {
            let error = with_metrics(&table).unwrap_err();
            let says_what_to_write =
                error.contains("expected ids of metrics without pixels") && error.starts_with("preset: line ");
            assert!(says_what_to_write, "{error}");
        }
    }

    #[test]
    fn metrics_are_hashed_in_their_older_form() {
        let hash = |table: &str| with_metrics(table).unwrap().hash().unwrap();
        let built_in = Preset::named("re10k-2v-256").unwrap().hash().unwrap();
        assert_eq!(hash(&older_table("skimage-gaussian", "vgg-v01", FLOAT, false)), built_in);
        assert_eq!(hash(""), built_in, "the usual metrics");
        // Clipped before they are truncated, values are the same; a training or store under either is not one under the other.
        let [bytes, clipped] = [false, true].map(|clip| older_table("skimage-gaussian", "vgg-v01", TRUNCATED, clip));
        assert_ne!(hash(&bytes), hash(&clipped));
        for table in [bytes, clipped] {
            let preset = with_metrics(&table).unwrap();
            let again = Preset::from_toml(&preset.to_toml().unwrap()).unwrap();
            assert_eq!((&again, again.hash().unwrap()), (&preset, hash(&table)), "{table}");
        }
        let clipped = "[metrics]\nssim = \"ssim-clipped\"\nlpips = \"lpips-clipped\"\n";
        assert_eq!(hash(&older_table("skimage-gaussian", "vgg-v01", FLOAT, true)), hash(clipped));
        let others = ["ssim-clipped", "ssim-inria", "ssim-inria-8bit-rounded"]
            .map(|ssim| hash(&format!("[metrics]\nssim = \"{ssim}\"\n")));
        assert!(!others.contains(&built_in) && others[1] != others[2], "{others:?}");
    }

    /// iLRM's renderer states the name of another rasteriser, and no extent.
    #[test]
    fn a_renderer_in_standard_deviations_has_the_degrees_of_the_names() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        let text = preset.to_toml().unwrap();
        let older = |sigmas: &str| {
            let text = text.replace("extent = \"three-sigma-tiles\"", &format!("extent-sigmas = {sigmas}"));
            text.replace("max-sh-degree = 3\n", "").replace("max-sh-degree = 4\n", "")
        };
        let read = Preset::from_toml(&older("3.0")).unwrap();
        assert_eq!((&read, read.renderer.max_sh_degree, read.renderer_for("iLRM").max_sh_degree), (&preset, 3, 4));
        assert_eq!(read.hash().unwrap(), preset.hash().unwrap());
        let exact = Preset::from_toml(&older("3.33")).unwrap();
        assert_eq!((exact.renderer.extent, exact.renderer.max_sh_degree), (RendererExtent::Exact, 3));
        assert_ne!(exact.hash().unwrap(), preset.hash().unwrap());
        let other = older("3.0").replacen("rasteriser = \"diff-gaussian-rasterization", "rasteriser = \"inria", 1);
        assert_eq!(Preset::from_toml(&other).unwrap().renderer.max_sh_degree, 4, "as it was drawn");
        for sigmas in ["2.0", "30.0", "3.0001"] {
            let error = Preset::from_toml(&older(sigmas)).unwrap_err().to_string();
            assert!(error.contains("expected extent = \"three-sigma-tiles\" or extent = \"exact\""), "{error}");
            let found: f64 = sigmas.parse().unwrap();
            assert!(error.contains(&format!("found extent-sigmas = {found}, which is not drawn")), "{error}");
        }
    }
}
