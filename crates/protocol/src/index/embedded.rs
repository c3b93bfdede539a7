use atsplat_files::Embedded;

use super::IndexFile;
use crate::ProtocolError;

macro_rules! texts {
    ($($name:literal),* $(,)?) => {
        Embedded(&[$(($name, include_str!(concat!("../../../../eval/indices/", $name, ".json")))),*])
    };
}

/// The JSON texts of the indices of simulated datasets, in `eval/indices/`.
const TEXTS: Embedded = texts![
    "rooms-2v",
    "rooms-2v-200",
    "rooms-overlap",
    "rooms-extrapolation",
    "yards-2v",
    "yards-4v",
    "yards-6v",
    "yards-12v",
    "yards-6v-extrapolation",
];

impl IndexFile {
    /// An index embedded in the binary, by the name under which presets accept it; `None` for other names.
    ///
    /// # Errors
    /// Those of [`Self::parse`]; the embedded files cause none.
    pub fn embedded(name: &str) -> Option<Result<Self, ProtocolError>> {
        TEXTS.text(name).map(|text| Self::parse(text.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::{IndexMatch, Preset};

    #[test]
    fn presets_of_simulated_scenes_match_the_embedded_indices() {
        let mut used = BTreeSet::new();
        for preset in Preset::names().map(|name| Preset::named(name).unwrap()) {
            let Some(accepted) = preset.index.accepted.first() else { continue };
            let Some(file) = IndexFile::embedded(&accepted.name) else { continue };
            let file = file.unwrap();
            let name = &*preset.name;
            assert_eq!(preset.index.recognise(&file), IndexMatch::Default { name: &accepted.name }, "{name}");
            assert_eq!(file.index.scenes.len() as u64, preset.index.scenes, "{name}");
            let (fewest, most) = preset.index.targets;
            for (key, _, entry) in file.index.entries() {
                assert!(key.starts_with(&format!("{}-test-", preset.dataset)), "{name}: {key} is not a test scene");
                assert_eq!(entry.context.len(), preset.index.context_views, "{name}");
                assert!((fewest..=most).contains(&entry.target.len()), "{name}");
                assert_eq!(entry.overlap.is_some(), preset.overlap_bins.is_some(), "{name}");
            }
            used.insert(accepted.name.clone());
        }
        assert_eq!(used, TEXTS.names().map(str::to_owned).collect(), "every embedded index is used");
    }
}
