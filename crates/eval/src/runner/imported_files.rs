//! Checks before a run whether imported files exist.

use std::sync::Arc;

use atsplat_numeric::spread;

use super::{Plan, Selection};
use crate::EvalError;
use crate::method::{FoundFiles, Method, RequestedScene};

/// Scenes per dataset whose imported files are looked for before the run; all of them if there is no file of these.
const CHECKED_SCENES: usize = 32;

impl Plan<'_> {
    /// Where the files of each imported method are.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for a folder without any scene of the datasets.
    pub fn find_imported_files(&self) -> Result<Vec<FoundFiles>, EvalError> {
        // A method may lack every scene of a shard and have others.
        let whole = Selection { shard: None, ..self.selection };
        let indices: Vec<_> = self.datasets.iter().map(|dataset| whole.index_of(dataset)).collect();
        let requested = |scenes: usize| {
            let mut requested: Vec<RequestedScene<'_>> = Vec::new();
            for index in &indices {
                for position in spread(index.scenes.len(), scenes) {
                    let entry =
                        index.scenes.get_index(position).and_then(|(scene, entries)| Some((scene, entries.first()?)));
                    requested.extend(entry.map(|(scene, entry)| RequestedScene { scene, frames: &entry.target }));
                }
            }
            requested
        };
        let (some, methods) = (requested(CHECKED_SCENES), self.methods_of_scenes());
        let find = |method: &Arc<dyn Method>| {
            let found = method.find_files(&some)?;
            if found.scenes() == 0 { method.find_files(&requested(usize::MAX)) } else { Some(found) }
        };
        let found: Vec<FoundFiles> = methods.iter().filter_map(find).collect();
        found.iter().try_for_each(FoundFiles::check)?;
        Ok(found)
    }
}
