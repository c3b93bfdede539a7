//! Notes of trials that readers of a store distinguish from others.

use std::collections::BTreeSet;
use std::fmt;

use crate::Results;

/// A note of a trial that readers of a store distinguish from others. [`TrialRow::notes`](crate::TrialRow::notes) has its text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialNote<'a> {
    /// How many steps an optimisation took, which is no warning.
    StepsTaken {
        /// Number of steps.
        steps: u64,
        /// For an optimisation for a time: the machine with its threads, which decides how many steps fit into it.
        machine: Option<&'a str>,
    },
    /// A network saw its context images at another size.
    SawResized {
        /// The size of the images and the one at which they were seen, as in `112x112 at 128x128`.
        sizes: &'a str,
    },
}

const OPTIMISATION: &str = "optimisation: ";
const STEPS: &str = " steps";
const IN_TIME_ON: &str = " in its time on ";
const SAW: &str = "the network saw context ";
const OF: &str = " of ";

impl<'a> TrialNote<'a> {
    /// The note of this text; `None` for others.
    pub fn of(note: &'a str) -> Option<Self> {
        if let Some(rest) = note.strip_prefix(SAW) {
            // Older stores call the images pictures.
            return rest.split_once(OF).map(|(_, sizes)| Self::SawResized { sizes });
        }
        // Older stores have another remark behind the steps.
        let (steps, rest) = note.strip_prefix(OPTIMISATION)?.split_once(STEPS)?;
        Some(Self::StepsTaken { steps: steps.parse().ok()?, machine: rest.strip_prefix(IN_TIME_ON) })
    }
}

impl fmt::Display for TrialNote<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StepsTaken { steps, machine: None } => write!(f, "{OPTIMISATION}{steps}{STEPS}"),
            Self::StepsTaken { steps, machine: Some(machine) } => {
                write!(f, "{OPTIMISATION}{steps}{STEPS}{IN_TIME_ON}{machine}")
            }
            Self::SawResized { sizes } => write!(f, "{SAW}images{OF}{sizes}"),
        }
    }
}

impl Results {
    /// The machines, with their threads, on which a method was optimised for a time: on each of them, another number of steps fits
    /// into it. None for other methods, and for rows of older versions.
    pub fn optimised_on(&self, preset: &str, method: &str) -> BTreeSet<&str> {
        let notes = self.trials_of(preset, method).flat_map(|trial| &trial.notes);
        let machines = notes.filter_map(|note| match TrialNote::of(note)? {
            TrialNote::StepsTaken { machine, .. } => machine,
            TrialNote::SawResized { .. } => None,
        });
        machines.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The text of each note of the test in stores: by another one, readers would no longer recognise the notes of older stores.
    const fn stored(note: TrialNote<'_>) -> &'static str {
        match note {
            TrialNote::StepsTaken { machine: None, .. } => "optimisation: 300 steps",
            TrialNote::StepsTaken { machine: Some(_), .. } => "optimisation: 300 steps in its time on a, 2 threads",
            TrialNote::SawResized { .. } => "the network saw context images of 64x112 at 128x224",
        }
    }

    #[test]
    fn notes_are_read_from_the_texts_of_stores() {
        let steps = |steps, machine| TrialNote::StepsTaken { steps, machine };
        let resized = TrialNote::SawResized { sizes: "64x112 at 128x224" };
        for note in [steps(300, None), steps(300, Some("a, 2 threads")), resized] {
            assert_eq!((TrialNote::of(stored(note)), note.to_string().as_str()), (Some(note), stored(note)));
        }
        let older = [
            "optimisation: 300 steps, 21.50 dB on the context views",
            "the network saw context pictures of 1x2 at 3x4",
        ];
        assert_eq!(
            older.map(TrialNote::of),
            [Some(steps(300, None)), Some(TrialNote::SawResized { sizes: "1x2 at 3x4" })]
        );
        assert_eq!(["optimisation: none", "the network saw context", "steps"].map(TrialNote::of), [None; 3]);
    }
}
