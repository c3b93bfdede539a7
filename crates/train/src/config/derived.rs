//! Configuration files that change another one, their `base`.

use std::path::Path;

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::WHAT;
use crate::TrainError;

/// Longest chain of files, each based on the next.
const MAX_DEPTH: usize = 8;

/// Reads a file and its chain of bases.
pub(super) fn read<T: DeserializeOwned>(path: &Path) -> Result<T, TrainError> {
    let table = table(path, MAX_DEPTH)?;
    let place = path.display().to_string();
    let malformed = |error| TrainError::malformed(WHAT, place, "a training configuration", field_first(&error));
    table.try_into().map_err(malformed)
}

/// The message of a table's error with the field in front, where it is never cut off.
pub(super) fn field_first(error: &toml::de::Error) -> String {
    let text = error.to_string();
    match text.trim_end().rsplit_once("\nin ") {
        Some((message, field)) => format!("in {field}: {message}"),
        None => text.trim_end().to_owned(),
    }
}

fn table(path: &Path, depth: usize) -> Result<Table, TrainError> {
    let place = || path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(TrainError::io("reading a training configuration", path))?;
    let mut table: Table =
        text.parse().map_err(|error: toml::de::Error| TrainError::malformed(WHAT, place(), "TOML", error))?;
    let base = match table.remove("base") {
        None => return Ok(table),
        Some(Value::String(base)) => base,
        Some(other) => return Err(TrainError::malformed(WHAT, place(), "a path as `base`", other)),
    };
    let Some(depth) = depth.checked_sub(1) else {
        let expected = format!("at most {MAX_DEPTH} files, each based on the next");
        return Err(TrainError::malformed(WHAT, place(), expected, "more"));
    };
    let mut base = self::table(&path.with_file_name(base), depth)?;
    merge(&mut base, table);
    Ok(base)
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
