use serde_json::{Value, json};

use crate::table::{Table, verdict};

/// Version of the JSON that tables are written as.
const VERSION: u32 = 1;

/// The table with its verdict.
pub fn json_of(table: &Table) -> Value {
    json!({ "version": VERSION, "table": table, "verdict": verdict(table) })
}
