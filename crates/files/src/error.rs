use std::fmt::{Display, Formatter, Result as Formatted};
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// A file operation that failed.
#[derive(Debug, Error)]
#[error("{action}: {source} ({})", path.display())]
pub struct FileError {
    /// What was being done, e.g. "reading a trajectory".
    pub action: &'static str,
    /// The file or folder.
    pub path: PathBuf,
    /// The operating system's error.
    pub source: io::Error,
}

impl FileError {
    /// For `map_err`: the error as a part of any error that has a [`FileError`] inside.
    pub fn during<E: From<Self>>(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> E {
        let path = path.into();
        move |source| Self { action, path, source }.into()
    }
}

/// Content that violates its format.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{what}: {location}: expected {expected}, found {found}{}", InParentheses(path.as_deref()))]
pub struct Malformed {
    /// What was being read, e.g. "evaluation index".
    pub what: &'static str,
    /// Line and column, field, byte, or tensor.
    pub location: String,
    /// What the format requires.
    pub expected: String,
    /// What was found, at most [`Malformed::SHOWN`] characters of it.
    pub found: String,
    /// The file, if it is known and no outer error names it.
    pub path: Option<Box<Path>>,
}

impl Malformed {
    /// The most characters that a message shows of untrusted text.
    pub const SHOWN: usize = 200;

    /// Without a path.
    #[expect(clippy::needless_pass_by_value, reason = "callers pass numbers and new strings as often as borrowed ones")]
    pub fn new(
        what: &'static str,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        let found = shortened(&found.to_string(), Self::SHOWN);
        Self { what, location: location.into(), expected: expected.into(), found, path: None }
    }

    /// The same error with its file.
    #[must_use]
    pub fn in_file(self, path: impl Into<PathBuf>) -> Self {
        Self { path: Some(path.into().into()), ..self }
    }
}

/// Text, such as an argument, that is not a value of its type.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("expected {expected}, found {found:?}")]
pub struct InvalidText {
    /// What values look like.
    pub expected: String,
    /// The text.
    pub found: String,
}

impl InvalidText {
    /// The error for a text.
    pub fn new(expected: impl Into<String>, found: &str) -> Self {
        Self { expected: expected.into(), found: found.to_owned() }
    }
}

struct InParentheses<'a>(Option<&'a Path>);

impl Display for InParentheses<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Formatted {
        self.0.map_or(Ok(()), |path| write!(f, " ({})", path.display()))
    }
}

/// At most `characters` of untrusted text, then an ellipsis if some are missing.
pub fn shortened(text: &str, characters: usize) -> String {
    match text.char_indices().nth(characters) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// At most 40 bytes of an untrusted file, escaped and in quotation marks, with an ellipsis if some are missing.
pub fn quoted(bytes: &[u8]) -> String {
    match bytes.get(..40) {
        Some(start) if bytes.len() > 40 => format!("\"{}…\"", start.escape_ascii()),
        _ => format!("\"{}\"", bytes.escape_ascii()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_say_what_where_and_in_which_file() {
        let failed: FileError = FileError::during("reading an index", "a/b.json")(io::ErrorKind::NotFound.into());
        assert_eq!(failed.to_string(), "reading an index: entity not found (a/b.json)");
        let malformed = Malformed::new("index", "line 2", "a number", "ä".repeat(201));
        assert_eq!(malformed.found, format!("{}…", "ä".repeat(200)));
        let malformed = Malformed::new("index", "line 2", "a number", 'x');
        assert_eq!(malformed.to_string(), "index: line 2: expected a number, found x");
        assert_eq!(malformed.in_file("i.json").to_string(), "index: line 2: expected a number, found x (i.json)");
    }

    #[test]
    fn only_longer_text_is_shortened() {
        assert_eq!((shortened("äöü", 3), shortened("äöü", 2)), ("äöü".to_owned(), "äö…".to_owned()));
    }
}
