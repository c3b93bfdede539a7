use atsplat_scene::{Scene, SceneError, SceneSource, WarningKind, Warnings};
use rayon::prelude::*;

use crate::preset::{DropReason, Dropped};

/// Does `work` on each item on rayon's threads. Results come in the items' order, and so do the warnings of
/// each: both are the same for any number of threads.
pub(crate) fn in_parallel<I: Sync, R: Send>(
    items: &[I],
    warnings: &mut Warnings,
    work: impl Fn(&I, &mut Warnings) -> R + Sync,
) -> Vec<R> {
    let with_warnings = |item| {
        let mut own = Warnings::new();
        (work(item, &mut own), own)
    };
    let done: Vec<(R, Warnings)> = items.par_iter().map(with_warnings).collect();
    let merged = done.into_iter().map(|(result, own)| {
        warnings.merge(own);
        result
    });
    merged.collect()
}

/// Loads a scene. Where that fails, `warnings` says so too: as a scene that the dataset does not hold, or as
/// one that cannot be read.
pub(crate) fn load(source: &dyn SceneSource, key: &str, warnings: &mut Warnings) -> Result<Scene, Dropped> {
    source.load(key, warnings).map_err(|error| {
        let (kind, reason) = match error {
            SceneError::UnknownScene { .. } => (WarningKind::SceneNotFound, DropReason::SceneMissing),
            _ => (WarningKind::UnreadableScene, DropReason::Unreadable),
        };
        warnings.push(kind, key, error.to_string());
        Dropped { reason, detail: error.to_string() }
    })
}
