use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use atsplat_numeric::counted;

/// Draws of scenes that gave no sample, each replaced by another draw.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReplacedDraws {
    /// How many there were.
    pub count: u64,
    /// Their scenes, each with the reason of its first one.
    pub scenes: BTreeMap<String, String>,
}

impl ReplacedDraws {
    pub(super) fn add(&mut self, scene: &str, reason: &str) {
        self.count += 1;
        self.scenes.entry(scene.to_owned()).or_insert_with(|| reason.to_owned());
    }

    /// Logs the reason of each scene that is not among the reported ones: a notice gives one example, and a dataset may have many such
    /// scenes.
    pub(crate) fn log_new(&self, reported: &BTreeSet<String>) {
        for (scene, reason) in self.scenes.iter().filter(|(scene, _)| !reported.contains(*scene)) {
            tracing::info!(scene = scene.as_str(), reason = reason.as_str(), "replaced a draw that gave no sample");
        }
    }

    pub(super) fn merge(&mut self, other: Self) {
        self.count += other.count;
        for (scene, reason) in other.scenes {
            self.scenes.entry(scene).or_insert(reason);
        }
    }
}

impl fmt::Display for ReplacedDraws {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (draws, scenes) = (counted(self.count, "draw"), counted(self.scenes.len() as u64, "scene"));
        write!(f, "{draws} of {scenes} replaced because they gave no sample")?;
        match self.scenes.first_key_value() {
            Some((_, reason)) => write!(f, ", such as {reason}"),
            None => Ok(()),
        }
    }
}

/// Draws of a run that gave no sample and were replaced, in this call and those before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplacedCount {
    /// How many there were.
    pub count: u64,
    /// The step from which they are counted: 0, unless the run goes on from a checkpoint of a version that did not count them.
    pub since: u64,
}

impl fmt::Display for ReplacedCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self { count, since: 0 } => write!(f, "{count}"),
            Self { count, since } => write!(f, "{count} since step {since}"),
        }
    }
}
