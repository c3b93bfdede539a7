use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;

/// Creates a folder, and those above it that are missing.
///
/// # Errors
/// [`ErrorKind::NotADirectory`] if a file, or a link that leads nowhere, is in the place of the folder or of one above it, with that
/// place; I/O errors.
pub fn create_folder(folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder).map_err(|error| in_the_way(folder).unwrap_or(error))
}

/// The error for what is in the place of the folder, or of the lowest one above it where there is something.
fn in_the_way(folder: &Path) -> Option<io::Error> {
    let path = folder.ancestors().find(|path| path.symlink_metadata().is_ok())?;
    let shown = path.display();
    let found = match path.metadata() {
        Ok(metadata) if metadata.is_dir() => return None,
        Ok(_) => format!("the file {shown}"),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let target = fs::read_link(path).ok()?;
            format!("the broken symbolic link {shown} to {}", target.display())
        }
        Err(_) => return None,
    };
    Some(io::Error::new(ErrorKind::NotADirectory, format!("expected a folder, found {found}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_in_the_place_of_a_folder_is_named() {
        let root = tempfile::tempdir().unwrap();
        let [file, new] = ["file", "new/below"].map(|name| root.path().join(name));
        create_folder(&new).unwrap();
        create_folder(&new).unwrap();
        assert!(new.is_dir());
        fs::write(&file, b"").unwrap();
        for folder in [file.clone(), file.join("below/this")] {
            let error = create_folder(&folder).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::NotADirectory);
            assert_eq!(error.to_string(), format!("expected a folder, found the file {}", file.display()));
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_folder_is_one_and_a_broken_link_is_named() {
        let root = tempfile::tempdir().unwrap();
        let [whole, broken] = ["whole", "broken"].map(|name| root.path().join(name));
        std::os::unix::fs::symlink(".", &whole).unwrap();
        std::os::unix::fs::symlink("gone", &broken).unwrap();
        create_folder(&whole.join("below")).unwrap();
        assert!(root.path().join("below").is_dir());
        for folder in [broken.clone(), broken.join("below")] {
            let error = create_folder(&folder).unwrap_err().to_string();
            let expected = format!("expected a folder, found the broken symbolic link {} to gone", broken.display());
            assert_eq!(error, expected);
        }
    }
}
