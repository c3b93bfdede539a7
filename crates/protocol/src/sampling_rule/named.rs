use std::path::Path;

use atsplat_files::{Embedded, FileError, Malformed, is_toml_path, malformed_toml};

use super::checks::{Check, first_violation};
use crate::{ProtocolError, SamplingRule};

/// Name of the format in errors.
const WHAT: &str = "sampling rule";

macro_rules! texts {
    ($($name:literal),* $(,)?) => {
        Embedded(&[$(($name, include_str!(concat!("../../../../eval/samplers/", $name, ".toml")))),*])
    };
}

/// The TOML texts of the sampling rules in `eval/samplers/`, which reproduce how published indices were made.
const TEXTS: Embedded = texts![
    "re10k-2v",
    "re10k-extrapolation",
    "dl3dv-2v",
    "dl3dv-4v",
    "dl3dv-6v",
    "dl3dv-12v",
    "dl3dv-6v-8t",
    "dl3dv-5v-360",
    "dl3dv-32v-every-8th",
    "dl3dv-2v-4t",
    "dl3dv-4v-4t",
    "dl3dv-6v-4t",
    "dl3dv-12v-4t",
    "rooms-overlap",
    "photos-3v",
];

impl SamplingRule {
    /// Names of the built-in sampling rules, as in `eval/samplers/`.
    pub fn names() -> impl Iterator<Item = &'static str> {
        TEXTS.names()
    }

    /// A built-in sampling rule by name, or the one in a TOML file if the argument ends in `.toml`.
    ///
    /// # Errors
    /// [`ProtocolError::Malformed`] for an unknown name, or with line and field for text that is not a valid rule;
    /// [`ProtocolError::Io`].
    pub fn resolve(name_or_path: &str) -> Result<Self, ProtocolError> {
        if is_toml_path(name_or_path) {
            let path = Path::new(name_or_path);
            let text = atsplat_files::read_to_string(path)
                .map_err(FileError::during::<ProtocolError>("reading a sampling rule", path))?;
            return Self::from_toml(&text, name_or_path);
        }
        let text = TEXTS.text(name_or_path).ok_or_else(|| {
            let known = Self::names().collect::<Vec<_>>().join(", ");
            let expected = format!("one of {known}, or a path that ends in .toml");
            Malformed::new(WHAT, "name", expected, format!("{name_or_path:?}"))
        })?;
        Self::from_toml(text, name_or_path)
    }

    fn from_toml(text: &str, place: &str) -> Result<Self, ProtocolError> {
        let rule: Self = toml::from_str(text).map_err(|error| {
            let whole = "a [sampler] table and, optionally, an [overlap] table";
            malformed_toml(WHAT, whole, text, &error).in_file(place)
        })?;
        let malformed = |expected: &str, found: &str| Err(Malformed::new(WHAT, place, expected, found).into());
        if let Some(overlap) = rule.overlap.filter(|overlap| overlap.estimator.needs_depth()) {
            let expected = "an overlap estimator that needs no depth maps, because an index is built without them";
            return malformed(expected, overlap.estimator.name());
        }
        match first_violation(&rule) {
            Some(Check { field, expected, found, .. }) => malformed(&format!("{field}: {expected}"), &found),
            None => Ok(rule),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_built_in_rule_is_valid() {
        for name in SamplingRule::names() {
            let rule = SamplingRule::resolve(name);
            assert!(rule.is_ok(), "{name}: {}", rule.unwrap_err());
        }
    }

    #[test]
    fn reads_a_user_rule_and_rejects_invalid_ones() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        std::fs::write(&path, "[sampler]\nsampler = \"all-frames\"\n").unwrap();
        assert_eq!(SamplingRule::resolve(path.to_str().unwrap()).unwrap().sampler.name(), "all-frames");
        std::fs::write(&path, "[sampler]\nsampler = \"guess\"\n").unwrap();
        let broken = SamplingRule::resolve(path.to_str().unwrap()).unwrap_err().to_string();
        assert!(broken.contains("guess") && broken.contains("farthest-point"), "{broken}");
        let depth = "[sampler]\nsampler = \"all-frames\"\n[overlap.estimator]\nestimator = \"depth-covisibility\"\n";
        std::fs::write(&path, depth).unwrap();
        let depth = SamplingRule::resolve(path.to_str().unwrap()).unwrap_err().to_string();
        assert!(depth.contains("no depth maps"), "{depth}");
        let bounded = "[sampler]\nsampler = \"bounded\"\ncontext-views = 2\ntarget-views = 3\nseed = 1\ngaps = { min = 4, max = 9 }\n";
        let pairs = "[sampler]\nsampler = \"overlap-pairs\"\nseed = 1\ntargets = { side = \"inside\", count = 3 }\n";
        let farthest = "[sampler]\nsampler = \"farthest-point\"\nwindow = 9\ncontext-views = 6\ntargets = { rule = \"sampled\", count = 3, seed = 1, allow-context = false }\n";
        let with_overlap =
            |bounds: &str| format!("{bounded}[overlap]\nestimator.estimator = \"epipolar-ray\"\n{bounds}");
        let bounds = with_overlap("minimum = 0.2\nmaximum = 0.2");
        let every = "[sampler]\nsampler = \"every-nth\"\nevery = 2\ncontext-views = 3\n";
        let repeated = bounded.replace("target-views = 3", "target-views = 11\nrepeat-targets = true");
        for valid in [bounded.to_owned(), repeated, pairs.to_owned(), farthest.to_owned(), every.to_owned(), bounds] {
            std::fs::write(&path, &valid).unwrap();
            let rule = SamplingRule::resolve(path.to_str().unwrap());
            assert!(rule.is_ok(), "{valid}: {}", rule.unwrap_err());
        }
        for (text, expected) in [
            (
                every.replace("every = 2", "every = 1"),
                "every: at least 2, so that not every frame is a target, found 1",
            ),
            (format!("{bounded}wndow = 3\n"), "line 7 column 1: expected one of"),
            (bounded.replace("max = 9", "mx = 9"), "line 6 column 19: expected one of"),
            (bounded.replace("views = 2", "views = 1"), "context-views"),
            (bounded.replace("max = 9", "max = 3"), "4 and 3"),
            (bounded.replace("context-views = 2", "context-views = 12"), "found 9, where 11 are needed"),
            (format!("{bounded}min-distance-to-context = 4\n"), "found 9, where 10 are needed"),
            (bounded.replace("target-views = 3", "target-views = 11"), "found 9, where 10 are needed"),
            (bounded.replace("max = 9", "max = 9, initial-min = 8, initial-max = 7"), "8 and 7"),
            (
                bounded.replace("max = 9", "max = 9, initial-min = 6, initial-max = 7, warm-up-steps = 100"),
                "initial-min and min: a bound that does not fall during the warm-up, found 6 and 4",
            ),
            (
                bounded.replace("max = 9", "max = 9, initial-min = 4, initial-max = 12, warm-up-steps = 100"),
                "found 12 and 9",
            ),
            (farthest.replace("window = 9", "window = 8"), "window: a window with room for the context views"),
            (farthest.replace("false", "true").replace("window = 9", "window = 5"), "found 5, where 6 are needed"),
            (format!("{pairs}min-overlap = 0.9\nmax-overlap = 0.1\n"), "0.9 and 0.1"),
            (format!("{pairs}max-distance = 10\n"), "45 and 10"),
            (format!("{pairs}overlap.crop = {{ width = 256, height = 0 }}\n"), "overlap, crop: at least one pixel"),
            (with_overlap("minimum = 0.6\nmaximum = 0.5"), "0.6 and 0.5"),
            (with_overlap("maximum = nan"), "0 and NaN"),
            (with_overlap("maximum = 60"), "0 and 60"),
        ] {
            std::fs::write(&path, &text).unwrap();
            let broken = SamplingRule::resolve(path.to_str().unwrap()).unwrap_err().to_string();
            assert!(broken.contains(expected), "{text}: {broken}");
        }
        let unknown = SamplingRule::resolve("re10k").unwrap_err().to_string();
        assert!(unknown.contains("re10k-2v"), "the names are listed: {unknown}");
    }
}
