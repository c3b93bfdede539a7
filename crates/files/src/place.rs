//! Which file or folder a path leads to, also if it is missing.

use std::io::Result as IoResult;
use std::path::{Component, Path, PathBuf, absolute};

/// The canonical path of a file or folder; of a missing one, that of the lowest existing folder above it, with the rest.
///
/// # Errors
/// If the current folder is unknown.
pub fn canonical_path(path: &Path) -> IoResult<PathBuf> {
    Path::new(".").join(path).canonicalize().or_else(|_missing| {
        let path = absolute(path)?;
        let mut above = path.ancestors().skip(1);
        let Some((folder, mut canonical)) = above.find_map(|folder| Some((folder, folder.canonicalize().ok()?))) else {
            return Ok(path);
        };
        for part in path.strip_prefix(folder).unwrap_or(&path).components() {
            match part {
                Component::ParentDir => drop(canonical.pop()),
                part => canonical.push(part),
            }
        }
        Ok(canonical)
    })
}

/// Whether an output, which may be missing, is at the path of an existing file or folder.
pub fn is_at(out: &Path, existing: &Path) -> bool {
    existing.canonicalize().is_ok_and(|existing| canonical_path(out).is_ok_and(|out| out == existing))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn an_output_is_where_any_of_its_paths_leads() {
        let root = tempfile::tempdir().unwrap();
        let at = |path: &str| root.path().join(path);
        fs::create_dir_all(at("data/scene")).unwrap();
        for out in ["data", "data/", "data/scene/..", "./data", "missing/../data"] {
            assert!(is_at(&at(out), &at("data")), "{out}");
        }
        for out in ["data/scene", "", "data2", "data/missing"] {
            assert!(!is_at(&at(out), &at("data")), "{out}");
        }
        assert!(!is_at(&at("missing"), &at("missing")), "only what exists is replaced");
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("data"), at("link")).unwrap();
            assert!(is_at(&at("link"), &at("data")) && is_at(&at("data"), &at("link")));
        }
    }
}
