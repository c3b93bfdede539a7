use std::path::Path;

/// Texts embedded in the binary, each with its name.
#[derive(Clone, Copy, Debug)]
pub struct Embedded(pub &'static [(&'static str, &'static str)]);

impl Embedded {
    /// The names, in their order.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        self.0.iter().map(|(name, _)| *name)
    }

    /// The text of this name; `None` for other names.
    pub fn text(self, name: &str) -> Option<&'static str> {
        self.0.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
    }
}

/// Whether an argument that may be a name or the path of a TOML file is a path: whether it ends in `.toml`.
pub fn is_toml_path(name_or_path: impl AsRef<Path>) -> bool {
    name_or_path.as_ref().extension().is_some_and(|extension| extension == "toml")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_found_by_their_whole_names() {
        let embedded = Embedded(&[("re10k", "first"), ("re10k-2v", "second")]);
        assert_eq!(embedded.names().collect::<Vec<_>>(), ["re10k", "re10k-2v"]);
        let texts = ["re10k-2v", "re10k", "re10"].map(|name| embedded.text(name));
        assert_eq!(texts, [Some("second"), Some("first"), None]);
    }

    #[test]
    fn paths_end_in_toml() {
        assert_eq!(["a.toml", "b/a.toml", "a", "toml", "a.json"].map(is_toml_path), [true, true, false, false, false]);
    }
}
