use std::path::Path;

use atsplat_files::{FileError, Malformed};

use crate::overlap::OverlapEstimator;
use crate::{IndexBuilder, ProtocolError};

macro_rules! built_in {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../eval/samplers/", $name, ".toml")))),*]
    };
}

/// The rules in `eval/samplers/`, which reproduce how published indices were made.
const BUILT_IN: &[(&str, &str)] = built_in![
    "re10k-2v",
    "re10k-extrapolation",
    "dl3dv-2v",
    "dl3dv-4v",
    "dl3dv-6v",
    "dl3dv-12v",
    "dl3dv-6v-8t",
    "dl3dv-5v-360",
    "dl3dv-2v-4t",
    "dl3dv-4v-4t",
    "dl3dv-6v-4t",
    "dl3dv-12v-4t",
    "rooms-overlap",
    "photos-3v",
];

impl IndexBuilder {
    /// Names of the built-in rules, as in `eval/samplers/`.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(name, _)| *name)
    }

    /// A built-in rule by name, or the one in a TOML file if the argument ends in `.toml`.
    ///
    /// # Errors
    /// [`ProtocolError::Malformed`] for an unknown name, or with line and field for text that is not a valid rule;
    /// [`ProtocolError::Io`].
    pub fn resolve(name_or_path: &str) -> Result<Self, ProtocolError> {
        let path = Path::new(name_or_path);
        if path.extension().is_some_and(|extension| extension == "toml") {
            let text = std::fs::read_to_string(path)
                .map_err(FileError::during::<ProtocolError>("reading a sampling rule", path))?;
            return Self::from_toml(&text, name_or_path);
        }
        let (name, text) = BUILT_IN.iter().find(|(name, _)| *name == name_or_path).ok_or_else(|| {
            let known = Self::names().collect::<Vec<_>>().join(", ");
            let expected = format!("one of {known}, or a path that ends in .toml");
            Malformed::new("sampling rule", "name", expected, format!("{name_or_path:?}"))
        })?;
        Self::from_toml(text, name)
    }

    fn from_toml(text: &str, place: &str) -> Result<Self, ProtocolError> {
        let malformed = |expected: &str, found: String| Malformed::new("sampling rule", place, expected, found);
        let rule: Self = toml::from_str(text).map_err(|error| {
            let expected = "a [sampler] table and, optionally, an [overlap] table";
            malformed(expected, error.to_string().trim_end().to_owned())
        })?;
        match rule.overlap.map(|overlap| overlap.estimator).filter(OverlapEstimator::needs_depth) {
            Some(estimator) => Err(malformed(
                "an overlap estimator that needs no depth maps, because an index is built without them",
                estimator.name().to_owned(),
            )
            .into()),
            None => Ok(rule),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_built_in_rule_is_valid() {
        for name in IndexBuilder::names() {
            let rule = IndexBuilder::resolve(name);
            assert!(rule.is_ok(), "{name}: {}", rule.unwrap_err());
        }
    }

    #[test]
    fn reads_a_user_rule_and_rejects_invalid_ones() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        std::fs::write(&path, "[sampler]\nsampler = \"all-frames\"\n").unwrap();
        assert_eq!(IndexBuilder::resolve(path.to_str().unwrap()).unwrap().sampler.name(), "all-frames");
        std::fs::write(&path, "[sampler]\nsampler = \"guess\"\n").unwrap();
        let broken = IndexBuilder::resolve(path.to_str().unwrap()).unwrap_err().to_string();
        assert!(broken.contains("guess") && broken.contains("farthest-point"), "{broken}");
        let depth = "[sampler]\nsampler = \"all-frames\"\n[overlap.estimator]\nestimator = \"depth-covisibility\"\n";
        std::fs::write(&path, depth).unwrap();
        let depth = IndexBuilder::resolve(path.to_str().unwrap()).unwrap_err().to_string();
        assert!(depth.contains("no depth maps"), "{depth}");
        let unknown = IndexBuilder::resolve("re10k").unwrap_err().to_string();
        assert!(unknown.contains("re10k-2v"), "the names are listed: {unknown}");
    }
}
