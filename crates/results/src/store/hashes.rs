//! The SHA-256 of a store's tables, which its records state: a table in which a bit has flipped may be one of other numbers.

use std::collections::BTreeMap;
use std::path::Path;

use atsplat_files::{Sha256Digest, name_of};
use serde::{Deserialize, Serialize};

use super::{PROVENANCE, TABLES, disk};
use crate::ResultsError;

/// The field of the records in which they are.
pub(super) const FIELD: &str = "tables-sha256";

/// What to do about a table that is not as it was written: its rows are in no other file.
pub(super) const ADVICE: &str = "restore the file from a copy, or remove the store and run again";

/// The name of a table's file, and its new content; `None` if it is removed.
pub(super) type NewTable = (&'static str, Option<Vec<u8>>);

/// SHA-256 of tables by the names of their files. There is none of a table that is just being replaced, and in stores of older versions.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct TableHashes(BTreeMap<String, Sha256Digest>);

impl TableHashes {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Rejects a table other than the stated one; `None` stands for no file.
    pub(super) fn check(&self, path: &Path, bytes: Option<&[u8]>) -> Result<(), ResultsError> {
        let Some(stated) = self.0.get(&name_of(path)) else { return Ok(()) };
        let found = match bytes.map(Sha256Digest::of) {
            Some(found) if found == *stated => return Ok(()),
            Some(found) => format!("{found}: it was damaged or changed after it was written"),
            None => "no file".to_owned(),
        };
        let expected = format!("a table with the SHA-256 {stated}, as {PROVENANCE} states ({ADVICE})");
        Err(ResultsError::malformed(path, "file", expected, found))
    }

    /// Takes the tables that are there and have none as they are.
    pub(super) fn add_missing(&mut self, folder: &Path) -> Result<(), ResultsError> {
        for name in TABLES {
            if !self.0.contains_key(name)
                && let Some(bytes) = disk::read(&folder.join(name))?
            {
                self.0.insert(name.to_owned(), Sha256Digest::of(&bytes));
            }
        }
        Ok(())
    }

    pub(super) fn forget(&mut self, tables: &[NewTable]) {
        for (name, _) in tables {
            self.0.remove(*name);
        }
    }

    /// Writes or removes tables, and takes over what they are now.
    pub(super) fn write(&mut self, folder: &Path, tables: &[NewTable]) -> Result<(), ResultsError> {
        for (name, content) in tables {
            let path = folder.join(name);
            if let Some(bytes) = content {
                disk::write(&path, bytes)?;
                self.0.insert((*name).to_owned(), Sha256Digest::of(bytes));
            } else {
                disk::remove(&path)?;
                self.0.remove(*name);
            }
        }
        Ok(())
    }
}
