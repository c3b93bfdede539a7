//! What the hash of a preset is of.

use atsplat_scene::preprocess::Preprocessing;
use serde::Serialize;

use super::metrics::MetricsTable;
use super::older;
use super::renderer::RendererTable;
use super::{
    Aggregation, DisparityPlanes, Filters, IndexRule, LensDistortion, MethodSetting, NearFar, PoseNormalisation,
    Preset, RendererConvention, RendererOverrides,
};
use crate::OverlapBins;

/// The fields of a preset in their order, without what changes no number, in the form of older versions where it can state them:
/// hashes of presets of any version are equal if their numbers are.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Hashed<'a> {
    name: &'static str,
    title: &'static str,
    dataset: &'a str,
    notes: [&'static str; 0],
    inferred: [&'static str; 0],
    sources: [&'static str; 0],
    #[serde(skip_serializing_if = "LensDistortion::is_used")]
    lens_distortion: LensDistortion,
    index: IndexRule,
    preprocessing: &'a Preprocessing,
    pose_normalisation: &'a PoseNormalisation,
    near_far: NearFar,
    methods: Vec<HashedMethod<'a>>,
    filters: &'a Filters,
    #[serde(skip_serializing_if = "Option::is_none")]
    overlap_bins: Option<OverlapBins>,
    aggregation: Aggregation,
    metrics: MetricsTable,
    renderer: RendererTable,
}

impl<'a> From<&'a Preset> for Hashed<'a> {
    fn from(preset: &'a Preset) -> Self {
        let Preset {
            name: _,
            title: _,
            dataset,
            stands_for: _,
            notes: _,
            inferred: _,
            sources: _,
            lens_distortion,
            index,
            preprocessing,
            pose_normalisation,
            near_far,
            methods,
            filters,
            overlap_bins,
            aggregation,
            metrics,
            renderer,
        } = preset;
        // The hash of the index identifies what was sampled.
        let mut index = IndexRule { sampler: None, ..index.clone() };
        index.accepted.iter_mut().for_each(|accepted| accepted.note = None);
        Self {
            name: "",
            title: "",
            dataset,
            notes: [],
            inferred: [],
            sources: [],
            lens_distortion: *lens_distortion,
            index,
            preprocessing,
            pose_normalisation,
            near_far: *near_far,
            methods: methods.iter().map(|setting| HashedMethod::of(setting, renderer)).collect(),
            filters,
            // The estimator that the edges were published for affects how results are binned, not the numbers.
            overlap_bins: overlap_bins.clone().map(OverlapBins::without_estimator),
            aggregation: *aggregation,
            metrics: older::metrics_table(*metrics).unwrap_or_else(|| (*metrics).into()),
            renderer: renderer_table(renderer.into(), renderer),
        }
    }
}

impl Preset {
    /// What the hash leaves out, but texts: the published protocol that it stands for, the sampling rule, the estimator of the bins.
    pub(super) fn unhashed(&self) -> [Option<&str>; 3] {
        let estimator = self.overlap_bins.as_ref().and_then(OverlapBins::estimator);
        [self.stands_for.as_deref(), self.index.sampler.as_deref(), estimator]
    }
}

/// A [`MethodSetting`] without its source.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct HashedMethod<'a> {
    method: &'a str,
    pose_normalisation: &'a PoseNormalisation,
    near_far: NearFar,
    #[serde(skip_serializing_if = "Option::is_none")]
    disparity_planes: Option<DisparityPlanes>,
    source: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    renderer: Option<RendererTable>,
}

impl<'a> HashedMethod<'a> {
    fn of(setting: &'a MethodSetting, of_preset: &RendererConvention) -> Self {
        let MethodSetting { method, pose_normalisation, near_far, disparity_planes, source: _, renderer } = setting;
        let hashed = |own: &RendererOverrides| renderer_table(own.clone(), &own.applied_to(of_preset));
        Self {
            method,
            pose_normalisation,
            near_far: *near_far,
            disparity_planes: *disparity_planes,
            source: "",
            renderer: renderer.as_ref().map(hashed),
        }
    }
}

/// The constants that a preset states for a renderer, in the form of older versions; `all` are the renderer's. The degree of spherical
/// harmonics is among them where it is not the one that the rasteriser of this name has in older versions.
fn renderer_table(stated: RendererOverrides, all: &RendererConvention) -> RendererTable {
    let is_of_name = all.max_sh_degree == older::sh_degree(&all.rasteriser);
    RendererTable {
        rasteriser: stated.rasteriser,
        near_cull: stated.near_cull,
        near_cull_unit: stated.near_cull_unit,
        dilation: stated.dilation,
        alpha_max: stated.alpha_max,
        alpha_min_inverse: stated.alpha_min_inverse,
        transmittance_stop: stated.transmittance_stop,
        extent: None,
        extent_sigmas: stated.extent.map(older::sigmas),
        max_sh_degree: (!is_of_name).then_some(all.max_sh_degree),
        background: stated.background,
        principal_point: stated.principal_point,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::preset::RendererExtent;

    /// The hashes with which results were stored.
    #[test]
    fn hashes_of_built_in_presets_are_those_of_stored_results() {
        let hashes = [
            ("re10k-2v-256", "4db8a464281c50c9162c47688b9d330ecf07eec2409b063cfaef62cc7cd7474b"),
            ("re10k-overlap", "5a165eef3a28ce42c26fa1dd7d68d91a485d36168426e6fe851f22cb8d764296"),
            ("acid-2v-256", "f3e5541093aecd4e4d046bb7a54dd720de03546e1880ddf8f18ab67aeb860fb1"),
            ("acid-overlap", "7d9ce42a53b8a3d71127d06bcc67f07a6951e6aa6bd0566a04b6927b1643ab0d"),
            ("dl3dv-2v-256x448", "caca8be543f5c52e07191938c92a0e8ccfb68c6af1c353c7425e3b65ba7b5d84"),
            ("dl3dv-4v-256x448", "6c60f8cb73bc5b7240455342f669b35c6fc06fc4d472e4464a8e59ebb3b2163b"),
            ("dl3dv-6v-256x448", "74fbbff5e9f36d9cb21eac4c171cf6123e6dcc08a03498759d09259b7c44663b"),
            ("dl3dv-12v-512x960", "f2e8b735d2374060ed98e7301493c2787aaa7b30ee20c459c640cfeac258da59"),
            ("dl3dv-6v-224", "92838c8b41f5b5f251e7eb9328823ac308e703064bb56cddce002e16dce8a76d"),
            ("re10k-to-dl3dv-256", "c9d46668f316609e8ea51ccbf8096bdd6df92ed9cbb772d23e3457d0da5e6942"),
            ("dl3dv-6v-extrapolation", "720b3738735e4a400a073ccab61f2c548486a4b880851e687bec6ede90c2ba5a"),
            ("re10k-extrapolation", "b624547798fed0706ac319822d291c39267bfa6f91db6bfbde0e17d1513fede7"),
            ("photos-3v-256", "a9d57bf4d9e4185368d6a6ad5ca9b0c18b74cd7b0f8222e6890d68755b053134"),
            ("rooms-2v-128", "8b235f71a5a0bff435ec0a92fc2eff38dbfc65e23260e8d004cb6ceadd15bd15"),
            ("rooms-2v-64", "7eb2b15f95035e39fc9a9bfe4950a74fd5ee65ef6d61b5d127118da84270babd"),
            ("rooms-overlap-128", "997324aa296a4de70bea1404cdf571fd47c006a7553d0434854ccef79da4815a"),
            ("rooms-extrapolation-128", "6fac77c6868bc5afdf7624a4e282f35de4b9360bdcb2ac394fd3b9bbd93b7692"),
            ("yards-2v-128x224", "6bb8c6c34e86a1ef7d7ee3d7966dbe558bfffe059091e3519b17a353a1af6267"),
            ("yards-4v-128x224", "15b09c401b88297148bc395ef7036886f6ef9a2414bc1b98e0ffe93fbbef3d8f"),
            ("yards-6v-128x224", "a7e0490e5967edffffa35099012ef05adac8bcf2f03b11b7bf3617e5e2d71f9b"),
            ("yards-12v-256x480", "ddc43287736623baf2092b2db303d68afbd13bb0d93d060f4f72ec677e1fdc7f"),
            ("yards-6v-112", "4147fe13f58317397c58dfc8ee6240452bc1d78488dd730872fcafdcf6222df1"),
            ("rooms-to-yards-128", "187e5d81fd1f9cb598d5bc8e087166d2d2d9a148f72fe4d96b4a4f6f5d1c86d6"),
            ("yards-6v-extrapolation", "9d6ce48dd010c91d17ef44a209e09d0b8d950b4084eb1cc32531624e3a555bba"),
        ];
        let found: Vec<(&str, String)> =
            Preset::names().map(|name| (name, Preset::named(name).unwrap().hash().unwrap().to_string())).collect();
        let found: Vec<(&str, &str)> = found.iter().map(|(name, hash)| (*name, hash.as_str())).collect();
        assert_eq!(found, hashes);
    }

    #[test]
    fn a_degree_that_the_name_does_not_tell_gives_another_hash() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        let hash = |change: fn(&mut Preset)| {
            let mut changed = preset.clone();
            change(&mut changed);
            changed.hash().unwrap()
        };
        let of_method = |preset: &mut Preset, method: &str, degree: u8| {
            let setting = preset.methods.iter_mut().find(|setting| setting.method == method).unwrap();
            setting.renderer.get_or_insert_default().max_sh_degree = Some(degree);
        };
        let hashes = [
            preset.hash().unwrap(),
            hash(|preset| preset.renderer.max_sh_degree = 4),
            hash(|preset| preset.renderer.max_sh_degree = 2),
            hash(|preset| preset.renderer.extent = RendererExtent::Exact),
        ];
        let distinct: BTreeSet<_> = hashes.iter().collect();
        assert_eq!(distinct.len(), hashes.len(), "{hashes:?}");
        let mut same = preset.clone();
        of_method(&mut same, "iLRM", 4);
        assert_eq!(same.hash().unwrap(), hashes[0], "as gsplat has it");
        let mut lower = preset.clone();
        of_method(&mut lower, "iLRM", 3);
        let mut other = preset.clone();
        of_method(&mut other, "Long-LRM", 3);
        let [lower, other] = [lower, other].map(|changed| changed.hash().unwrap());
        assert!(lower != hashes[0] && other != lower && other != hashes[0]);
    }
}
