//! The files of a results store, and which objects stand for them.

use crate::storage::Object;

/// Says which process writes. The one that wrote it last may write; one before it finds that out and stops.
pub(crate) const WRITER: &str = "writer.txt";
/// Files of a store that have no meaning on another machine.
const LOCAL: [&str; 3] = ["run.lock", "run.json", "digests.txt"];
/// The records, without which a folder is not a store.
pub(crate) const RECORDS: &str = "provenance.json";
/// The field of the records with the SHA-256 of each table.
const HASHES: &str = "tables-sha256";
/// The table of times: those of a row are removed before another row takes its place.
pub(crate) const TIMES: &str = "timings.parquet";
/// The folder of rows that are not in the tables yet.
pub(crate) const PARTS: &str = "parts/";
/// The tables of rows, in the order in which they must arrive.
const TABLES: [&str; 2] = ["targets.parquet", "trials.parquet"];
/// The folder of tables that replace those of the store. Its name comes after theirs, so that a list of several pages that shows
/// a new table of the store was not too early to show these.
pub(crate) const UPDATE: &str = "update/";
/// The table whose arrival makes those in [`UPDATE`] the store's.
pub(crate) const UPDATED: &str = "update/trials.parquet";
/// Folders of a store, which may be empty objects in object storage.
const FOLDERS: [&str; 3] = [PARTS, "images/", UPDATE];

/// The objects of a list that stand for files.
pub(crate) fn files(all: &[Object]) -> Vec<Object> {
    let is_updated = all.iter().any(|object| object.name == UPDATED);
    let counts = |name: &str| !is_table(name) || name.starts_with(UPDATE) == is_updated;
    all.iter().filter(|object| counts(&object.name) && !is_folder(object, all)).cloned().collect()
}

/// Whether an object stands for a folder: some tools write an empty one for each. The list is sorted by name.
pub(crate) fn is_folder(object: &Object, all: &[Object]) -> bool {
    let inside = format!("{}/", object.name);
    let has_files = || {
        let first = all.partition_point(|other| other.name < inside);
        all.get(first).is_some_and(|other| other.name.starts_with(&inside))
    };
    object.bytes == 0 && (FOLDERS.contains(&inside.as_str()) || has_files())
}

/// The name of the file that an object stands for.
pub(crate) fn file_name(object: &str) -> &str {
    object.strip_prefix(UPDATE).filter(|table| TABLES.contains(table)).unwrap_or(object)
}

pub(crate) fn is_table(name: &str) -> bool {
    TABLES.contains(&file_name(name))
}

pub(crate) fn holds_rows(name: &str) -> bool {
    name.starts_with(PARTS) || is_table(name)
}

/// Records without the hashes of tables; `None` if they state none, or are no records.
pub(crate) fn without_hashes(records: &[u8]) -> Option<Vec<u8>> {
    let mut records: serde_json::Value = serde_json::from_slice(records).ok()?;
    records.as_object_mut()?.remove(HASHES)?;
    serde_json::to_vec_pretty(&records).ok()
}

pub(crate) fn is_shared(name: &str) -> bool {
    let is_partial = name.rsplit('.').next() == Some(atsplat_files::PARTIAL);
    !is_partial && name != WRITER && !LOCAL.contains(&name)
}

/// Files of a later round are sent when those of the earlier ones have arrived, so that a store that is read or resumed
/// meanwhile lacks nothing, and no row has the times or images of the one before it.
pub(crate) fn round(name: &str) -> usize {
    match name {
        RECORDS => 0,
        TIMES => 1,
        _ if name.starts_with(PARTS) => 3,
        _ => TABLES.iter().position(|table| *table == file_name(name)).map_or(2, |position| 4 + position),
    }
}
