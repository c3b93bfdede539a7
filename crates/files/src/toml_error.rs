use crate::Malformed;

/// The error of a TOML file, with line and column counted from 1: `what` it is, and what the `whole` of it should be.
pub fn malformed_toml(what: &'static str, whole: &str, text: &str, error: &toml::de::Error) -> Malformed {
    let message = error.message();
    let start = error.span().map_or(0, |span| span.start);
    let start = unknown_field(message, text, start).unwrap_or(start);
    let before = text.bytes().take(start);
    let line = before.clone().filter(|byte| *byte == b'\n').count() + 1;
    let is_char_start = |byte: &u8| byte & 0b1100_0000 != 0b1000_0000;
    let column = before.rev().take_while(|byte| *byte != b'\n').filter(is_char_start).count() + 1;
    let (expected, found) = toml_problem(whole, error);
    let (expected, found) = match error.span().and_then(|span| text.get(span)) {
        Some(key) if message == "duplicate key" => ("every key once".to_owned(), format!("{key} again")),
        _ => (expected, found),
    };
    Malformed::new(what, format!("line {line} column {column}"), expected, found)
}

/// What a TOML file should have, and what it has, in words of a reader instead of the parser's. Without a more specific expectation,
/// the first is the `whole`.
pub fn toml_problem(whole: &str, error: &toml::de::Error) -> (String, String) {
    let message = error.message();
    match message.rsplit_once(", expected ") {
        Some((found, expected)) => {
            let found = found_in_words(found);
            (in_words(expected, &found), found)
        }
        None if message == "wanted string or table" => {
            ("a name in quotation marks, or a table".to_owned(), "neither".to_owned())
        }
        None => match message.strip_prefix("missing field ") {
            Some(name) => (format!("a field {name}"), "none".to_owned()),
            None => (whole.to_owned(), message.to_owned()),
        },
    }
}

/// What the deserializer of a Rust type expects, as a value of TOML.
fn in_words(expected: &str, found: &str) -> String {
    match expected {
        "f32" | "f64" => "a number".to_owned(),
        "i8" | "i16" | "i32" | "i64" | "i128" | "isize" => "a whole number".to_owned(),
        "a string" | "path string" => "text in quotation marks".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a sequence" => "a list".to_owned(),
        other if other.starts_with("struct ") || other.starts_with("internally tagged enum ") => "a table".to_owned(),
        other => unsigned_in_words(other, found).or_else(|| list_in_words(other)).unwrap_or_else(|| other.to_owned()),
    }
}

/// The numbers of an unsigned type. Only a number that is too large shows where they end.
fn unsigned_in_words(expected: &str, found: &str) -> Option<String> {
    let nonzero = expected.strip_prefix("a nonzero ");
    let most: i128 = match nonzero.unwrap_or(expected) {
        "u8" => u8::MAX.into(),
        "u16" => u16::MAX.into(),
        "u32" => u32::MAX.into(),
        "u64" | "usize" => u64::MAX.into(),
        "u128" => i128::MAX,
        _ => return None,
    };
    let is_too_large = found.parse::<i128>().is_ok_and(|found| found > most);
    Some(match nonzero {
        _ if is_too_large => format!("a whole number from {} to {most}", u8::from(nonzero.is_some())),
        Some(_) => "a positive whole number".to_owned(),
        None => "a whole number of at least 0".to_owned(),
    })
}

/// A list of so many values.
fn list_in_words(expected: &str) -> Option<String> {
    let length = ["an array of length ", "a tuple of size "].iter().find_map(|start| expected.strip_prefix(start))?;
    Some(format!("a list of {length} values"))
}

/// What the parser found, without the names of its types.
fn found_in_words(found: &str) -> String {
    if let Some(length) = found.strip_prefix("invalid length ") {
        return format!("a list of {length}");
    }
    let Some(value) = ["invalid type: ", "invalid value: "].iter().find_map(|start| found.strip_prefix(start)) else {
        return found.to_owned();
    };
    let kinds = ["integer `", "floating point `", "boolean `"];
    let number = kinds.iter().find_map(|kind| value.strip_prefix(kind)?.strip_suffix('`'));
    match value {
        "sequence" => "a list".to_owned(),
        "map" => "a table".to_owned(),
        _ => number.or_else(|| value.strip_prefix("string ")).unwrap_or(value).to_owned(),
    }
}

/// The position of a field that its table does not define. The parser reports only the position of the table.
fn unknown_field(message: &str, text: &str, table: usize) -> Option<usize> {
    let (name, _) = message.strip_prefix("unknown field `")?.split_once('`')?;
    let text = text.get(table..)?;
    let is_key = |at: usize| {
        let before = text.get(..at).and_then(|before| before.chars().next_back());
        let after = text.get(at + name.len()..).unwrap_or_default().trim_start_matches(['"', '\'', ' ', '\t']);
        before.is_none_or(|before| before.is_whitespace() || "{,.\"'".contains(before)) && after.starts_with('=')
    };
    text.match_indices(name).map(|(at, _)| at).find(|at| is_key(*at)).map(|at| table + at)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::num::{NonZeroU32, NonZeroUsize};
    use std::path::PathBuf;

    use serde::de::DeserializeOwned;

    use super::*;

    /// The error of the third line, whose value is not one of this type.
    fn error_of<T: DeserializeOwned>(value: &str) -> String {
        let text = format!("# ä\n\na = {value}\n");
        let error = toml::from_str::<BTreeMap<String, T>>(&text).map(drop).unwrap_err();
        malformed_toml("file", "the whole", &text, &error).to_string()
    }

    #[test]
    fn errors_are_in_a_readers_words() {
        let is = |error: String, expected: &str, found: &str| {
            assert_eq!(error, format!("file: line 3 column 5: expected {expected}, found {found}"));
        };
        is(error_of::<NonZeroUsize>("0"), "a positive whole number", "0");
        is(error_of::<u64>("\"two\""), "a whole number of at least 0", "\"two\"");
        is(error_of::<u8>("-3"), "a whole number of at least 0", "-3");
        is(error_of::<u8>("300"), "a whole number from 0 to 255", "300");
        is(error_of::<NonZeroU32>("5_000_000_000"), "a whole number from 1 to 4294967295", "5000000000");
        is(error_of::<NonZeroU32>("0"), "a positive whole number", "0");
        is(error_of::<i32>("1.5"), "a whole number", "1.5");
        is(error_of::<f64>("true"), "a number", "true");
        is(error_of::<bool>("[1]"), "true or false", "a list");
        is(error_of::<PathBuf>("3"), "text in quotation marks", "3");
        is(error_of::<[u8; 2]>("[1]"), "a list of 2 values", "a list of 1");
        is(error_of::<(usize, usize)>("[3]"), "a list of 2 values", "a list of 1");
        is(error_of::<Vec<u8>>("{ b = 1 }"), "a list", "a table");
    }

    #[test]
    fn a_missing_field_is_what_is_expected() {
        #[derive(Debug, serde::Deserialize)]
        #[expect(dead_code, reason = "it is read, never looked at")]
        struct Pinned {
            index: PathBuf,
            sha256: String,
        }
        let error = toml::from_str::<Pinned>("index = 'a.json'").unwrap_err();
        let (expected, found) = toml_problem("the whole", &error);
        assert_eq!((expected.as_str(), found.as_str()), ("a field `sha256`", "none"));
    }

    #[test]
    fn messages_without_an_expectation_stay() {
        let error = toml::from_str::<BTreeMap<String, u8>>("a = 1\na = 2").unwrap_err();
        let (expected, found) = toml_problem("the whole", &error);
        assert_eq!((expected.as_str(), found.as_str()), ("the whole", "duplicate key"));
    }

    #[test]
    fn a_key_that_is_there_twice_is_named() {
        let text = "[table]\nfirst = 1\nsecond = 2\nfirst = 3\n";
        let error = toml::from_str::<BTreeMap<String, BTreeMap<String, u8>>>(text).unwrap_err();
        let error = malformed_toml("file", "the whole", text, &error).to_string();
        assert_eq!(error, "file: line 4 column 1: expected every key once, found first again");
    }
}
