//! Key maps: TOML files that map the tensor names of other checkpoints to parameter names.
//!
//! ```toml
//! name = "example"
//! roots = ["state_dict.", "model."]        # prefixes that are removed from names, as long as one matches
//! ignore = ["mask_token"]                  # names that are not needed
//!
//! [[rules]]                                # the first rule whose pattern matches applies
//! from = "layer.*.attention.query.*"       # `*`: one or more characters without a dot; `**`: any
//! to = "blocks.{1}.attn.qkv.{2}"           # `{1}`: what the first wildcard matched
//! part = [0, 3]                            # becomes part 0 of 3, joined along the first dimension
//!
//! [[rules]]
//! from = "head.qkv.weight"
//! split = ["head.query.weight", "head.key.weight", "head.value.weight"]
//!
//! [[rules]]
//! from = "proj.kernel"
//! to = "proj.weight"
//! transpose = true                         # `[inputs, outputs]` becomes `[outputs, inputs]`
//! ```
//!
//! Every rule is invertible; weights are exported by the inverse.

mod apply;
mod export;
mod pattern;

use std::path::Path;

use atsplat_files::{Embedded, is_toml_path, malformed_toml};
use serde::Deserialize;

use crate::ModelError;
use pattern::Pattern;

const WHAT: &str = "key map";

macro_rules! texts {
    ($($name:literal),* $(,)?) => {
        Embedded(&[$(($name, include_str!(concat!("../../../key-maps/", $name, ".toml")))),*])
    };
}

/// The TOML texts of the maps in `key-maps/`.
const TEXTS: Embedded = texts!["identity", "dinov2-official", "dinov2-hugging-face"];

/// A map from a file's tensor names to parameter names.
#[derive(Clone, Debug)]
pub struct KeyMap {
    /// Name of the map, for reports.
    pub name: String,
    roots: Vec<String>,
    ignore: Vec<Pattern>,
    rules: Vec<Rule>,
}

#[derive(Clone, Debug)]
struct Rule {
    from: Pattern,
    targets: Vec<Pattern>,
    /// Index and number of parts, if several sources are joined.
    part: Option<(usize, usize)>,
    transpose: bool,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Text {
    name: String,
    #[serde(default)]
    roots: Vec<String>,
    #[serde(default)]
    ignore: Vec<String>,
    #[serde(default)]
    rules: Vec<RuleText>,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RuleText {
    from: String,
    to: Option<String>,
    split: Option<Vec<String>>,
    part: Option<(usize, usize)>,
    #[serde(default)]
    transpose: bool,
}

impl KeyMap {
    /// Names of the built-in maps.
    pub fn names() -> impl Iterator<Item = &'static str> {
        TEXTS.names()
    }

    /// A built-in map, or the one in a TOML file: a name that ends in `.toml` is a path.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] for an unknown name, and as [`Self::from_toml`].
    pub fn resolve(name_or_path: &str) -> Result<Self, ModelError> {
        if is_toml_path(name_or_path) {
            let path = Path::new(name_or_path);
            let text = atsplat_files::read_to_string(path).map_err(ModelError::io("reading a key map", path))?;
            return Self::from_toml(&text).map_err(|error| error.in_file(path));
        }
        let text = TEXTS.text(name_or_path).ok_or_else(|| {
            let known: Vec<&str> = Self::names().collect();
            let expected = format!("one of {}, or a path that ends in .toml", known.join(", "));
            ModelError::malformed(WHAT, "name", expected, format!("{name_or_path:?}"))
        })?;
        Self::from_toml(text)
    }

    /// The map that keeps all names.
    pub fn identity() -> Self {
        Self { name: "identity".to_owned(), roots: Vec::new(), ignore: Vec::new(), rules: Vec::new() }
    }

    /// Reads a map from TOML text.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] with line and column if the text is not a key map, with the rule for invalid patterns.
    pub fn from_toml(text: &str) -> Result<Self, ModelError> {
        let text: Text = toml::from_str(text).map_err(|error| malformed_toml(WHAT, WHAT, text, &error))?;
        let ignore = text.ignore.iter().enumerate().map(|(position, pattern)| {
            Pattern::source(pattern)
                .map_err(|found| ModelError::malformed(WHAT, format!("ignore[{position}]"), "a pattern", found))
        });
        let rules = text.rules.iter().enumerate().map(|(position, rule)| {
            Rule::new(rule)
                .map_err(|found| ModelError::malformed(WHAT, format!("rules[{position}]"), "an invertible rule", found))
        });
        Ok(Self {
            ignore: ignore.collect::<Result<_, _>>()?,
            rules: rules.collect::<Result<_, _>>()?,
            name: text.name,
            roots: text.roots,
        })
    }
}

impl Rule {
    fn new(text: &RuleText) -> Result<Self, String> {
        let from = Pattern::source(&text.from)?;
        let targets = match (&text.to, &text.split) {
            (Some(to), None) => std::slice::from_ref(to),
            (None, Some(split)) if split.len() > 1 => split.as_slice(),
            (None, Some(_)) => return Err("a split into fewer than two".to_owned()),
            _ => return Err("neither or both of `to` and `split`".to_owned()),
        };
        if let Some((part, count)) = text.part
            && (part >= count || text.split.is_some())
        {
            let with_split = if text.split.is_some() { " together with a split" } else { "" };
            return Err(format!("part {part} of {count}{with_split}"));
        }
        let targets = targets.iter().map(|target| Pattern::target(target, &from)).collect::<Result<_, _>>()?;
        Ok(Self { from, targets, part: text.part, transpose: text.transpose })
    }
}

#[cfg(test)]
mod tests;
