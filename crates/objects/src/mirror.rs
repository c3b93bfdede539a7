//! The objects below a URL, as files whose contents are fetched when they are needed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use atsplat_files::{FileError, is_plain_name};

use crate::ObjectError;
use crate::cache::{self, Cache};
use crate::storage::{Download, Object, Process, Storage, Traffic};
use crate::store_files::{self, file_name};

/// A file or folder of object storage as one list showed it.
///
/// Every object is a file from the start, empty until [`Self::fetch`] has brought its content. An object whose size or tag has
/// changed since the list is an error, and a later mirror fetches it again; contents that did not change are fetched once.
#[derive(Debug)]
pub struct Mirror {
    storage: Box<dyn Storage>,
    cache: Cache,
    root: PathBuf,
    /// By the names of files.
    objects: BTreeMap<String, Object>,
    state: Mutex<State>,
    settled: Condvar,
}

#[derive(Debug, Default)]
struct State {
    complete: BTreeSet<String>,
    under_way: BTreeSet<String>,
    failed: Option<ObjectError>,
}

impl Mirror {
    /// Lists the objects below a URL. Copies are kept in `cache`, by default in the user's folder for caches.
    ///
    /// # Errors
    /// [`ObjectError::NotInstalled`], [`ObjectError::Invalid`]; [`ObjectError::NotFound`] if there is nothing,
    /// [`ObjectError::Denied`], [`ObjectError::Request`], [`ObjectError::Name`] for an object that cannot be a file,
    /// [`ObjectError::Io`].
    pub fn open(url: &str, cache: Option<&Path>) -> Result<Self, ObjectError> {
        Self::of(Box::new(Process::start(url)?), Cache::new(cache)?)
    }

    /// As [`Self::open`] with all contents, for results stores: one that is written meanwhile is listed again.
    ///
    /// # Errors
    /// As [`Self::open`] and [`Self::fetch`].
    pub fn complete(url: &str, cache: Option<&Path>) -> Result<Self, ObjectError> {
        const ATTEMPTS: usize = 5;
        let mut attempts = 1..ATTEMPTS;
        loop {
            let mirror = Self::open(url, cache)?;
            let fetched = mirror.fetch(std::slice::from_ref(&mirror.root));
            let changed =
                |error: &ObjectError| matches!(error, ObjectError::Changed { .. } | ObjectError::NotFound { .. });
            match fetched {
                Ok(()) => return Ok(mirror),
                Err(error) if changed(&error) && attempts.next().is_some() => {}
                Err(error) => return Err(error),
            }
        }
    }

    pub(crate) fn of(storage: Box<dyn Storage>, cache: Cache) -> Result<Self, ObjectError> {
        let listed = storage.list()?;
        let is_name = |name: &str| name.is_empty() || name.split('/').all(is_plain_name);
        if let Some(Object { name, .. }) = listed.iter().find(|object| !is_name(&object.name)) {
            return Err(ObjectError::Name { url: storage.url().to_owned(), name: name.clone() });
        }
        let files = store_files::files(&listed).into_iter();
        let objects: BTreeMap<String, Object> =
            files.map(|object| (file_name(&object.name).to_owned(), object)).collect();
        let root = cache.tree(storage.url(), objects.values());
        let (state, settled) = (Mutex::default(), Condvar::new());
        let mirror = Self { storage, cache, root, objects, state, settled };
        mirror.lay_out()?;
        Ok(mirror)
    }

    /// Creates the tree: links to what was fetched before, empty files for the rest.
    fn lay_out(&self) -> Result<(), ObjectError> {
        let failed = |path: &Path| FileError::during::<ObjectError>("creating a copy of a folder", path.to_owned());
        let mut complete = BTreeSet::new();
        for object in self.objects.values() {
            let (file, blob) = (self.file(object), self.cache.blob(self.storage.url(), object));
            for folder in [&file, &blob].into_iter().filter_map(|path| path.parent()) {
                fs::create_dir_all(folder).map_err(failed(folder))?;
            }
            let has_content = |path: &Path| fs::metadata(path).is_ok_and(|found| found.len() == object.bytes);
            if object.bytes > 0 && has_content(&blob) {
                if !has_content(&file) {
                    cache::link(&blob, &file)?;
                }
                complete.insert(object.name.clone());
                continue;
            }
            match fs::File::create_new(&file) {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(failed(&file)(error)),
                _ if object.bytes == 0 => drop(complete.insert(object.name.clone())),
                _ => {}
            }
        }
        self.lock().complete = complete;
        Ok(())
    }

    /// The file or folder that stands for the URL.
    pub fn path(&self) -> &Path {
        &self.root
    }

    /// The URL.
    pub fn url(&self) -> &str {
        self.storage.url()
    }

    /// What was exchanged.
    pub fn traffic(&self) -> Traffic {
        self.storage.traffic()
    }

    /// Why contents could not be fetched, if that has happened: nothing is requested since.
    pub fn failure(&self) -> Option<ObjectError> {
        self.lock().failed.clone()
    }

    /// Fetches the contents of files, and of all files in folders; other paths are ignored. Callable from any thread: what
    /// another one is fetching is waited for.
    ///
    /// # Errors
    /// [`ObjectError::Changed`], [`ObjectError::NotFound`], [`ObjectError::Denied`], [`ObjectError::Request`],
    /// [`ObjectError::Io`]; the first failure of this mirror again and again.
    pub fn fetch(&self, paths: &[PathBuf]) -> Result<(), ObjectError> {
        let wanted: BTreeMap<&str, &Object> = paths
            .iter()
            .filter_map(|path| self.name(path))
            .flat_map(|name| {
                below(&self.objects, &name).map(|object| (object.name.as_str(), object)).collect::<Vec<_>>()
            })
            .collect();
        let claimed = self.claim(&wanted)?;
        self.download(&claimed);
        self.wait_for(&wanted)
    }

    /// Those of the wanted objects that no thread has fetched or is fetching; they are then under way.
    fn claim<'a>(&self, wanted: &BTreeMap<&str, &'a Object>) -> Result<Vec<&'a Object>, ObjectError> {
        let mut state = self.lock();
        state.check()?;
        let is_new = |name: &str| !state.complete.contains(name) && !state.under_way.contains(name);
        let claimed: Vec<&Object> = wanted.values().copied().filter(|object| is_new(&object.name)).collect();
        state.under_way.extend(claimed.iter().map(|object| object.name.clone()));
        Ok(claimed)
    }

    /// Downloads claimed objects. An error is kept in the state.
    fn download(&self, claimed: &[&Object]) {
        let download =
            |object: &&Object| Download { object: (*object).clone(), file: self.cache.blob(self.url(), object) };
        let outcome = match claimed.iter().map(download).collect::<Vec<_>>() {
            downloads if downloads.is_empty() => Ok(()),
            downloads => self.storage.download(downloads, &|name, _version| self.place(name)),
        };
        let mut state = self.lock();
        for object in claimed {
            state.under_way.remove(&object.name);
        }
        if let Err(error) = outcome {
            state.failed.get_or_insert(error);
        }
        self.settled.notify_all();
    }

    /// Waits until all wanted objects are complete, whichever thread fetches them.
    fn wait_for(&self, wanted: &BTreeMap<&str, &Object>) -> Result<(), ObjectError> {
        let mut state = self.lock();
        while let Some(missing) = wanted.keys().find(|name| !state.complete.contains(**name)) {
            state.check()?;
            if !state.under_way.contains(*missing) {
                let (url, action) = (self.url().to_owned(), "reading objects".to_owned());
                let error = ObjectError::Request { url, action, detail: format!("no answer about {missing}") };
                // It says nothing about the data, which would otherwise count as unreadable.
                state.failed = Some(error.clone());
                return Err(error);
            }
            state = self.settled.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        Ok(())
    }

    /// Puts an object that has arrived into the tree.
    fn place(&self, name: &str) -> Result<(), ObjectError> {
        let Some(object) = self.objects.get(file_name(name)) else { return Ok(()) };
        cache::link(&self.cache.blob(self.url(), object), &self.file(object))?;
        self.lock().complete.insert(object.name.clone());
        self.settled.notify_all();
        Ok(())
    }

    fn file(&self, object: &Object) -> PathBuf {
        // A path that ends in a separator is not a file.
        if object.name.is_empty() { self.root.clone() } else { self.root.join(file_name(&object.name)) }
    }

    /// The name of a path below the root.
    fn name(&self, path: &Path) -> Option<String> {
        let parts = path.strip_prefix(&self.root).ok()?.components();
        let parts: Option<Vec<&str>> = parts
            .map(|part| match part {
                Component::Normal(name) => name.to_str(),
                _ => None,
            })
            .collect();
        Some(parts?.join("/"))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn check(&self) -> Result<(), ObjectError> {
        self.failed.as_ref().map_or(Ok(()), |error| Err(error.clone()))
    }
}

/// The object of a name, and all in the folder of that name.
fn below<'a>(objects: &'a BTreeMap<String, Object>, name: &str) -> impl Iterator<Item = &'a Object> + use<'a> {
    let folder = if name.is_empty() { String::new() } else { format!("{name}/") };
    let exact = if name.is_empty() { None } else { objects.get(name) };
    let inside = objects.range(folder.clone()..).take_while(move |(key, _)| key.starts_with(&folder));
    exact.into_iter().chain(inside.map(|(_, object)| object))
}
