use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::Path;

/// Opens a regular file, or a link to one, for reading. Anything else is an error: opening a pipe waits for whoever writes to it, and
/// a device may have no end.
///
/// # Errors
/// [`ErrorKind::IsADirectory`] for a folder, [`ErrorKind::InvalidInput`] for anything else that is not a file, and I/O errors.
pub fn open(path: &Path) -> io::Result<File> {
    require_regular(path)?;
    File::open(path)
}

fn require_regular(path: &Path) -> io::Result<()> {
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
/// Those of [`open`].
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
    use std::io::Read as _;

    use super::*;

    #[test]
    fn only_regular_files_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "text").unwrap();
        assert_eq!((read(&file).unwrap(), read_to_string(&file).unwrap()), (b"text".to_vec(), "text".to_owned()));
        let mut start = Vec::new();
        open(&file).unwrap().take(2).read_to_end(&mut start).unwrap();
        assert_eq!(start, b"te");
        for (path, expected) in
            [(folder.path().join("absent"), ErrorKind::NotFound), (folder.path().to_owned(), ErrorKind::IsADirectory)]
        {
            assert_eq!([open(&path).unwrap_err().kind(), read(&path).unwrap_err().kind()], [expected; 2]);
        }
    }

    #[cfg(unix)]
    #[test]
    fn devices_without_an_end_are_not_read_through_a_link_either() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("targets.parquet");
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        let errors = [
            open(&link).map(drop),
            read(&link).map(drop),
            read_to_string(&link).map(drop),
            crate::read_if_exists(&link).map(drop),
        ];
        let hash = crate::Sha256Digest::of_file(&link).map(drop);
        for error in errors.into_iter().chain([hash]) {
            let error = error.unwrap_err().to_string();
            assert_eq!(error, "expected a regular file, found a pipe, a socket or a device");
        }
    }
}
