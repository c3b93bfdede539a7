//! How notes of trials begin that readers of a store distinguish from others.

use std::collections::BTreeSet;

use crate::Results;

/// How the note begins that says how many steps an optimisation took; it is not a warning.
pub const STEPS_TAKEN: &str = "optimisation: ";
/// What the note says, between steps and machine, of an optimisation for a time.
pub const IN_TIME_ON: &str = " steps in its time on ";

impl Results {
    /// The machines, with their threads, on which a method was optimised for a time: on each of them, another number of steps fits
    /// into it. None for other methods, and for rows of older versions.
    pub fn optimised_on(&self, preset: &str, method: &str) -> BTreeSet<&str> {
        let notes = self.trials_of(preset, method).flat_map(|trial| &trial.notes);
        notes.filter_map(|note| Some(note.strip_prefix(STEPS_TAKEN)?.split_once(IN_TIME_ON)?.1)).collect()
    }
}
