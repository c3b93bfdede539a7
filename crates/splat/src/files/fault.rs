use std::path::Path;

use crate::SplatError;

/// A broken file, before anybody knows its path.
#[derive(Debug)]
pub(super) struct Fault {
    location: String,
    expected: String,
    found: String,
}

impl Fault {
    pub(super) fn new(location: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self { location: location.into(), expected: expected.into(), found: found.into() }
    }

    pub(super) fn in_file(self, path: &Path) -> SplatError {
        let Self { location, expected, found } = self;
        SplatError::Format { path: path.to_owned(), location, expected, found }
    }
}

/// Text as an error message shows it: escaped, in quotes, cut after 40 bytes.
pub(super) fn shown(bytes: &[u8]) -> String {
    match bytes.get(..40) {
        Some(start) if bytes.len() > 40 => format!("\"{}…\"", start.escape_ascii()),
        _ => format!("\"{}\"", bytes.escape_ascii()),
    }
}
