//! Which weights a reproduction uses for which protocol, table and variant: one file for all, or a TOML file that lists them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use atsplat_files::{Malformed, malformed_toml};
use atsplat_protocol::Preset;
use serde::Deserialize;

use crate::EvalError;

/// What messages call it.
const WHAT: &str = "weights list";

/// Weights by protocol, table and variant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WeightsList {
    entries: Vec<Entry>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Entry {
    file: PathBuf,
    /// The protocols that it is for; `None` for all.
    presets: Option<BTreeSet<String>>,
    variant: Option<String>,
    names_preset: bool,
    names_table: bool,
}

/// How specific an entry is for a protocol: of several that fit, the one with the highest is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Specificity {
    Any,
    Table,
    /// It names the protocol that this one imitates, with or without its table.
    Imitated {
        names_table: bool,
    },
    /// It names this protocol, with or without its table.
    Own {
        names_table: bool,
    },
}

/// The file: `[[weights]]` entries.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct ListToml {
    weights: Vec<EntryToml>,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct EntryToml {
    file: PathBuf,
    preset: Option<String>,
    table: Option<String>,
    variant: Option<String>,
}

impl WeightsList {
    /// The same weights for everything.
    pub fn one(file: PathBuf) -> Self {
        Self { entries: vec![Entry { file, presets: None, variant: None, names_preset: false, names_table: false }] }
    }

    /// Reads a list.
    ///
    /// # Errors
    /// [`EvalError::Io`], and those of [`Self::from_toml`].
    pub fn read(path: &Path, tables: &BTreeMap<String, Vec<String>>, embedded: &[&str]) -> Result<Self, EvalError> {
        let text = atsplat_files::read_to_string(path).map_err(EvalError::io("reading a list of weights", path))?;
        Self::from_toml(&text, path, tables, embedded)
    }

    /// A list from the text of the file at `path`. `tables` are the protocols of each table by its name. Paths are relative to the
    /// list's folder, except for names of weights in `embedded`.
    ///
    /// # Errors
    /// [`EvalError::Malformed`] with the entry and the field, for text that is not a list, unknown presets and tables, conditions
    /// that no protocol meets, and two entries for the same protocols and variant.
    pub fn from_toml(
        text: &str,
        path: &Path,
        tables: &BTreeMap<String, Vec<String>>,
        embedded: &[&str],
    ) -> Result<Self, EvalError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::parse(text, folder, tables, embedded).map_err(|error| error.in_file(path).into())
    }

    fn parse(
        text: &str,
        folder: &Path,
        tables: &BTreeMap<String, Vec<String>>,
        embedded: &[&str],
    ) -> Result<Self, Malformed> {
        let whole = "[[weights]] entries with file, preset, table, variant";
        let list: ListToml = toml::from_str(text).map_err(|error| malformed_toml(WHAT, whole, text, &error))?;
        let mut entries: Vec<Entry> = Vec::new();
        for (at, stated) in list.weights.into_iter().enumerate() {
            let malformed = |WrongField { field, expected, found }: WrongField| {
                Malformed::new(WHAT, format!("weights entry {}, {field}", at + 1), expected, format!("{found:?}"))
            };
            let entry = Entry::of(stated, folder, tables, embedded).map_err(malformed)?;
            if let Some(first) = entries.iter().position(|known| known.has_conditions_of(&entry)) {
                let expected = "one entry for each protocol and variant".to_owned();
                let found = format!("the same as entry {}", first + 1);
                return Err(malformed(WrongField { field: "file", expected, found }));
            }
            entries.push(entry);
        }
        if entries.is_empty() {
            return Err(Malformed::new(WHAT, "weights", "at least one entry", "none"));
        }
        Ok(Self { entries })
    }

    /// The weights of ATSplat under a protocol: those of the most specific entry, of several the first. `None` if no
    /// entry fits.
    pub fn network(&self, preset: &Preset) -> Option<&Path> {
        self.best(preset, None)
    }

    /// The variants with separate weights under a protocol, in alphabetical order.
    pub fn variants(&self, preset: &Preset) -> Vec<(&str, &Path)> {
        let names: BTreeSet<&str> = self.entries.iter().filter_map(|entry| entry.variant.as_deref()).collect();
        names.into_iter().filter_map(|name| Some((name, self.best(preset, Some(name))?))).collect()
    }

    fn best(&self, preset: &Preset, variant: Option<&str>) -> Option<&Path> {
        let mut found: Option<(Specificity, &Entry)> = None;
        for entry in self.entries.iter().filter(|entry| entry.variant.as_deref() == variant) {
            let Some(specificity) = entry.specificity(preset) else { continue };
            if found.is_none_or(|(best, _)| specificity > best) {
                found = Some((specificity, entry));
            }
        }
        found.map(|(_, entry)| entry.file.as_path())
    }
}

/// A field of an entry with another value than expected.
struct WrongField {
    field: &'static str,
    expected: String,
    found: String,
}

impl Entry {
    fn of(
        stated: EntryToml,
        folder: &Path,
        tables: &BTreeMap<String, Vec<String>>,
        embedded: &[&str],
    ) -> Result<Self, WrongField> {
        let presets = presets_of(&stated, tables)?;
        let EntryToml { file, preset, table, variant } = stated;
        if let Some(found) = variant.clone().filter(|variant| !is_plain(variant)) {
            let expected = "lower-case letters, digits and hyphens".to_owned();
            return Err(WrongField { field: "variant", expected, found });
        }
        let is_embedded = file.to_str().is_some_and(|name| embedded.contains(&name));
        let file = if is_embedded { file } else { folder.join(file) };
        Ok(Self { file, presets, variant, names_preset: preset.is_some(), names_table: table.is_some() })
    }

    /// How specific it is for a protocol; `None` if it is not for it.
    fn specificity(&self, preset: &Preset) -> Option<Specificity> {
        let Some(presets) = &self.presets else { return Some(Specificity::Any) };
        let is_own = presets.contains(&preset.name);
        if !is_own && !preset.stands_for.as_ref().is_some_and(|published| presets.contains(published)) {
            return None;
        }
        let names_table = self.names_table;
        Some(match (self.names_preset, is_own) {
            (false, _) => Specificity::Table,
            (true, false) => Specificity::Imitated { names_table },
            (true, true) => Specificity::Own { names_table },
        })
    }

    /// Whether both are for the same protocols and variant, named in the same way.
    fn has_conditions_of(&self, other: &Self) -> bool {
        let Self { file: _, presets, variant, names_preset, names_table } = self;
        (presets, variant, names_preset, names_table)
            == (&other.presets, &other.variant, &other.names_preset, &other.names_table)
    }
}

/// The protocols that an entry is for; `None` for all.
fn presets_of(
    EntryToml { preset, table, .. }: &EntryToml,
    tables: &BTreeMap<String, Vec<String>>,
) -> Result<Option<BTreeSet<String>>, WrongField> {
    let wrong = |field, expected, found: &str| WrongField { field, expected, found: found.to_owned() };
    if let Some(preset) = preset.as_ref().filter(|preset| Preset::named(preset).is_err()) {
        let known = Preset::names().collect::<Vec<_>>().join(", ");
        return Err(wrong("preset", format!("one of {known}"), preset));
    }
    let of_table = match table {
        None => None,
        Some(table) => Some(tables.get(table).ok_or_else(|| {
            let known = tables.keys().cloned().collect::<Vec<_>>().join(", ");
            wrong("table", format!("one of {known}"), table)
        })?),
    };
    match (preset, of_table) {
        (None, None) => Ok(None),
        (None, Some(table)) => Ok(Some(table.iter().cloned().collect())),
        (Some(preset), Some(table)) if !is_of_table(preset, table) => {
            Err(wrong("preset", format!("a protocol of the table: {}", table.join(", ")), preset))
        }
        (Some(preset), _) => Ok(Some([preset.clone()].into())),
    }
}

/// Whether a table has this protocol, or the one that it represents.
fn is_of_table(preset: &str, table: &[String]) -> bool {
    let published = Preset::named(preset).ok().and_then(|preset| preset.stands_for);
    table.iter().any(|name| name == preset || Some(name) == published.as_ref())
}

fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<WeightsList, Malformed> {
        let tables = [
            ("re10k".to_owned(), vec!["re10k-2v-256".to_owned()]),
            ("unified".to_owned(), vec!["re10k-2v-256".to_owned(), "dl3dv-2v-256x448".to_owned()]),
        ];
        WeightsList::parse(text, Path::new("runs"), &tables.into(), &["micro-rooms"])
    }

    #[test]
    fn the_most_specific_entry_counts() {
        let list = parse(
            "[[weights]]\nfile = 'micro-rooms'\n[[weights]]\nfile = 'both'\ntable = 'unified'\n\
             [[weights]]\nfile = 'dl3dv'\npreset = 'dl3dv-2v-256x448'\n\
             [[weights]]\nfile = 'joint'\ntable = 'unified'\nvariant = 'unified'\n\
             [[weights]]\nfile = 'other'\npreset = 'rooms-2v-128'\nvariant = 'random'\n",
        )
        .unwrap();
        let network = |preset: &str| list.network(&Preset::named(preset).unwrap()).unwrap().display().to_string();
        assert_eq!(network("acid-2v-256"), "micro-rooms", "an embedded name is not a path");
        assert_eq!(network("re10k-2v-256"), "runs/both");
        assert_eq!(network("dl3dv-2v-256x448"), "runs/dl3dv");
        assert_eq!(network("yards-2v-128x224"), "runs/dl3dv", "a stand-in takes the weights of its protocol");
        let variants = |preset: &str| {
            let preset = Preset::named(preset).unwrap();
            list.variants(&preset).iter().map(|(name, file)| format!("{name} {}", file.display())).collect::<Vec<_>>()
        };
        assert_eq!(variants("rooms-2v-128"), ["random runs/other", "unified runs/joint"]);
        assert_eq!(variants("re10k-2v-256"), ["unified runs/joint"], "a stand-in's entry does not apply to it");
        assert_eq!(variants("acid-2v-256"), [""; 0]);
        let same_protocols =
            "[[weights]]\nfile = 'table'\ntable = 're10k'\n[[weights]]\nfile = 'preset'\npreset = 're10k-2v-256'\n";
        let named = parse(same_protocols).unwrap();
        assert_eq!(named.network(&Preset::named("re10k-2v-256").unwrap()), Some(Path::new("runs/preset")));
        let only = parse("[[weights]]\nfile = 'a'\npreset = 'acid-2v-256'").unwrap();
        assert_eq!(only.network(&Preset::named("re10k-2v-256").unwrap()), None);
    }

    #[test]
    fn a_protocol_prefers_its_own_name_to_the_one_that_it_imitates() {
        let own = "[[weights]]\nfile = 'own'\npreset = 'rooms-2v-128'\n";
        let imitated = "[[weights]]\nfile = 'imitated'\npreset = 're10k-2v-256'\n";
        let with_table = "[[weights]]\nfile = 'with-table'\npreset = 're10k-2v-256'\ntable = 're10k'\n";
        let table = "[[weights]]\nfile = 'table'\ntable = 're10k'\n";
        let weights = |text: String| {
            let list = parse(&text).unwrap();
            let of = |preset: &str| list.network(&Preset::named(preset).unwrap()).map(Path::to_owned);
            ["rooms-2v-128", "re10k-2v-256"].map(|preset| of(preset).map(|path| path.display().to_string()))
        };
        let expected = |rooms: &str, published: &str| [rooms, published].map(|name| Some(format!("runs/{name}")));
        for (first, second, found) in [
            (own, imitated, expected("own", "imitated")),
            (own, with_table, expected("own", "with-table")),
            (imitated, with_table, expected("with-table", "with-table")),
            (imitated, table, expected("imitated", "imitated")),
            (own, table, expected("own", "table")),
        ] {
            assert_eq!(weights(format!("{first}{second}")), found, "{first}{second}");
            assert_eq!(weights(format!("{second}{first}")), found, "{second}{first}");
        }
    }

    #[test]
    fn errors_name_the_entry_and_its_field() {
        let entry = |text: &str| format!("[[weights]]\nfile = 'a'\n[[weights]]\nfile = 'b'\n{text}\n");
        for (text, location, found) in [
            ("weights = 3".to_owned(), "line 1 column 11", "3"),
            (String::new(), "line 1 column 1", "none"),
            ("weights = []".to_owned(), "weights", "none"),
            (entry("preset = 're20k'"), "weights entry 2, preset", "re20k"),
            (entry("table = 'unify'"), "weights entry 2, table", "unify"),
            (entry("table = 're10k'\npreset = 'acid-2v-256'"), "weights entry 2, preset", "acid-2v-256"),
            (entry("variant = 'No expansion'"), "weights entry 2, variant", "No expansion"),
            (entry("weight = 'c'"), "line 5 column 1", "weight"),
            (entry(""), "weights entry 2, file", "the same as entry 1"),
        ] {
            let error = parse(&text).unwrap_err();
            assert!(error.location == location && error.found.contains(found), "{text}: {error}");
        }
    }

    #[test]
    fn errors_name_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("weights.toml");
        std::fs::write(&list, "[[weights]]\nfile = 'a'\ntable = 're20k'\n").unwrap();
        let error = WeightsList::read(&list, &BTreeMap::new(), &[]).unwrap_err().to_string();
        assert!(error.contains("weights entry 1, table: expected one of") && error.contains("weights.toml"), "{error}");
        let error = WeightsList::read(Path::new("no/list.toml"), &BTreeMap::new(), &[]).unwrap_err().to_string();
        assert!(error.contains("reading a list of weights") && error.contains("no/list.toml"), "{error}");
    }
}
