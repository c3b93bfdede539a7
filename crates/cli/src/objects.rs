//! `s3://`, `gs://` and `az://` URLs instead of folders: objects are copied to this disk.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use atsplat_files::this_process;
use atsplat_objects::{Mirror, ObjectError, StoreCopy, Traffic};
use atsplat_scene::Fetch;

use crate::print::{note, print_status};

/// The copies of this process, as a path and the URL that it stands for. Only messages and texts of records depend on them.
static COPIES: Mutex<Vec<(String, String)>> = Mutex::new(Vec::new());

/// Why a dataset of this process could not be fetched, if that has happened.
static FAILURE: Mutex<Option<ObjectError>> = Mutex::new(None);

/// Fails if object storage failed while a dataset was read: readers report what could not be fetched as unreadable scenes, although
/// the data may be fine. To be called before a result is written.
pub(crate) fn check_reading() -> anyhow::Result<()> {
    let failure = FAILURE.lock().unwrap_or_else(PoisonError::into_inner).clone();
    failure.map_or(Ok(()), |error| Err(error.into()))
}

/// Text with URLs in place of the paths of their copies.
pub(crate) fn with_urls(text: &str) -> String {
    let copies = COPIES.lock().unwrap_or_else(PoisonError::into_inner);
    copies.iter().fold(text.to_owned(), |text, (path, url)| text.replace(path, url))
}

/// Whether something was read from, or is written to, object storage.
pub(crate) fn has_copies() -> bool {
    !COPIES.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
}

pub(crate) fn note_copy(path: &Path, url: &str) {
    let (path, url) = (path.to_string_lossy().into_owned(), url.trim_end_matches('/').to_owned());
    COPIES.lock().unwrap_or_else(PoisonError::into_inner).push((path, url));
}

/// Where copies of objects are kept.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct CacheArgs {
    /// Folder for copies of what is read from object storage (s3://, gs://, az://), which later runs reuse; by default
    /// `atsplat/objects` in the user's cache folder.
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
}

impl CacheArgs {
    /// The dataset at a URL; `None` if `path` is a path on this machine. No object is fetched yet.
    pub(crate) fn dataset(&self, path: &Path) -> anyhow::Result<Option<Arc<RemoteData>>> {
        let Some(url) = atsplat_objects::url(path) else { return Ok(None) };
        let mirror = Mirror::open(url, self.cache.as_deref())?;
        note_copy(mirror.path(), url);
        Ok(Some(Arc::new(RemoteData(mirror))))
    }

    /// The folder of a results store: a copy if `path` is a URL.
    pub(crate) fn store(&self, path: &Path) -> anyhow::Result<PathBuf> {
        let Some(url) = atsplat_objects::url(path) else { return Ok(path.to_owned()) };
        let mirror = Mirror::complete(url, self.cache.as_deref())?;
        note_copy(mirror.path(), url);
        report(url, mirror.traffic());
        Ok(mirror.path().to_owned())
    }

    /// The store at `path`, to be written, and what `open` returns for its folder. If another process claims the store
    /// at the same moment, it is opened again, and the other process stops.
    pub(crate) fn output<T>(
        &self,
        path: &Path,
        open: impl Fn(&Path) -> anyhow::Result<T>,
    ) -> anyhow::Result<(Output, T)> {
        const ATTEMPTS: usize = 5;
        let Some(url) = atsplat_objects::url(path) else { return Ok((Output::Folder, open(path)?)) };
        let mut attempts = 1..ATTEMPTS;
        loop {
            let copy = StoreCopy::begin(url, self.cache.as_deref(), &this_process())?;
            note_copy(copy.folder(), url);
            let opened = open(copy.folder())?;
            match copy.claim() {
                Ok(()) => {
                    if let Some(by) = copy.unfinished_writer() {
                        note(&format!("{url}: {by}, did not finish; if it is still running, it stops"));
                    }
                    return Ok((Output::Remote(url.to_owned(), Box::new(copy)), opened));
                }
                Err(ObjectError::TakenOver { .. }) if attempts.next().is_some() => {}
                Err(error) => return Err(error.into()),
            }
        }
    }
}

fn report(url: &str, traffic: Traffic) {
    print_status(&format!("object storage: {traffic} ({url})"));
}

/// A dataset in object storage. Prints the traffic when it is dropped.
#[derive(Debug)]
pub(crate) struct RemoteData(Mirror);

impl RemoteData {
    /// The local copy of the dataset, a file or folder.
    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    /// Why an image or scene could not be fetched, if one could not: the storage failed, the data may be fine.
    pub(crate) fn failure(&self) -> Option<ObjectError> {
        self.0.failure()
    }
}

impl Fetch for RemoteData {
    fn fetch(&self, paths: &[PathBuf]) -> io::Result<()> {
        self.0.fetch(paths).map_err(|error| {
            FAILURE.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(|| error.clone());
            io::Error::other(error)
        })
    }
}

impl Drop for RemoteData {
    fn drop(&mut self) {
        report(self.0.url(), self.0.traffic());
    }
}

/// A results store that is written.
#[derive(Debug)]
pub(crate) enum Output {
    Folder,
    Remote(String, Box<StoreCopy>),
}

impl Output {
    /// Call this when a trial is finished.
    pub(crate) fn step(&self) {
        if let Self::Remote(_, copy) = self {
            copy.send_soon();
        }
    }

    /// Why results could not be sent, if sending failed.
    pub(crate) fn failure(&self) -> Option<ObjectError> {
        match self {
            Self::Folder => None,
            Self::Remote(_, copy) => copy.failure(),
        }
    }

    /// Sends the remaining results and prints the traffic.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        let Self::Remote(url, copy) = self else { return Ok(()) };
        copy.finish().context("sending results")?;
        report(&url, copy.traffic());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_name_urls_and_not_their_copies() {
        note_copy(Path::new("/nowhere/trees/11/data"), "s3://b/data/");
        note_copy(Path::new("/nowhere/trees/22/data"), "s3://b/data2");
        let text =
            "decoding an image (/nowhere/trees/11/data/a/0.png), (/nowhere/trees/22/data/a.txt), (/nowhere/trees)";
        let expected = "decoding an image (s3://b/data/a/0.png), (s3://b/data2/a.txt), (/nowhere/trees)";
        assert_eq!(with_urls(text), expected);
    }
}
