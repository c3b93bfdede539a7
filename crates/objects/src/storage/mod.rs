//! A folder of object storage, by blocking calls that may come from any thread.
//!
//! `atsplat-objects URL` reads a [`Request`] from each line of its standard input, and writes [`Answer`]s to its standard
//! output, in any order, until its input ends. Contents are exchanged as files.

#[cfg(feature = "object-storage")]
pub(crate) mod connected;
mod process;

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::ObjectError;
pub(crate) use process::Process;

/// A folder of object storage.
pub(crate) trait Storage: fmt::Debug + Send + Sync {
    /// Its URL.
    fn url(&self) -> &str;

    /// What was exchanged.
    fn traffic(&self) -> Traffic;

    /// All objects below the URL, or the one that it names, sorted by name.
    fn list(&self) -> Result<Vec<Object>, ObjectError>;

    /// Reads objects into files, several at once. Each file appears when it is complete; `done` is then called with the
    /// object's name.
    fn download(&self, downloads: Vec<Download>, done: Done<'_>) -> Result<(), ObjectError>;

    /// The text of a small object; `None` if there is none.
    fn get(&self, name: &str) -> Result<Option<(String, Version)>, ObjectError>;

    /// Writes files into objects, several at once; `done` is called after each with its name. A file that is gone by now is
    /// left out. An object that another process has created or replaced is an error.
    fn put(&self, uploads: Vec<Upload>, done: Done<'_>) -> Result<(), ObjectError>;

    /// Removes an object, if it exists.
    fn delete(&self, name: &str) -> Result<(), ObjectError>;
}

/// Called with the name and the version of an object that was read or written.
pub(crate) type Done<'a> = &'a (dyn Fn(&str, Version) -> Result<(), ObjectError> + Sync);

/// A listed object.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Object {
    /// Name below the URL, with `/`; empty if the URL is that of the object.
    pub(crate) name: String,
    pub(crate) bytes: u64,
    /// The entity tag; where there are none, the time of the last change.
    pub(crate) tag: String,
}

/// The state of an object, as conditional requests name it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Version {
    pub(crate) tag: Option<String>,
    pub(crate) version: Option<String>,
}

/// An object to read.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Download {
    pub(crate) object: Object,
    pub(crate) file: PathBuf,
}

/// An object to write.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Upload {
    pub(crate) name: String,
    pub(crate) file: PathBuf,
    /// The version that it replaces; `None` for a new object.
    pub(crate) replaces: Option<Version>,
}

/// What was exchanged with object storage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Traffic {
    /// Requests, without repetitions of those that failed.
    pub requests: u64,
    /// Bytes of objects that were read, without lists and headers.
    pub bytes_read: u64,
    /// Bytes of objects that were written.
    pub bytes_written: u64,
}

impl fmt::Display for Traffic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { requests, bytes_read, bytes_written } = self;
        write!(f, "{requests} requests, {bytes_read} bytes read, {bytes_written} bytes written")
    }
}

/// A call of [`Storage`]; answers bear its number.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Request {
    pub(crate) id: u64,
    pub(crate) call: Call,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) enum Call {
    List,
    Download(Vec<Download>),
    Get(String),
    Put(Vec<Upload>),
    Delete(String),
}

/// A part of the answer to a call, and what was exchanged until then.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Answer {
    pub(crate) id: u64,
    pub(crate) traffic: Traffic,
    pub(crate) content: Content,
}

/// All but [`Self::Each`] end a call.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) enum Content {
    /// An object was read or written.
    Each(String, Version),
    Objects(Vec<Object>),
    Text(Option<(String, Version)>),
    Done,
    Failed(ObjectError),
}
