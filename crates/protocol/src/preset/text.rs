use crate::ProtocolError;

/// A TOML error with the line and column, counted from 1, that its byte span begins at.
pub(super) fn malformed(text: &str, error: &toml::de::Error) -> ProtocolError {
    let start = error.span().map_or(0, |span| span.start);
    let before = text.get(..start).unwrap_or_default();
    let line = before.bytes().filter(|byte| *byte == b'\n').count() + 1;
    let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
    let message = error.message();
    let (found, expected) = message.rsplit_once(", expected ").unwrap_or((message, "a preset"));
    ProtocolError::Malformed {
        what: "preset",
        location: format!("line {line} column {column}"),
        expected: expected.to_owned(),
        found: found.chars().take(120).collect(),
    }
}
