use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;

/// An error for what is neither a regular file nor a link to one: opening a pipe waits for whoever writes to it, and a device may
/// have no end.
///
/// # Errors
/// [`ErrorKind::IsADirectory`] for a folder, [`ErrorKind::InvalidInput`] for anything else that is not a file, and I/O errors.
pub fn require_regular(path: &Path) -> io::Result<()> {
    let metadata = fs::metadata(path)?;
    if metadata.is_dir() {
        return Err(ErrorKind::IsADirectory.into());
    }
    let other =
        || io::Error::new(ErrorKind::InvalidInput, "expected a regular file, found a pipe, a socket or a device");
    metadata.is_file().then_some(()).ok_or_else(other)
}

/// The bytes of a regular file.
///
/// # Errors
/// Those of [`require_regular`], and I/O errors.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    require_regular(path)?;
    fs::read(path)
}

/// The text of a regular file.
///
/// # Errors
/// Those of [`read`], and [`ErrorKind::InvalidData`] for text that is not UTF-8.
pub fn read_to_string(path: &Path) -> io::Result<String> {
    require_regular(path)?;
    fs::read_to_string(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "text").unwrap();
        assert_eq!((read(&file).unwrap(), read_to_string(&file).unwrap()), (b"text".to_vec(), "text".to_owned()));
        let kind = |path: &Path| read(path).unwrap_err().kind();
        assert_eq!(kind(&folder.path().join("absent")), ErrorKind::NotFound);
        assert_eq!(kind(folder.path()), ErrorKind::IsADirectory);
    }

    #[cfg(unix)]
    #[test]
    fn devices_without_an_end_are_not_read_through_a_link_either() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("targets.parquet");
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        let errors = [read(&link).map(drop), read_to_string(&link).map(drop), crate::read_if_exists(&link).map(drop)];
        let hash = crate::Sha256Digest::of_file(&link).map(drop);
        for error in errors.into_iter().chain([hash]) {
            let error = error.unwrap_err().to_string();
            assert_eq!(error, "expected a regular file, found a pipe, a socket or a device");
        }
    }
}
