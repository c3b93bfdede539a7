//! Files that a command would write in the place of those that it reads.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::bail;
use atsplat_scene::Frame;

use crate::paths::canonical_path;

/// A file that a command reads, and what it is, such as "the scene".
pub(crate) type Read<'a> = (&'static str, &'a Path);

/// Refuses to write files in the place of those that are read. `option` names the argument for the message.
pub(crate) fn refuse_replacing<'a>(
    option: &str,
    written: impl IntoIterator<Item = PathBuf>,
    read: impl IntoIterator<Item = Read<'a>>,
) -> anyhow::Result<()> {
    // Files that are not there yet replace nothing.
    let there = written.into_iter().filter(|file| file.symlink_metadata().is_ok());
    let there: BTreeMap<PathBuf, PathBuf> = there.filter_map(|file| Some((entry(&file)?, file))).collect();
    if there.is_empty() {
        return Ok(());
    }
    for (what, file) in read {
        // A link is replaced, not what it leads to.
        let mut places = [entry(file), file.canonicalize().ok()].into_iter().flatten();
        if let Some(written) = places.find_map(|place| there.get(&place)) {
            let (written, file) = (written.display(), file.display());
            bail!("{option}: {written} would replace {what} {file}, which is read: choose another folder or name");
        }
    }
    Ok(())
}

/// The files of the images of these frames.
pub(crate) fn photos(frames: &[Frame]) -> impl Iterator<Item = Read<'_>> {
    frames.iter().filter_map(|frame| Some(("the photo", frame.image.file()?)))
}

/// Where a file has its name, also if that is a link.
fn entry(file: &Path) -> Option<PathBuf> {
    let folder = file.parent().unwrap_or(Path::new(""));
    Some(canonical_path(folder).ok()?.join(file.file_name()?))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn what_is_read_is_not_replaced_under_any_of_its_names() {
        let root = tempfile::tempdir().unwrap();
        let at = |path: &str| root.path().join(path);
        fs::create_dir(at("data")).unwrap();
        for file in ["data/0.png", "data/1.png"] {
            fs::write(at(file), "").unwrap();
        }
        let refusal = |written: &str, read: &str| {
            refuse_replacing("--out", [at(written)], [("the photo", at(read).as_path())])
                .map_err(|error| error.to_string())
        };
        let error = refusal("data/../data/0.png", "data/0.png").unwrap_err();
        assert!(error.starts_with("--out: ") && error.contains("0.png would replace the photo "), "{error}");
        assert_eq!(refusal("data/1.png", "data/0.png"), Ok(()));
        assert_eq!(refusal("data/2.png", "data/2.png"), Ok(()), "neither is there");
        #[cfg(unix)]
        {
            use std::os::unix::fs::symlink;
            symlink(at("data"), at("link")).unwrap();
            symlink(at("data/0.png"), at("data/here.png")).unwrap();
            for (written, read) in
                [("link/0.png", "data/0.png"), ("data/0.png", "data/here.png"), ("data/here.png", "data/here.png")]
            {
                assert!(refusal(written, read).is_err(), "{written} {read}");
            }
            assert_eq!(refusal("data/here.png", "data/0.png"), Ok(()), "only the link is replaced");
        }
    }
}
