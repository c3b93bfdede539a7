use std::path::{Path, PathBuf};

use crate::{Dataset, SceneSource as _};

/// A dataset without scenes, or with several of which none was requested.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", describe(path, *count, examples, option))]
pub struct AmbiguousScene {
    /// The dataset.
    pub path: PathBuf,
    /// Number of scenes.
    pub count: usize,
    /// Some of their keys.
    pub examples: Vec<String>,
    /// The option that chooses one.
    pub option: &'static str,
}

fn describe(path: &Path, count: usize, examples: &[String], option: &str) -> String {
    let path = path.display();
    match count {
        0 => format!("{path} contains no scene"),
        _ => format!("{path} contains {count} scenes ({} …): choose one with {option}", examples.join(", ")),
    }
}

/// The key of the requested scene, which may be omitted for a dataset of one scene.
///
/// # Errors
/// [`AmbiguousScene`] if no scene is requested and there are several or none.
pub fn scene_key<'a>(dataset: &'a Dataset, requested: Option<&'a str>) -> Result<&'a str, AmbiguousScene> {
    match (requested, dataset.keys()) {
        (Some(key), _) => Ok(key),
        (None, [only]) => Ok(only),
        (None, keys) => Err(AmbiguousScene {
            path: dataset.path.clone(),
            count: keys.len(),
            examples: keys.iter().take(5).cloned().collect(),
            option: "--key",
        }),
    }
}
