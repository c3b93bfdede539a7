//! The crate `object_store` behind blocking calls. Its requests run on separate threads, so that a call may come from any
//! thread; reads that fail for a moment are repeated there, and so are writes that have not been sent or that the server could not
//! answer. After another failure of a write, the object says whether it was written.

use std::fmt;
use std::future::Future;
use std::io::Write as _;
use std::ops::Range;
use std::path::Path;
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use atsplat_files::{AtomicFile, FileError};
use futures::{StreamExt as _, TryStreamExt as _, stream};
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::client::{HttpError, HttpErrorKind};
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::local::LocalFileSystem;
use object_store::path::Path as ObjectPath;
use object_store::{
    BackoffConfig, Error, GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt as _, ObjectStoreScheme,
    PutMode, PutOptions, PutPayload, RetryConfig, UpdateVersion,
};
use tokio::runtime::Runtime;
use url::Url;

use super::{Done, Download, Object, Storage, Traffic, Upload, Version};
use crate::ObjectError;

/// Bytes of one request for a part of an object.
const PART: u64 = 4 << 20;
/// Parts of an object that are requested at once.
const PARTS: usize = 4;
/// Objects that are read or written at once.
const OBJECTS: usize = 8;
/// Objects in one answer to a request for a list.
const PAGE: usize = 1000;

/// A folder of object storage.
pub(crate) struct Connected {
    store: Arc<dyn ObjectStore>,
    prefix: ObjectPath,
    url: String,
    traffic: Mutex<Traffic>,
    runtime: Runtime,
}

impl Connected {
    /// Prepares requests below a URL; makes none.
    pub(crate) fn open(url: &str) -> Result<Self, ObjectError> {
        let invalid = |detail: String| ObjectError::Invalid { url: url.to_owned(), detail };
        let parsed = Url::parse(url).map_err(|error| invalid(error.to_string()))?;
        // They would be left out of every request, so that another folder is read or written.
        for (part, begins_with, written) in [(parsed.query(), '?', "%3F"), (parsed.fragment(), '#', "%23")] {
            if let Some(part) = part {
                return Err(invalid(format!("found {begins_with}{part}; in names, write {written} for {begins_with}")));
            }
        }
        let (store, prefix) = connect(&parsed).map_err(|error| invalid(text_of(&error)))?;
        Self::of(store, prefix, url)
    }

    pub(crate) fn of(store: Arc<dyn ObjectStore>, prefix: ObjectPath, url: &str) -> Result<Self, ObjectError> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
        let runtime = runtime.map_err(FileError::during::<ObjectError>("starting threads for requests", url))?;
        Ok(Self { store, prefix, url: url.trim_end_matches('/').to_owned(), traffic: Mutex::default(), runtime })
    }

    fn object(&self, meta: &ObjectMeta) -> Option<Object> {
        let parts: Vec<String> =
            meta.location.prefix_match(&self.prefix)?.map(|part| part.as_ref().to_owned()).collect();
        let name = parts.join("/");
        (!name.is_empty()).then(|| Object { name, bytes: meta.size, tag: tag_of(meta) })
    }

    async fn read(&self, object: &Object, file: &Path) -> Result<Version, ObjectError> {
        let writing = || FileError::during::<ObjectError>("writing a copy of an object", file);
        let copy = AtomicFile::create(file).map_err(writing())?;
        let mut writer = copy.writer();
        let mut version = Version::default();
        let mut parts = pin!(stream::iter(parts(object.bytes)).map(|range| self.part(object, range)).buffered(PARTS));
        while let Some(part) = parts.next().await {
            let (bytes, of) = part?;
            writer.write_all(&bytes).map_err(writing())?;
            version = of;
        }
        copy.commit().map_err(writing())?;
        Ok(version)
    }

    /// Bytes of an object, which is still the one that was listed.
    async fn part(&self, object: &Object, range: Range<u64>) -> Result<(Vec<u8>, Version), ObjectError> {
        let failure = || self.failure("reading an object", &object.name);
        let options = GetOptions { range: Some(GetRange::Bounded(range.clone())), ..GetOptions::default() };
        self.count(1, 0, 0);
        let answer = self.store.get_opts(&self.place(&object.name)?, options).await.map_err(failure())?;
        let found = (answer.meta.size, tag_of(&answer.meta));
        let version = version_of(&answer.meta);
        self.unchanged(object, found.0, &found.1)?;
        let bytes = answer.bytes().await.map_err(failure())?;
        self.count(0, bytes.len(), 0);
        if bytes.len() as u64 != range.end - range.start {
            let (expected, found) = (range.end - range.start, bytes.len());
            let url = self.url_of(&object.name);
            let text = |bytes: String| format!("{bytes} bytes from byte {}", range.start);
            return Err(ObjectError::Changed {
                url,
                expected: text(expected.to_string()),
                found: text(found.to_string()),
            });
        }
        Ok((bytes.to_vec(), version))
    }

    fn unchanged(&self, object: &Object, bytes: u64, tag: &str) -> Result<(), ObjectError> {
        if (bytes, tag) == (object.bytes, &object.tag) {
            return Ok(());
        }
        let text = |bytes: u64, tag: &str| format!("{bytes} bytes with the tag {tag}");
        let (expected, found) = (text(object.bytes, &object.tag), text(bytes, tag));
        Err(ObjectError::Changed { url: self.url_of(&object.name), expected, found })
    }

    /// The new version; `None` if the file is gone.
    async fn write(&self, Upload { name, file, replaces }: &Upload) -> Result<Option<Version>, ObjectError> {
        let bytes = atsplat_files::read_if_exists(file);
        let bytes = bytes.map_err(FileError::during::<ObjectError>("reading what to write", file.clone()))?;
        let Some(bytes) = bytes else { return Ok(None) };
        let (written, payload) = (bytes.len(), PutPayload::from(bytes.clone()));
        let place = self.place(name)?;
        let mode = replaces
            .clone()
            .map_or(PutMode::Create, |Version { tag, version }| PutMode::Update(UpdateVersion { e_tag: tag, version }));
        let put = |mode: PutMode| {
            self.count(1, 0, written);
            self.store.put_opts(&place, payload.clone(), PutOptions::from(mode))
        };
        let written = match put(mode).await {
            // Folders of this machine cannot replace on a condition.
            Err(Error::NotImplemented { .. }) => put(PutMode::Overwrite).await,
            outcome => outcome,
        };
        match written {
            Ok(written) => Ok(Some(Version { tag: written.e_tag, version: written.version })),
            Err(error) => match self.written(&place, &bytes, &error).await {
                Some(version) => Ok(Some(version)),
                None => Err(self.failure("writing an object", name)(error)),
            },
        }
    }

    /// The version of an object that was written although the answer is an error: if an answer is lost, the request may be repeated,
    /// and its condition then fails, because of the first one.
    async fn written(&self, place: &ObjectPath, bytes: &[u8], error: &Error) -> Option<Version> {
        let may_be_written = match error {
            Error::Precondition { .. } | Error::AlreadyExists { .. } => true,
            Error::Generic { .. } => was_connected(error),
            _ => false,
        };
        if !may_be_written {
            return None;
        }
        self.count(1, 0, 0);
        let answer = self.store.get(place).await.ok().filter(|answer| answer.meta.size == bytes.len() as u64)?;
        let version = version_of(&answer.meta);
        let found = answer.bytes().await.ok()?;
        self.count(0, found.len(), 0);
        (found == bytes).then_some(version)
    }

    /// Adds to what was exchanged.
    fn count(&self, requests: u64, read: usize, written: usize) {
        let mut traffic = self.lock();
        traffic.requests += requests;
        traffic.bytes_read += read as u64;
        traffic.bytes_written += written as u64;
    }

    fn lock(&self) -> MutexGuard<'_, Traffic> {
        self.traffic.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<T>(&self, work: impl Future<Output = T>) -> T {
        self.runtime.block_on(work)
    }

    fn place(&self, name: &str) -> Result<ObjectPath, ObjectError> {
        let place = if name.is_empty() {
            Ok(self.prefix.clone())
        } else {
            ObjectPath::parse(format!("{}/{name}", self.prefix))
        };
        place.map_err(|_invalid| ObjectError::Name { url: self.url.clone(), name: name.to_owned() })
    }

    fn url_of(&self, name: &str) -> String {
        if name.is_empty() { self.url.clone() } else { format!("{}/{name}", self.url) }
    }

    /// For `map_err`.
    fn failure(&self, action: &'static str, name: &str) -> impl FnOnce(Error) -> ObjectError {
        let url = self.url_of(name);
        move |error| {
            let detail = text_of(&error);
            match error {
                Error::NotFound { .. } => ObjectError::NotFound { url },
                Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => ObjectError::Denied { url, detail },
                Error::Precondition { .. } | Error::AlreadyExists { .. } => {
                    ObjectError::TakenOver { url, by: "another process".to_owned() }
                }
                // Lists report these only in their text.
                _ if has_status(&detail, &[404]) => ObjectError::NotFound { url },
                _ if has_status(&detail, &[401, 403]) => ObjectError::Denied { url, detail },
                _ => ObjectError::Request { url, action: action.to_owned(), detail },
            }
        }
    }
}

impl Storage for Connected {
    fn url(&self) -> &str {
        &self.url
    }

    fn traffic(&self) -> Traffic {
        *self.lock()
    }

    fn list(&self) -> Result<Vec<Object>, ObjectError> {
        self.count(1, 0, 0);
        let listed = self.wait(self.store.list(Some(&self.prefix)).try_collect::<Vec<ObjectMeta>>());
        let listed = listed.map_err(self.failure("listing objects", ""))?;
        self.count((listed.len() / PAGE) as u64, 0, 0);
        let mut objects: Vec<Object> = listed.iter().filter_map(|meta| self.object(meta)).collect();
        if objects.is_empty() {
            self.count(1, 0, 0);
            let meta = self.wait(self.store.head(&self.prefix)).map_err(self.failure("looking for an object", ""))?;
            return Ok(vec![Object { name: String::new(), bytes: meta.size, tag: tag_of(&meta) }]);
        }
        objects.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(objects)
    }

    fn download(&self, downloads: Vec<Download>, done: Done<'_>) -> Result<(), ObjectError> {
        let one = async |Download { object, file }: Download| done(&object.name, self.read(&object, &file).await?);
        self.wait(stream::iter(downloads).map(one).buffer_unordered(OBJECTS).try_collect::<Vec<()>>()).map(drop)
    }

    fn get(&self, name: &str) -> Result<Option<(String, Version)>, ObjectError> {
        self.count(1, 0, 0);
        let place = self.place(name)?;
        let read = async {
            let answer = self.store.get(&place).await?;
            let version = version_of(&answer.meta);
            Ok((answer.bytes().await?, version))
        };
        match self.wait(read) {
            Ok((bytes, version)) => {
                self.count(0, bytes.len(), 0);
                Ok(Some((String::from_utf8_lossy(&bytes).into_owned(), version)))
            }
            Err(Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.failure("reading an object", name)(error)),
        }
    }

    fn put(&self, uploads: Vec<Upload>, done: Done<'_>) -> Result<(), ObjectError> {
        let one = async |upload: Upload| match self.write(&upload).await? {
            Some(version) => done(&upload.name, version),
            None => Ok(()),
        };
        self.wait(stream::iter(uploads).map(one).buffer_unordered(OBJECTS).try_collect::<Vec<()>>()).map(drop)
    }

    fn delete(&self, name: &str) -> Result<(), ObjectError> {
        self.count(1, 0, 0);
        match self.wait(self.store.delete(&self.place(name)?)) {
            Ok(()) | Err(Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(self.failure("removing an object", name)(error)),
        }
    }
}

impl fmt::Debug for Connected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Without the store, which contains credentials.
        f.debug_struct("Connected").field("url", &self.url).finish_non_exhaustive()
    }
}

fn connect(url: &Url) -> Result<(Arc<dyn ObjectStore>, ObjectPath), Error> {
    let (scheme, prefix) = ObjectStoreScheme::parse(url)?;
    let store: Arc<dyn ObjectStore> = match scheme {
        ObjectStoreScheme::AmazonS3 => {
            Arc::new(AmazonS3Builder::from_env().with_url(url.as_str()).with_retry(retry()).build()?)
        }
        ObjectStoreScheme::GoogleCloudStorage => {
            Arc::new(GoogleCloudStorageBuilder::from_env().with_url(url.as_str()).with_retry(retry()).build()?)
        }
        ObjectStoreScheme::MicrosoftAzure => {
            Arc::new(MicrosoftAzureBuilder::from_env().with_url(url.as_str()).with_retry(retry()).build()?)
        }
        ObjectStoreScheme::Local => Arc::new(LocalFileSystem::new()),
        other => {
            let source = format!("found a URL of {other:?}").into();
            return Err(Error::NotSupported { source });
        }
    };
    Ok((store, prefix))
}

/// Gives up after some seconds without a connection, so that a run says soon why it stops; another run resumes it.
fn retry() -> RetryConfig {
    let backoff =
        BackoffConfig { init_backoff: Duration::from_millis(200), max_backoff: Duration::from_secs(4), base: 2.0 };
    RetryConfig { backoff, max_retries: 8, retry_timeout: Duration::from_secs(30) }
}

fn parts(bytes: u64) -> impl Iterator<Item = Range<u64>> {
    (0..bytes.div_ceil(PART)).map(move |part| part * PART..((part + 1) * PART).min(bytes))
}

fn version_of(meta: &ObjectMeta) -> Version {
    Version { tag: meta.e_tag.clone(), version: meta.version.clone() }
}

/// The entity tag without quotes, which some lists leave out.
fn tag_of(meta: &ObjectMeta) -> String {
    let tag = meta.e_tag.as_deref().map(|tag| tag.trim_matches('"').to_owned());
    tag.unwrap_or_else(|| meta.last_modified.to_rfc3339())
}

/// Whether a request that failed had a connection: without one, the next request would wait in vain as well.
fn was_connected(error: &Error) -> bool {
    let first: &(dyn std::error::Error + 'static) = error;
    let mut causes = std::iter::successors(Some(first), |cause| cause.source());
    let of_connection = causes.find_map(|cause| cause.downcast_ref::<HttpError>());
    !of_connection.is_some_and(|error| matches!(error.kind(), HttpErrorKind::Connect))
}

/// Whether an error is an answer of one of these statuses.
fn has_status(detail: &str, statuses: &[u16]) -> bool {
    statuses.iter().any(|status| detail.contains(&format!("status code: {status} ")))
}

/// The error and its causes, in one line and without the queries of URLs, which may contain signatures.
fn text_of(error: &dyn std::error::Error) -> String {
    const LONGEST: usize = 400;
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        if !text.contains(&inner.to_string()) {
            text = format!("{text}: {inner}");
        }
        cause = inner.source();
    }
    let words = text.split_whitespace().map(|word| match word.split_once('?') {
        Some((before, _)) if word.contains("://") => before,
        _ => word,
    });
    let text: String = words.collect::<Vec<_>>().join(" ");
    text.chars().take(LONGEST).collect()
}

#[cfg(test)]
mod unit_tests {
    use std::io;

    use super::*;

    #[test]
    fn parts_cover_an_object_once() {
        let of = |bytes| parts(bytes).map(|part| (part.start, part.end)).collect::<Vec<_>>();
        assert!(of(0).is_empty());
        assert_eq!(of(PART), [(0, PART)]);
        assert_eq!(of(2 * PART + 1), [(0, PART), (PART, 2 * PART), (2 * PART, 2 * PART + 1)]);
    }

    #[test]
    fn an_object_is_not_looked_for_without_a_connection() {
        let failed = |kind| {
            let source = Box::new(HttpError::new(kind, io::Error::other("reset")));
            was_connected(&Error::Generic { store: "S3", source })
        };
        let kinds = [HttpErrorKind::Interrupted, HttpErrorKind::Timeout, HttpErrorKind::Connect];
        assert_eq!(kinds.map(failed), [true, true, false]);
    }

    #[test]
    fn texts_of_errors_contain_no_signature() {
        let error = io::Error::other("GET https://a.blob.core.windows.net/b/c?sv=1&sig=SECRET failed:\n  why?");
        assert_eq!(text_of(&error), "GET https://a.blob.core.windows.net/b/c failed: why?");
    }
}
