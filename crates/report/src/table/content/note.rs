//! A line below a table, by its subject.

use serde::Serialize;

/// A line below a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Note {
    /// Its subject.
    pub kind: NoteKind,
    /// The text.
    pub text: String,
}

/// The subject of a note.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoteKind {
    /// Where the published numbers were printed.
    Source,
    /// What readers must know about the published numbers and the table, such as what its asterisks stand for.
    Published,
    /// Definitions of metrics; preset, index and renderer.
    Convention,
    /// Numbers of scenes and targets, and failures.
    Counts,
    /// Intervals.
    Interval,
    /// How measured numbers differ from the published setting.
    Setting,
    /// Random weights.
    Untrained,
    /// What was not computed, and how to get it.
    NotComputed,
    /// Sizes that were stated, not counted.
    Stated,
    /// The machines and devices of the times.
    Machine,
    /// Times measured on a busy machine.
    Busy,
    /// What the marks of times of processes stand for.
    TimeScope,
    /// Slopes over a setting, and of differences between methods over overlap or distance.
    Trend,
    /// Targets that are left out of means, and intervals of too few scenes.
    LeftOut,
    /// The spread of several trainings.
    Trainings,
    /// Columns whose measured numbers do not compare with each other, and rows that lack targets or trials.
    Unranked,
    /// Rows of different protocols.
    Forced,
    /// Paired differences between rows.
    Paired,
    /// Columns and rows that were left out by choice.
    Choice,
}
