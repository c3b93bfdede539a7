use std::collections::BTreeMap;

use super::TimingRow;
use crate::EvalError;

/// Rows of several stores as one, in the order of keys, machines and passes. Times differ from machine to machine and from
/// pass to pass: only rows of one trial, machine and pass must be the same.
///
/// # Errors
/// [`EvalError::Disagreement`].
pub(crate) fn merged(rows: impl IntoIterator<Item = TimingRow>) -> Result<Vec<TimingRow>, EvalError> {
    let mut merged: BTreeMap<_, TimingRow> = BTreeMap::new();
    for row in rows {
        let identity = (row.key.clone(), row.machine.clone(), row.started);
        match merged.get(&identity) {
            Some(known) if *known != row => {
                let told = |row: &TimingRow| format!("{:?} and {:?} s", row.encode, row.render);
                return Err(EvalError::Disagreement {
                    key: row.key.to_string(),
                    field: format!("the times of one pass on {}", row.machine),
                    first: told(known),
                    second: told(&row),
                });
            }
            Some(_) => {}
            None => drop(merged.insert(identity, row)),
        }
    }
    Ok(merged.into_values().collect())
}
