//! Configuration files that change another one, their `base`.

use std::ops::Range;
use std::path::{Path, PathBuf};

use atsplat_files::{malformed_toml, toml_problem};
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue, Deserializer, Error};
use toml::{Spanned, Table, Value};

use super::WHAT;
use crate::TrainError;

/// Longest chain of files, each based on the next.
const MAX_DEPTH: usize = 8;
/// Name of the whole file in messages.
pub(super) const WHOLE: &str = "a training configuration";

/// Reads a file and its chain of bases.
pub(super) fn read<T: DeserializeOwned>(path: &Path) -> Result<T, TrainError> {
    let mut chain = Chain::default();
    let table = chain.table(path)?;
    table.try_into().map_err(|error: Error| {
        let found = chain.files.iter().find_map(|file| chain.located::<T>(file, error.message()));
        found.unwrap_or_else(|| {
            let (expected, found) = toml_problem(WHOLE, &error);
            let field = field_of(&error).map_or_else(String::new, |field| format!(", field {field}"));
            TrainError::malformed(WHAT, format!("{}{field}", path.display()), expected, found)
        })
    })
}

/// The path of a table's field that has this error, without the numbers of elements.
pub(super) fn field_of(error: &Error) -> Option<String> {
    let text = error.to_string();
    let (_, field) = text.trim_end().rsplit_once("\nin `")?;
    Some(field.trim_end_matches('`').to_owned())
}

/// The files that were read, each based on the next, with their texts.
#[derive(Default)]
struct Chain {
    files: Vec<(PathBuf, String)>,
}

impl Chain {
    /// The table of a file, merged with those of its bases.
    fn table(&mut self, path: &Path) -> Result<Table, TrainError> {
        let place = || path.display().to_string();
        let text =
            atsplat_files::read_to_string(path).map_err(TrainError::io("reading a training configuration", path))?;
        let parsed = text.parse::<Table>();
        let mut table = parsed.map_err(|error| malformed_toml(WHAT, "TOML", &text, &error).in_file(path))?;
        self.files.push((path.to_owned(), text));
        let base = match table.remove("base") {
            None => return Ok(table),
            Some(Value::String(base)) => base,
            Some(other) => return Err(TrainError::malformed(WHAT, place(), "a path as `base`", other)),
        };
        if self.files.len() > MAX_DEPTH {
            let expected = format!("at most {MAX_DEPTH} files, each based on the next");
            return Err(TrainError::malformed(WHAT, place(), expected, "more"));
        }
        let mut base = self.table(&path.with_file_name(base))?;
        merge(&mut base, table);
        Ok(base)
    }

    /// An error of the merged table where it is in a file: with line, column and field. `None` if that file alone has no error, or
    /// another one, as a file that leaves fields to its base may have.
    fn located<T: DeserializeOwned>(&self, (path, text): &(PathBuf, String), message: &str) -> Option<TrainError> {
        let document = || DeTable::parse(text).ok();
        let mut without_base = document()?;
        without_base.get_mut().remove("base");
        let parsed: Result<T, Error> = serde::Deserialize::deserialize(Deserializer::from(without_base));
        let error = parsed.err().filter(|error| self.files.len() == 1 || error.message() == message)?;
        let mut malformed = malformed_toml(WHAT, WHOLE, text, &error).in_file(path);
        if let Some(field) = error.span().and_then(|span| path_of(document()?.get_ref(), &span)) {
            malformed.location = format!("{}, field {field}", malformed.location);
        }
        Some(malformed.into())
    }
}

/// The path of the field at these bytes, such as `data[0].source.rooms.scenes`.
fn path_of(table: &DeTable<'_>, span: &Range<usize>) -> Option<String> {
    table.iter().find_map(|(key, value)| {
        let name = key.get_ref();
        let below = path_below(value, span).or_else(|| (key.span() == *span).then(String::new));
        Some(format!("{name}{}", below?))
    })
}

/// What follows a field's name in the path of the innermost one at these bytes: nothing if that is the field itself.
fn path_below(value: &Spanned<DeValue<'_>>, span: &Range<usize>) -> Option<String> {
    let below = match value.get_ref() {
        DeValue::Table(table) => path_of(table, span).map(|path| format!(".{path}")),
        DeValue::Array(values) => {
            let element = |(at, value)| Some(format!("[{at}]{}", path_below(value, span)?));
            values.iter().enumerate().find_map(element)
        }
        _ => None,
    };
    below.or_else(|| (value.span() == *span).then(String::new))
}

/// Merges tables field by field; other values are replaced.
pub(super) fn merge(base: &mut Table, changes: Table) {
    for (key, change) in changes {
        match (base.get_mut(&key), change) {
            (Some(Value::Table(old)), Value::Table(new)) if !is_other_variant(old, &new) => merge(old, new),
            (_, change) => {
                base.insert(key, change);
            }
        }
    }
}

/// Whether two tables are different variants of an enum, whose fields must not be merged.
fn is_other_variant(old: &Table, new: &Table) -> bool {
    let tagged = ["kind", "rule"].into_iter().any(|tag| new.get(tag).is_some_and(|kind| old.get(tag) != Some(kind)));
    tagged || ["rooms", "dataset"].into_iter().any(|source| new.contains_key(source) && !old.contains_key(source))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "they are read, never looked at")]
    struct Run {
        steps: std::num::NonZeroU64,
        sources: Vec<Source>,
        nested: Option<Nested>,
    }

    #[derive(Debug, serde::Deserialize)]
    #[expect(dead_code, reason = "they are read, never looked at")]
    struct Nested {
        a: u8,
        b: u8,
        c: u8,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "they are read, never looked at")]
    struct Source {
        size: [u32; 2],
        share: f64,
    }

    const SOURCES: &str = "[[sources]]\nsize = [1, 2]\nshare = 1.0\n\n[[sources]]\nsize = [3, 4]\nshare = 0.5\n";

    #[test]
    fn errors_name_line_field_and_the_file_that_has_it() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        let error_of = |base: &str, derived: &str| {
            std::fs::write(place("base.toml"), base).unwrap();
            std::fs::write(place("run.toml"), format!("base = 'base.toml'\n{derived}")).unwrap();
            read::<Run>(&place("run.toml")).unwrap_err().to_string()
        };
        let whole = format!("steps = 8\n{SOURCES}");
        let other = whole.replace("size = [3, 4]", "size = [3, -4]");
        let is = |error: String, location: &str, problem: &str, file: &str| {
            let place = place(file).display().to_string();
            assert_eq!(error, format!("training configuration: {location}: expected {problem} ({place})"));
        };
        let positive = "a positive whole number, found 0";
        is(error_of(&whole, "steps = 0"), "line 2 column 9, field steps", positive, "run.toml");
        is(error_of(&whole.replace('8', "0"), ""), "line 1 column 9, field steps", positive, "base.toml");
        let number = "a whole number of at least 0, found -4";
        is(error_of(&other, "steps = 9"), "line 7 column 12, field sources[1].size[1]", number, "base.toml");
        let inline = "sources = [{ size = [1, 2], share = 1.0 }, { size = [3, 4], share = 'all' }]";
        let number = "a number, found \"all\"";
        is(error_of(&whole, inline), "line 2 column 69, field sources[1].share", number, "run.toml");
        let unknown = error_of(&whole.replace("share = 0.5", "weight = 0.5"), "steps = 9");
        let field = "line 8 column 1, field sources[1].weight: expected ";
        assert!(unknown.contains(field) && unknown.contains("found unknown field `weight`"), "{unknown}");
        let missing = error_of(&whole.replace("\nshare = 0.5", ""), "steps = 9");
        let field = "line 6 column 1, field sources[1]: expected a field `share`, found none (";
        assert!(missing.contains(field), "{missing}");
        // Neither file has this error alone.
        let both = error_of(&format!("{whole}\n[nested]\na = 1\n"), "nested.b = 2");
        let field = "run.toml, field nested: expected a field `c`, found none";
        assert!(both.ends_with(field), "{both}");
        let broken = error_of("steps = [", "");
        assert!(broken.starts_with("training configuration: line 1 column ") && !broken.contains('\n'), "{broken}");
    }

    fn merged(base: &str, changes: &str) -> Table {
        let mut base = base.parse().unwrap();
        merge(&mut base, changes.parse().unwrap());
        base
    }

    #[test]
    fn fields_are_merged_and_variants_replaced() {
        let base =
            "a = 1\nlist = [1, 2]\n[t]\nx = 1\ny = 2\n[choice]\nkind = 'p'\nonly-p = 1\n[source.rooms]\nscenes = 3";
        let same =
            |changes: &str, expected: &str| assert_eq!(merged(base, changes), expected.parse().unwrap(), "{changes}");
        same("", base);
        same("t.y = 3\nlist = [5]", &base.replace("y = 2", "y = 3").replace("[1, 2]", "[5]"));
        same("choice = { kind = 'q' }", &base.replace("'p'\nonly-p = 1", "'q'"));
        same("choice.only-p = 2", &base.replace("only-p = 1", "only-p = 2"));
        same("source.rooms.scenes = 4", &base.replace("scenes = 3", "scenes = 4"));
        same(
            "source.dataset = { path = 'x' }",
            &base.replace("[source.rooms]\nscenes = 3", "[source.dataset]\npath = 'x'"),
        );
    }
}
