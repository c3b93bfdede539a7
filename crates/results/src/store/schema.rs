//! Schemas of a store's tables: one text file per version, committed in `schema/`.
//!
//! ```text
//! targets
//!   preset text
//!   overlap number?
//! ```
//!
//! Each table lists its columns in order with their types; `?` marks nullable columns. Lists are never null.

use atsplat_files::Sha256Digest;
use polars::prelude::DataType;

/// Type of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Text,
    Flag,
    Count,
    Integer,
    Number,
    Texts,
    Counts,
    Numbers,
}

impl Kind {
    const ALL: [Self; 8] =
        [Self::Text, Self::Flag, Self::Count, Self::Integer, Self::Number, Self::Texts, Self::Counts, Self::Numbers];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Text => "text",
            Self::Flag => "flag",
            Self::Count => "count",
            Self::Integer => "integer",
            Self::Number => "number",
            Self::Texts => "texts",
            Self::Counts => "counts",
            Self::Numbers => "numbers",
        }
    }

    /// The type in Parquet.
    pub(super) fn data_type(self) -> DataType {
        let list = |of| DataType::List(Box::new(of));
        match self {
            Self::Text => DataType::String,
            Self::Flag => DataType::Boolean,
            Self::Count => DataType::UInt64,
            Self::Integer => DataType::Int64,
            Self::Number => DataType::Float64,
            Self::Texts => list(DataType::String),
            Self::Counts => list(DataType::UInt64),
            Self::Numbers => list(DataType::Float64),
        }
    }
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) nullable: bool,
}

/// The tables of one version.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Schema {
    pub(super) targets: Vec<Column>,
    pub(super) trials: Vec<Column>,
    /// Empty in version 1.
    pub(super) timings: Vec<Column>,
}

/// The text of every version, oldest first. A released version never changes.
const VERSIONS: &[&str] = &[
    include_str!("../../schema/v1.txt"),
    include_str!("../../schema/v2.txt"),
    include_str!("../../schema/v3.txt"),
    include_str!("../../schema/v4.txt"),
    include_str!("../../schema/v5.txt"),
];

/// The schema version that is written.
#[expect(clippy::cast_possible_truncation, reason = "a handful of versions")]
pub const SCHEMA_VERSION: u32 = VERSIONS.len() as u32;

/// The committed text of a version; `None` for an unknown version.
pub(super) fn text(version: u32) -> Option<&'static str> {
    let position = usize::try_from(version).ok()?.checked_sub(1)?;
    VERSIONS.get(position).copied()
}

/// SHA-256 of a version's text in hexadecimal.
pub(super) fn hash(version: u32) -> Option<String> {
    Some(Sha256Digest::of(text(version)?.as_bytes()).to_string())
}

/// Hash of the schema that is written.
///
/// # Panics
/// Never: every version has its text.
#[expect(clippy::expect_used, reason = "the version is the number of texts")]
pub fn schema_hash() -> String {
    hash(SCHEMA_VERSION).expect("the newest version has a text")
}

impl Schema {
    /// The schema of a version; `None` for an unknown version.
    pub(super) fn of_version(version: u32) -> Option<Self> {
        Self::parse(text(version)?)
    }

    /// Reads a schema's text.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let mut schema = Self::default();
        let mut table = None;
        for line in text.lines().filter(|line| !line.trim().is_empty()) {
            match line.strip_prefix("  ") {
                None => table = Some(line),
                Some(column) => {
                    let (name, kind) = column.split_once(' ')?;
                    let (kind, nullable) = kind.strip_suffix('?').map_or((kind, false), |kind| (kind, true));
                    let kind = Kind::ALL.into_iter().find(|known| known.name() == kind)?;
                    let columns = match table? {
                        "targets" => &mut schema.targets,
                        "trials" => &mut schema.trials,
                        "timings" => &mut schema.timings,
                        _ => return None,
                    };
                    columns.push(Column { name: name.to_owned(), kind, nullable });
                }
            }
        }
        Some(schema)
    }

    /// The text that [`Self::parse`] reads.
    #[cfg(test)]
    pub(super) fn to_text(&self) -> String {
        use std::fmt::Write as _;

        let mut text = String::new();
        for (table, columns) in [("targets", &self.targets), ("trials", &self.trials), ("timings", &self.timings)] {
            writeln!(text, "{table}").ok();
            for Column { name, kind, nullable } in columns {
                writeln!(text, "  {name} {}{}", kind.name(), if *nullable { "?" } else { "" }).ok();
            }
        }
        text
    }
}
