use std::fmt;

use serde::Serialize;

use super::{Comparability, LintReport};
use crate::{IndexFile, IndexMatch, IndexMismatch, Preset};

/// A [`LintReport`], how the index fits a preset, and whether its results compare with those of a second one.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FullLint<'a> {
    /// The index alone, and its dataset.
    #[serde(flatten)]
    pub lint: LintReport,
    /// How it fits a preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<PresetMatch<'a>>,
    /// Whether results on a second index compare.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<Comparability>,
}

/// How an index fits a preset.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PresetMatch<'a> {
    /// Name of the preset.
    pub name: &'a str,
    /// Which of its indices it is.
    #[serde(flatten)]
    pub index: IndexMatch<'a>,
    /// How it does not fit.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub mismatches: Vec<IndexMismatch>,
}

impl<'a> PresetMatch<'a> {
    /// How the index of a file fits a preset.
    pub fn new(preset: &'a Preset, file: &IndexFile) -> Self {
        Self {
            name: &preset.name,
            index: preset.index.recognise(file),
            mismatches: preset.mismatches(&file.index, &file.sha256, &file.notices.unknown_fields),
        }
    }
}

impl fmt::Display for FullLint<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.lint)?;
        if let Some(PresetMatch { name, index, mismatches }) = &self.preset {
            writeln!(f, "\npreset {name}: {index}")?;
            for IndexMismatch { kind, count, example } in mismatches {
                writeln!(f, "    does not fit: {count} {kind}: {example}")?;
            }
        }
        if let Some(against) = &self.against {
            write!(f, "\nagainst the second index\n{against}")?;
        }
        Ok(())
    }
}
