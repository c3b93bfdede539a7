use atsplat_scene::{Scene, SceneError, SceneSource, WarningKind, Warnings};
use rayon::prelude::*;

use crate::preset::{DropReason, Dropped};

/// Runs `work` on each item on rayon's threads. Results and warnings come in the order of the items, whatever the
/// number of threads.
pub(crate) fn in_parallel<I: Sync, R: Send>(
    items: &[I],
    warnings: &mut Warnings,
    work: impl Fn(&I, &mut Warnings) -> R + Sync,
) -> Vec<R> {
    let with_warnings = |item| {
        let mut of_item = Warnings::new();
        (work(item, &mut of_item), of_item)
    };
    let done: Vec<(R, Warnings)> = items.par_iter().map(with_warnings).collect();
    let merged = done.into_iter().map(|(result, of_item)| {
        warnings.merge(of_item);
        result
    });
    merged.collect()
}

/// Loads a scene. A failure is also pushed to `warnings`, as [`WarningKind::SceneNotFound`] or
/// [`WarningKind::UnreadableScene`].
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
