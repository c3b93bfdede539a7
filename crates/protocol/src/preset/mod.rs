//! Presets: a published protocol as one TOML file in `eval/presets/`.
//!
//! A preset states which index, image preprocessing and conventions make a number comparable with a published one,
//! where each fact was read, and what had to be inferred because no source states it.

mod builtin;
mod filters;
mod hashed;
mod index_rule;
mod lens;
mod method;
mod metrics;
mod older;
mod renderer;
mod validate;

use std::path::Path;

use atsplat_files::{FileError, Sha256Digest, is_toml_path, malformed_toml};
use atsplat_scene::preprocess::Preprocessing;
use serde::{Deserialize, Serialize};
use toml::de::{DeTable, Deserializer};

pub use atsplat_camera::{MeanCameraScale, PoseNormalisation};
pub use filters::{DropReason, Dropped, Filters};
pub use index_rule::{AcceptedIndex, Derivation, IndexMatch, IndexRule};
pub use lens::LensDistortion;
pub use method::{DisparityPlanes, EffectiveSetting, MethodSetting, NearFar};
pub use metrics::{Aggregation, MetricIds};
pub use renderer::{NearCull, RendererConvention, RendererExtent, RendererOverrides, RendererPrincipalPoint};

use crate::{OverlapBins, ProtocolError};
use hashed::Hashed;

/// A protocol: everything that defines a benchmark number except the method and the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Preset {
    /// Name on the command line and in results: lower-case letters, digits and hyphens.
    pub name: String,
    /// One-line description for humans.
    pub title: String,
    /// Id of the dataset manifest in `datasets/`, or a name of other data.
    pub dataset: String,
    /// The published preset that this one imitates at another scale or on other scenes. Its numbers may appear in that
    /// protocol's tables, marked as such, to compare the order and the gaps of rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stands_for: Option<String>,
    /// What readers of the numbers must know.
    #[serde(default)]
    pub notes: Vec<String>,
    /// What this preset infers because no source states it, with the reason. Printed with every result.
    #[serde(default)]
    pub inferred: Vec<String>,
    /// Repository files and paper sections that the preset was read from.
    pub sources: Vec<String>,
    /// Whether lens distortion that the data state is used.
    #[serde(default, skip_serializing_if = "LensDistortion::is_used")]
    pub lens_distortion: LensDistortion,
    /// Which evaluation index.
    pub index: IndexRule,
    /// How images and intrinsics are preprocessed.
    pub preprocessing: Preprocessing,
    /// Pose normalisation for methods that are not listed in `methods`: that of ATSplat, which follows iLRM.
    pub pose_normalisation: PoseNormalisation,
    /// Near and far plane for these methods.
    pub near_far: NearFar,
    /// Settings that other methods published under this protocol.
    #[serde(default)]
    pub methods: Vec<MethodSetting>,
    /// Which scenes the published loaders silently drop.
    #[serde(default)]
    pub filters: Filters,
    /// How overlaps are binned, for protocols that report bins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlap_bins: Option<OverlapBins>,
    /// How scores of images are aggregated into one number.
    pub aggregation: Aggregation,
    /// Which PSNR, SSIM and LPIPS are used.
    #[serde(default)]
    pub metrics: MetricIds,
    /// The renderer constants behind the published numbers.
    pub renderer: RendererConvention,
}

impl Preset {
    /// Names of the built-in presets, in the order of `eval/README.md`.
    pub fn names() -> impl Iterator<Item = &'static str> {
        builtin::TEXTS.names()
    }

    /// The published preset in whose tables its results belong: itself, or the one that it stands for.
    pub fn published(&self) -> &str {
        self.stands_for.as_deref().unwrap_or(&self.name)
    }

    /// The TOML text of a built-in preset.
    ///
    /// # Errors
    /// [`ProtocolError::UnknownPreset`].
    pub fn text_of(name: &str) -> Result<&'static str, ProtocolError> {
        let unknown = || ProtocolError::UnknownPreset { name: name.to_owned(), known: Self::names().collect() };
        builtin::TEXTS.text(name).ok_or_else(unknown)
    }

    /// A built-in preset.
    ///
    /// # Errors
    /// [`ProtocolError::UnknownPreset`].
    pub fn named(name: &str) -> Result<Self, ProtocolError> {
        Self::from_toml(Self::text_of(name)?)
    }

    /// A built-in preset by name, or the one in a TOML file if the argument ends in `.toml`.
    ///
    /// # Errors
    /// [`ProtocolError::UnknownPreset`], or the errors of [`Self::read`].
    pub fn resolve(name_or_path: &str) -> Result<Self, ProtocolError> {
        if is_toml_path(name_or_path) { Self::read(Path::new(name_or_path)) } else { Self::named(name_or_path) }
    }

    /// Reads a preset from a TOML file. Only a copy of a built-in preset may have its name; texts for readers may differ.
    ///
    /// # Errors
    /// [`ProtocolError::Io`], or [`ProtocolError::InFile`] around the errors of [`Self::from_toml`] and around
    /// [`ProtocolError::Malformed`] for another preset's name.
    pub fn read(path: &Path) -> Result<Self, ProtocolError> {
        let text = atsplat_files::read_to_string(path)
            .map_err(FileError::during::<ProtocolError>("reading a preset", path))?;
        let preset = Self::from_toml(&text).and_then(|preset| validate::own_name(&preset).map(|()| preset));
        preset.map_err(|error| error.in_file(path))
    }

    /// Reads a preset from TOML text and checks that its fields are consistent.
    ///
    /// # Errors
    /// [`ProtocolError::Malformed`]: with line and column for text that is not a preset, with the field for
    /// contradictory values.
    pub fn from_toml(text: &str) -> Result<Self, ProtocolError> {
        let malformed = |error| malformed_toml("preset", "a preset", text, &error);
        let table = DeTable::parse(text).map_err(malformed)?;
        let has_sigmas = older::has_sigmas(table.get_ref());
        let mut preset = Self::deserialize(Deserializer::from(table)).map_err(malformed)?;
        if has_sigmas {
            older::state_degrees(&mut preset.methods);
        }
        validate::check(&preset)?;
        Ok(preset)
    }

    /// The preset as TOML text that [`Self::from_toml`] reads back.
    ///
    /// # Errors
    /// [`ProtocolError::Malformed`] for a value that TOML cannot represent; impossible if it was read from TOML.
    pub fn to_toml(&self) -> Result<String, ProtocolError> {
        toml::to_string(self).map_err(|error| validate::malformed("TOML", "a value that TOML can represent", &error))
    }

    /// Hash of everything that can change a number: the preset's fields as compact JSON in declaration order, without
    /// name, title, notes, inferences, sources, the preset that it stands for, the sampler and the estimator of the bins.
    /// Metrics and renderers are in the form of presets of older versions, so that hashes of stored results stay what they are.
    /// Results with different protocol hashes do not share a table.
    ///
    /// # Errors
    /// [`ProtocolError::Malformed`] for a value that JSON cannot represent; impossible if it was read from TOML.
    pub fn hash(&self) -> Result<Sha256Digest, ProtocolError> {
        let json = serde_json::to_vec(&Hashed::from(self))
            .map_err(|error| validate::malformed("JSON", "a value that JSON can represent", &error))?;
        Ok(Sha256Digest::of(&json))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::fs;

    use super::*;

    fn all() -> Vec<Preset> {
        Preset::names().map(|name| Preset::named(name).unwrap()).collect()
    }

    #[test]
    fn every_built_in_preset_has_the_name_of_its_file_and_sources() {
        for (name, preset) in Preset::names().zip(all()) {
            assert_eq!(preset.name, name);
            assert!(!preset.sources.is_empty() && !preset.title.is_empty(), "{name}");
        }
    }

    #[test]
    fn every_preset_file_is_built_in() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/presets");
        let files = fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
        let presets = files.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
        let names: BTreeSet<String> = presets.map(|path| path.file_stem().unwrap().display().to_string()).collect();
        assert_eq!(names, Preset::names().map(str::to_owned).collect());
    }

    #[test]
    fn a_preset_stands_for_a_published_one_if_its_index_is_embedded() {
        for preset in all() {
            let embedded = preset.index.accepted.iter().any(|file| crate::IndexFile::embedded(&file.name).is_some());
            assert_eq!(preset.stands_for.is_some(), embedded, "{}", preset.name);
            let Some(published) = preset.stands_for.as_deref().map(|name| Preset::named(name).unwrap()) else {
                continue;
            };
            assert_eq!(published.stands_for, None);
            assert_eq!(published.index.context_views, preset.index.context_views, "{}", preset.name);
        }
    }

    #[test]
    fn a_toml_round_trip_preserves_value_and_hash() {
        for preset in all() {
            let again = Preset::from_toml(&preset.to_toml().unwrap()).unwrap();
            assert_eq!(again, preset);
            assert_eq!(again.hash().unwrap(), preset.hash().unwrap());
        }
    }

    #[test]
    fn hashes_distinguish_presets_and_ignore_prose() {
        let hashes: BTreeSet<_> = all().iter().map(|preset| preset.hash().unwrap()).collect();
        assert_eq!(hashes.len(), Preset::names().count(), "every preset is a different protocol");
        let preset = Preset::named("re10k-2v-256").unwrap();
        let mut reworded = preset.clone();
        reworded.name.push('x');
        reworded.notes.push("another note".to_owned());
        reworded.index.accepted[0].note = Some("another note".to_owned());
        assert_eq!(reworded.hash().unwrap(), preset.hash().unwrap());
        let mut changed = preset.clone();
        changed.near_far.far += 1.0;
        assert_ne!(changed.hash().unwrap(), preset.hash().unwrap());
    }

    #[test]
    fn distinguishes_names_from_paths() {
        let error = Preset::resolve("re10k").unwrap_err().to_string();
        assert!(error.contains("re10k-2v-256") && error.contains("\"re10k\""), "{error}");
        let error = Preset::resolve("no/such.toml").unwrap_err().to_string();
        assert!(error.starts_with("reading a preset: ") && error.ends_with("(no/such.toml)"), "{error}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        fs::write(&path, Preset::text_of("dl3dv-6v-224").unwrap()).unwrap();
        assert_eq!(Preset::resolve(path.to_str().unwrap()).unwrap(), Preset::named("dl3dv-6v-224").unwrap());
    }

    /// Its rows would be those of the built-in one.
    #[test]
    fn a_file_that_differs_from_a_built_in_preset_has_another_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        let read = |preset: &Preset| {
            fs::write(&path, preset.to_toml().unwrap()).unwrap();
            Preset::read(&path).map(|preset| preset.name).map_err(|error| error.to_string())
        };
        let mut preset = Preset::named("re10k-2v-256").unwrap();
        preset.title = "a copy with another title".to_owned();
        assert_eq!(read(&preset), Ok("re10k-2v-256".to_owned()));
        preset.near_far.far += 1.0;
        let error = read(&preset).unwrap_err();
        assert!(error.contains("field name: expected another name") && error.contains("mine.toml"), "{error}");
        preset.name = "mine".to_owned();
        assert_eq!(read(&preset), Ok("mine".to_owned()));
        // None of these is in the hash.
        for (name, field, other) in [
            ("re10k-2v-256", "sampler = \"re10k-2v\"", "sampler = \"dl3dv-2v\""),
            ("rooms-2v-128", "stands-for = \"re10k-2v-256\"", "stands-for = \"dl3dv-2v-256x448\""),
            ("re10k-overlap", "estimator = \"roma\"", "estimator = \"epipolar-ray\""),
        ] {
            let text = Preset::text_of(name).unwrap();
            assert!(text.contains(field), "{name}");
            let changed = Preset::from_toml(&text.replacen(field, other, 1)).unwrap();
            assert_eq!(changed.hash().unwrap(), Preset::named(name).unwrap().hash().unwrap(), "{name}");
            assert!(read(&changed).unwrap_err().contains("field name: expected another name"), "{name}");
        }
    }
}
