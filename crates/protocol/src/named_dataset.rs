use atsplat_scene::Format;

/// A dataset that protocols and tables know by name: a published one, or simulated scenes that stand in for one.
#[derive(Debug)]
pub struct NamedDataset {
    /// Its id in presets, in [`KnownIndex::dataset`](crate::KnownIndex::dataset) and in the folder `datasets/`.
    pub id: &'static str,
    /// Its name in tables.
    pub name: &'static str,
    /// The words that name it in a description of training data, in lower case.
    pub words: &'static [&'static str],
    /// The formats in which a copy on disk may be; none for simulated scenes, which are made when they are needed.
    pub formats: &'static [Format],
    /// Those in which any data count as it, so that its sampling rules replace a published index. Chunks do not say which dataset they
    /// belong to.
    pub formats_of_any_data: &'static [Format],
}

/// All of them. Protocols for any posed capture have the dataset `photos`, which is none of these.
pub static NAMED_DATASETS: [NamedDataset; 5] = [
    NamedDataset {
        id: "re10k",
        name: "RE10K",
        words: &["re10k", "realestate10k"],
        formats: &[Format::Re10k, Format::TorchChunks],
        formats_of_any_data: &[],
    },
    NamedDataset {
        id: "acid",
        name: "ACID",
        words: &["acid"],
        formats: &[Format::Re10k, Format::TorchChunks],
        formats_of_any_data: &[],
    },
    NamedDataset {
        id: "dl3dv",
        name: "DL3DV",
        words: &["dl3dv"],
        formats: &[Format::Nerfstudio, Format::TorchChunks],
        formats_of_any_data: &[Format::Nerfstudio],
    },
    NamedDataset { id: "rooms", name: "rooms", words: &["rooms"], formats: &[], formats_of_any_data: &[] },
    NamedDataset { id: "yards", name: "yards", words: &["yards"], formats: &[], formats_of_any_data: &[] },
];

impl NamedDataset {
    /// The dataset with this id; `None` for other data.
    pub fn by_id(id: &str) -> Option<&'static Self> {
        NAMED_DATASETS.iter().find(|dataset| dataset.id == id)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;
    use crate::{KNOWN_INDICES, Preset};

    #[test]
    fn ids_and_words_are_unique_and_words_can_be_found() {
        let ids: BTreeSet<_> = NAMED_DATASETS.iter().map(|dataset| dataset.id).collect();
        assert_eq!(ids.len(), NAMED_DATASETS.len());
        let words: Vec<_> = NAMED_DATASETS.iter().flat_map(|dataset| dataset.words).collect();
        assert_eq!(words.iter().collect::<BTreeSet<_>>().len(), words.len());
        let is_word = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit();
        assert!(words.iter().all(|word| word.chars().all(is_word)), "{words:?}");
    }

    /// Scenes of one dataset have one layout, besides chunks.
    #[test]
    fn formats_fit_together() {
        for NamedDataset { id, formats, formats_of_any_data, .. } in &NAMED_DATASETS {
            assert!(formats_of_any_data.iter().all(|format| formats.contains(format)), "{id}");
            assert!(!formats_of_any_data.contains(&Format::TorchChunks), "{id}");
            assert!(!(formats.contains(&Format::Re10k) && formats.contains(&Format::Nerfstudio)), "{id}");
        }
        assert_eq!(NamedDataset::by_id("acid").map(|dataset| dataset.name), Some("ACID"));
        assert!(NamedDataset::by_id("photos").is_none());
    }

    /// Tables would call the results of a preset on another dataset those of an unknown capture, and data of a dataset without a format
    /// would never be found.
    #[test]
    fn datasets_of_presets_indices_and_manifests_are_named() {
        let photos = "photos";
        for preset in Preset::names().map(|name| Preset::named(name).unwrap()) {
            let dataset = NamedDataset::by_id(&preset.dataset);
            assert_eq!(dataset.is_some(), preset.dataset != photos, "{}", preset.name);
            let is_on_disk = dataset.is_some_and(|dataset| !dataset.formats.is_empty());
            assert_eq!(is_on_disk, preset.stands_for.is_none() && preset.dataset != photos, "{}", preset.name);
        }
        for index in KNOWN_INDICES {
            assert!(NamedDataset::by_id(index.dataset).is_some(), "{}", index.name);
        }
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets");
        let files = folder.read_dir().unwrap().map(|entry| entry.unwrap().path());
        let manifests = files.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
        let ids: BTreeSet<String> = manifests
            .map(|path| {
                let id = path.file_stem().unwrap().to_str().unwrap().to_owned();
                let text = std::fs::read_to_string(&path).unwrap();
                assert!(text.lines().any(|line| line == format!("id = \"{id}\"")), "{id}");
                id
            })
            .collect();
        let named = NAMED_DATASETS.iter().map(|dataset| dataset.id).chain([photos]);
        assert_eq!(ids, named.map(str::to_owned).collect::<BTreeSet<_>>());
    }
}
