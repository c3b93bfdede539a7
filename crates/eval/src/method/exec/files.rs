//! The files that atsplat and a method's process exchange for one trial, in a folder that is removed afterwards.

use std::fs;
use std::path::{Component, MAIN_SEPARATOR, Path, PathBuf};

use atsplat_files::FileError;
use atsplat_pixels::{Image, npy};
use atsplat_splat::{Gaussians, RasterMode};

use super::array;
use crate::method::frame_files::FrameFiles;
use crate::method::{MethodError, TrialInput, ply, renders};

/// How the name of a trial's folder begins; the number of its request follows.
const PREFIX: &str = "request-";

/// The folder of one trial, named by the number of its request.
#[derive(Debug)]
pub(super) struct TrialFolder(PathBuf);

impl TrialFolder {
    /// Writes the context images as `context-0.npy` and so on; also returns their paths.
    ///
    /// # Errors
    /// [`MethodError::Io`] if they cannot be written.
    pub(super) fn of(parent: &Path, request: u64, input: &TrialInput<'_>) -> Result<(Self, Vec<String>), MethodError> {
        let trial_folder = Self(parent.join(format!("{PREFIX}{request}")));
        fs::create_dir_all(&trial_folder.0)
            .map_err(FileError::during::<MethodError>("creating a folder for a method's trial", &trial_folder.0))?;
        let mut paths = Vec::with_capacity(input.images.len());
        for (at, image) in input.images.iter().enumerate() {
            let path = trial_folder.0.join(format!("context-{at}.npy"));
            fs::write(&path, npy::write(image))
                .map_err(FileError::during::<MethodError>("writing a context image for a method", &path))?;
            paths.push(path.display().to_string());
        }
        Ok((trial_folder, paths))
    }

    pub(super) fn path(&self) -> String {
        self.0.display().to_string()
    }

    /// The images of an answer, in the order of the targets: from one array, or from a folder in which single
    /// images may be missing or broken.
    pub(super) fn images(&self, name: &str, input: &TrialInput<'_>) -> Result<Vec<Result<Image, String>>, String> {
        let path = self.file(name)?;
        let targets = input.trial.targets();
        if path.is_dir() {
            let files = FrameFiles::of([path], targets.iter().map(|target| target.frame));
            let read = |frame| {
                let file = files.file_of(frame)?;
                let file =
                    file.ok_or_else(|| format!("no file for frame {frame}: expected {frame:06}.png, .exr or .npy"))?;
                renders::read(&file).map_err(|error| format!("frame {frame}: {error}"))
            };
            return Ok(targets.iter().map(|target| read(target.frame)).collect());
        }
        let Some(first) = targets.first() else { return Ok(Vec::new()) };
        if let Some(other) = targets.iter().find(|target| target.size != first.size) {
            let (one, another) = (first.size, other.size);
            return Err(format!("targets of {one} and of {another} do not fit into one array: answer with a folder"));
        }
        let shape = [targets.len(), first.size.height as usize, first.size.width as usize, 3];
        Ok(array::read_images(&path, shape)?.into_iter().map(Ok).collect())
    }

    /// The Gaussians of an answer, in the trial's world, and remarks on their file.
    pub(super) fn gaussians(
        &self,
        name: &str,
        as_stored: bool,
        mode: Option<RasterMode>,
    ) -> Result<(Gaussians, Vec<String>), String> {
        ply::read(&self.file(name)?, Path::new(name), as_stored, mode)
    }

    /// A file of the folder; its whole path is accepted too.
    fn file(&self, name: &str) -> Result<PathBuf, String> {
        let path = self.0.join(name);
        let below = path.strip_prefix(&self.0).ok();
        let is_below = below.is_some_and(|below| {
            let mut parts = below.components().peekable();
            parts.peek().is_some() && parts.all(|part| matches!(part, Component::Normal(_)))
        });
        if !is_below {
            return Err(format!("expected a file in the trial's folder, found {name:?}"));
        }
        match fs::metadata(&path) {
            Ok(found) if found.is_file() || found.is_dir() => Ok(path),
            // Nothing limits how long a pipe is read.
            Ok(_) => Err(format!("expected a regular file or a folder, found {name:?}: a pipe, a socket or a device")),
            Err(_) => Err(format!("expected the file {name:?} that it named, found none")),
        }
    }
}

/// A message in which the folders of trials below `parent` have no names: those are others in every run, and rows of equal runs are
/// equal. What is in a folder keeps its name in it.
pub(super) fn without_folders(message: &str, parent: &Path) -> String {
    let beginning = parent.join(PREFIX).display().to_string();
    let mut parts = message.split(beginning.as_str());
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, part| {
        let rest = part.trim_start_matches(|character: char| character.is_ascii_digit());
        match rest.strip_prefix(MAIN_SEPARATOR) {
            Some(inside) => text + inside,
            None => text + "the trial's folder" + rest,
        }
    })
}

impl Drop for TrialFolder {
    fn drop(&mut self) {
        // If this fails, the folder is removed later with the folder of all trials.
        fs::remove_dir_all(&self.0).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_stay_in_their_folder() {
        let parent = tempfile::tempdir().unwrap();
        let trial_folder = TrialFolder(parent.path().join("request-1"));
        fs::create_dir_all(parent.path().join("request-1/renders")).unwrap();
        fs::write(parent.path().join("secret"), "").unwrap();
        let whole = trial_folder.0.join("renders").display().to_string();
        assert_eq!(trial_folder.file("renders"), trial_folder.file(&whole));
        assert!(trial_folder.file("renders").is_ok());
        for name in ["../secret", "renders/../../secret", "/etc/passwd", "", "."] {
            assert!(trial_folder.file(name).is_err_and(|why| why.contains("trial's folder")), "{name:?}");
        }
        assert!(trial_folder.file("missing").unwrap_err().contains("found none"));
    }

    #[test]
    fn messages_name_files_as_they_are_called_in_a_trials_folder() {
        let parent = Path::new("tmp").join("atsplat-method-x");
        let folder = |number: u64| parent.join(format!("request-{number}"));
        let [one, other] = [folder(1).join("renders").join("28.png"), folder(12).join("28.png")];
        let message = format!("two files: {} and {} in {}: no", one.display(), other.display(), folder(1).display());
        let renders = Path::new("renders").join("28.png");
        let expected = format!("two files: {} and 28.png in the trial's folder: no", renders.display());
        assert_eq!(without_folders(&message, &parent), expected);
        assert_eq!(without_folders("out of memory", &parent), "out of memory");
    }

    #[test]
    #[cfg(unix)]
    fn a_pipe_is_not_an_answer() {
        let parent = tempfile::tempdir().unwrap();
        let trial_folder = TrialFolder(parent.path().join("request-1"));
        fs::create_dir(&trial_folder.0).unwrap();
        let made = std::process::Command::new("mkfifo").arg(trial_folder.0.join("pipe")).status().unwrap();
        assert!(made.success());
        std::os::unix::fs::symlink("pipe", trial_folder.0.join("renders.npy")).unwrap();
        for name in ["pipe", "renders.npy"] {
            let refused = trial_folder.file(name).unwrap_err();
            assert!(refused.starts_with("expected a regular file or a folder, found"), "{refused}");
        }
    }
}
