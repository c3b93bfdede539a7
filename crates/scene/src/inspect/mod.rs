//! Statistics of a dataset: counts, image sizes, intrinsics, baselines, problems.

mod aggregate;
mod check;
mod measure;
mod report;
mod still_cameras;
mod table;
mod unlisted;

use rayon::prelude::*;

use crate::{Format, SceneSource, WarningKind, Warnings};
use aggregate::Aggregate;
use measure::SceneMeasure;

pub use report::{
    Baselines, ImageCounts, Inspection, Intrinsics, LensCounts, Problem, SceneCounts, SceneSummary, SizeCount, Summary,
};

/// Scenes in memory at once.
const SCENES_AT_ONCE: usize = 256;

/// What an inspection reads and reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InspectOptions {
    /// Which images' headers are read for their size, and their ends looked for. All image files are checked for being
    /// empty.
    pub sizes: SizeSampling,
    /// Whether [`Inspection::per_scene`] is filled.
    pub per_scene: bool,
}

impl Default for InspectOptions {
    /// Three headers per scene, no list of scenes.
    fn default() -> Self {
        Self { sizes: SizeSampling::PerScene(3), per_scene: false }
    }
}

/// Which images' headers are read for their size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SizeSampling {
    /// At most this many of each scene, evenly spread from its first image to its last; with 0, none.
    PerScene(usize),
    /// All.
    All,
}

/// Reads every scene of `source`, a dataset of `format`, in parallel and reports statistics and problems. `progress` is called after
/// each scene, from any thread.
///
/// `warnings` are those of opening the dataset, and no others; those of its scenes are added, and all of them are the report's problems.
/// A scene that cannot be read is a problem, not an error. The report does not depend on the number of threads.
pub fn inspect(
    source: &dyn SceneSource,
    format: Format,
    options: &InspectOptions,
    warnings: &mut Warnings,
    progress: &(dyn Fn() + Sync),
) -> Inspection {
    let opening = warnings.clone();
    let mut aggregate = Aggregate::default();
    for keys in source.keys().chunks(SCENES_AT_ONCE) {
        let measured: Vec<_> = keys
            .par_iter()
            .map(|key| {
                let mut warnings = Warnings::new();
                let scene = source.load(key, &mut warnings);
                let measure = scene.map(|scene| {
                    // Chunks of captures have the numbers of images in place of timestamps.
                    let is_numbered = format == Format::TorchChunks && !scene.has_times(source.times());
                    let repeated = if is_numbered { warnings.count(WarningKind::DuplicateTimestamp) } else { 0 };
                    (SceneMeasure::of(&scene, options.sizes, &mut warnings), repeated)
                });
                progress();
                (key, measure, warnings)
            })
            .collect();
        for (key, measure, of_scene) in measured {
            warnings.merge(of_scene);
            match measure {
                Ok((measure, repeated)) => {
                    aggregate.push(measure);
                    aggregate.repeated_numbers += repeated;
                }
                Err(error) => warnings.push(WarningKind::UnreadableScene, key.as_str(), error.to_string()),
            }
        }
    }
    aggregate.report(format, source.keys().len(), left_out(&opening, warnings), options.per_scene, warnings)
}

/// Scenes of the data that are not among a dataset's keys, by the warnings of opening it and by all warnings since: ignored next to
/// its scenes, with the key of an earlier one in their chunk, or in a chunk that is missing or cannot be read (such a chunk counts
/// once). In object storage, and next to an index without scenes, also those that the index does not list; a chunk that it does not
/// name counts once.
pub fn left_out(opening: &Warnings, all: &Warnings) -> u64 {
    let not_listed = [WarningKind::UnreadableScene, WarningKind::SceneNotFound].map(|kind| opening.count(kind));
    // A further model of a capture is found when the capture is read, a scene next to others in a chunk with the first of them.
    let found_later = [WarningKind::IgnoredScene, WarningKind::UnindexedScene, WarningKind::UnindexedChunk];
    not_listed.into_iter().chain(found_later.map(|kind| all.count(kind))).sum()
}

#[cfg(test)]
mod tests;
