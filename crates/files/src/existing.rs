use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// The bytes of a regular file; `None` if it does not exist.
///
/// # Errors
/// Any other failure of the file system.
pub fn read_if_exists(path: &Path) -> io::Result<Option<Vec<u8>>> {
    if_exists(crate::read(path))
}

/// Removes a file if it exists.
///
/// # Errors
/// Any other failure of the file system.
pub fn remove_if_exists(path: &Path) -> io::Result<()> {
    if_exists(std::fs::remove_file(path)).map(|_removed| ())
}

/// The paths of everything in a folder, sorted; none if it does not exist.
///
/// # Errors
/// Any other failure of the file system.
pub fn entries_if_exists(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let Some(entries) = if_exists(std::fs::read_dir(folder))? else { return Ok(Vec::new()) };
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

fn if_exists<T>(outcome: io::Result<T>) -> io::Result<Option<T>> {
    match outcome {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        outcome => outcome.map(Some),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_exist_is_no_error_and_everything_else_is() {
        let folder = tempfile::tempdir().unwrap();
        let [file, absent] = ["b", "absent"].map(|name| folder.path().join(name));
        std::fs::write(&file, b"bytes").unwrap();
        assert_eq!(read_if_exists(&file).unwrap().as_deref(), Some(&b"bytes"[..]));
        assert_eq!(read_if_exists(&absent).unwrap(), None);
        assert!(read_if_exists(folder.path()).is_err(), "a folder is no file");
        std::fs::write(folder.path().join("a"), b"").unwrap();
        assert_eq!(entries_if_exists(folder.path()).unwrap(), [folder.path().join("a"), file.clone()]);
        assert!(entries_if_exists(&absent).unwrap().is_empty());
        assert!(entries_if_exists(&file).is_err(), "a file is no folder");
        remove_if_exists(&file).unwrap();
        remove_if_exists(&file).unwrap();
        assert!(!file.exists());
        assert!(remove_if_exists(folder.path()).is_err(), "a folder is no file");
    }
}
